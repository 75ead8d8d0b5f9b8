"""A policy file in a program of Stable-Baselines3, measured by SB3's own `evaluate_policy`.

    pip install sb3-contrib stable-baselines3
    python examples/policy_sb3.py --steps 1000 --envs 4 --policy walker.safetensors

SB3 and its tools ask a policy for one method, `predict`. Without --policy it plays the first of the
bundled policies (`limberjack policies`).
"""

import argparse

import numpy as np
from stable_baselines3.common.evaluation import (  # pyright: ignore[reportMissingImports]
    evaluate_policy,
)
from stable_baselines3.common.vec_env import (  # pyright: ignore[reportMissingImports]
    VecMonitor,
)

from limberjack import policies, sb3, suite
from limberjack.policies import mlp


class Expert:
    """A policy file with the interface of a model of SB3."""

    def __init__(self, policy: mlp.Mlp) -> None:
        """Takes the policy."""
        self._policy = policy

    def predict(
        self,
        observation: np.ndarray,
        state: None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, None]:
        """The actions at observations of (rows, observation), and no state."""
        return self._policy.actions(observation), None


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1000, help="control steps of an episode")
    parser.add_argument("--envs", type=int, default=4, help="rows, each of which plays an episode")
    parser.add_argument("--policy", help="a policy file")
    given = parser.parse_args()

    policy = mlp.load(given.policy or policies.bundled()[0].path)
    card = policy.card
    seconds = given.steps * suite.load(card.domain, card.task).control_timestep()
    batch = sb3.make_vec_env(
        card.domain,
        card.task,
        given.envs,
        seed=0,
        time_limit=seconds,
        action_repeat=card.action_repeat,
    )
    envs = VecMonitor(batch)
    mean, spread = evaluate_policy(Expert(policy), envs, n_eval_episodes=given.envs)
    print(f"{card.title}: return {mean:.1f} +- {spread:.1f} over {given.envs} episodes")
    envs.close()


if __name__ == "__main__":
    main()
