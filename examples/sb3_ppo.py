"""Stable-Baselines3's PPO on a batch: one process, no workers.

    pip install stable-baselines3
    python examples/sb3_ppo.py --steps 1000000 --envs 64

It prints SB3's own table as it learns, and at last the return of a few episodes. A million steps of
a humanoid are a beginning, not a solution.
"""

import argparse

import torch  # pyright: ignore[reportMissingImports]
from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.evaluation import (  # pyright: ignore[reportMissingImports]
    evaluate_policy,
)
from stable_baselines3.common.vec_env import (  # pyright: ignore[reportMissingImports]
    VecMonitor,
    VecNormalize,
)

from limberjack import sb3

_ROLLOUT = 64  # steps of each row between two updates
_EPISODES = 4


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000, help="steps of all rows together")
    parser.add_argument("--envs", type=int, default=64, help="rows of the batch")
    parser.add_argument("--seconds", type=float, default=25.0, help="length of an episode")
    given = parser.parse_args()

    torch.set_num_threads(1)  # the networks are small: more threads cost more than they bring
    batch = sb3.make_vec_env("humanoid", "stand", given.envs, seed=0, time_limit=given.seconds)
    # VecMonitor logs returns; VecNormalize matters, as velocities are much larger than angles.
    envs = VecNormalize(VecMonitor(batch))
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=_ROLLOUT,
        batch_size=_ROLLOUT * given.envs // 4,
        seed=0,
        device="cpu",
        verbose=1,
    )
    model.learn(given.steps)

    envs.training = False
    envs.norm_reward = False
    mean, spread = evaluate_policy(model, envs, n_eval_episodes=_EPISODES)
    print(f"{model.num_timesteps} steps; return {mean:.1f} +- {spread:.1f} over {_EPISODES}")
    envs.close()


if __name__ == "__main__":
    main()
