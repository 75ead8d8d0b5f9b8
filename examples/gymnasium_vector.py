"""Transitions from a Gymnasium vector environment, with the rows where an episode ended done right.

    python examples/gymnasium_vector.py --steps 100000 --envs 256

It needs nothing but Limberjack. The autoreset mode is the default, NEXT_STEP: the observation after
a row's last step is the last of its episode, and the step after that begins the next episode,
ignores its action, and is no transition. See docs/batches.md.
"""

import argparse
from typing import Any

import gymnasium
import numpy as np

_SECONDS = 2.5  # of an episode, 100 steps, so that some end soon


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100_000, help="steps of all rows together")
    parser.add_argument("--envs", type=int, default=256, help="rows of the vector environment")
    given = parser.parse_args()

    envs: Any = gymnasium.make_vec(
        "limberjack:limberjack/humanoid-walk-v0",
        num_envs=given.envs,
        vectorization_mode="vector_entry_point",
        time_limit=_SECONDS,
        flat=True,
        dtype="float32",
    )
    head_height = {name: columns for name, columns, _ in envs.layout}["head_height"]

    transitions, truncations, heights = 0, 0, []
    observations, _ = envs.reset(seed=0)
    envs.action_space.seed(0)
    ended = np.zeros(given.envs, bool)
    for _ in range(max(1, given.steps // given.envs)):
        actions = envs.action_space.sample()
        following, rewards, terminated, truncated, _ = envs.step(actions)
        kept = ~ended  # the others have only begun their next episode
        # What a replay buffer takes. Bootstrap where `terminated` is False, truncated or not.
        batch = {
            "observation": observations[kept],
            "action": actions[kept],
            "reward": rewards[kept],
            "next_observation": following[kept],
            "terminated": terminated[kept],
        }
        transitions += len(batch["reward"])
        truncations += int(truncated.sum())
        heights.append(following[:, head_height].mean())
        observations, ended = following, terminated | truncated
    print(f"{transitions} transitions, {truncations} episodes cut off by the time limit")
    print(f"the head is {np.mean(heights):.2f} m high on average")
    envs.close()


if __name__ == "__main__":
    main()
