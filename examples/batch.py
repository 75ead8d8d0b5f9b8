"""A batch by itself: random actions in lockstep, then one state tried with many actions.

    python examples/batch.py --steps 100000 --envs 256

It needs nothing but Limberjack. It prints how many steps a second were made; and, of the state that
row 0 was left in, which of as many random actions as there are rows lifts the head highest.
"""

import argparse
import time

import numpy as np

from limberjack import suite

_LOOK_AHEAD = 10  # control steps, 0.25 s


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100_000, help="steps of all rows together")
    parser.add_argument("--envs", type=int, default=256, help="rows of the batch")
    given = parser.parse_args()

    batch = suite.load_batch("humanoid", "stand", num_envs=given.envs, seed=0)
    spec = batch.action_spec()  # (envs, 21)
    generator = np.random.default_rng(0)

    total_reward = 0.0
    steps = max(1, given.steps // given.envs)
    batch.reset()
    began = time.perf_counter()
    for _ in range(steps):
        # A row whose episode has ended begins its next one at the next step, by itself.
        time_step = batch.step(generator.uniform(spec.minimum, spec.maximum))
        total_reward += time_step.reward.sum()
    seconds = time.perf_counter() - began
    count = steps * given.envs
    print(f"{count} steps, {count / seconds:.0f} a second, mean reward {total_reward / count:.4f}")

    for row in range(1, given.envs):
        batch.copy_row(0, row)  # all rows in the state of row 0, to the last bit
    actions = generator.uniform(spec.minimum, spec.maximum)
    for _ in range(_LOOK_AHEAD):
        batch.step(actions)
    heights = batch.physics.head_height()  # (envs,), metres
    print(f"highest head after {given.envs} actions: {heights.max():.2f} m, row {heights.argmax()}")
    batch.close()


if __name__ == "__main__":
    main()
