"""A policy file in a Gymnasium loop: NumPy is all that it needs.

    python examples/policy_gymnasium.py --steps 1000 --policy walker.safetensors

The card in the file has the task, the order of the observation and the action repeat. Without
--policy it plays the first of the bundled policies (`limberjack policies`).
"""

import argparse
from typing import Any

import gymnasium

from limberjack import policies
from limberjack.policies import mlp


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1000, help="control steps")
    parser.add_argument("--policy", help="a policy file")
    given = parser.parse_args()

    policy = mlp.load(given.policy or policies.bundled()[0].path)
    card = policy.card
    env: Any = gymnasium.make(
        f"limberjack:limberjack/{card.domain}-{card.task}-v0",
        flat=True,
        dtype="float32",
        action_repeat=card.action_repeat,
    )
    observation, _ = env.reset(seed=0)
    total, episodes = 0.0, 0
    for _ in range(given.steps // card.action_repeat):
        observation, reward, terminated, truncated, _ = env.step(policy.actions(observation))
        total += reward
        if terminated or truncated:
            observation, _ = env.reset()
            episodes += 1
    print(f"{card.title}: return {total:.1f} in {given.steps} steps, {episodes} episodes ended")
    env.close()


if __name__ == "__main__":
    main()
