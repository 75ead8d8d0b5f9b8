"""rsl_rl's PPO on MuJoCo Warp: simulation, rewards and learning on one device.

    pip install mujoco-warp torch warp-lang rsl-rl-lib
    python examples/rsl_rl_ppo.py --steps 50000000 --envs 4096 --device cuda:0

With --device cpu it runs anywhere, slowly. It prints the mean reward of a step at the beginning and
at the end of learning. Not measured on a GPU yet.
"""

import argparse

import torch  # pyright: ignore[reportMissingImports]
from rsl_rl.runners import OnPolicyRunner  # pyright: ignore[reportMissingImports]

from limberjack import gpu
from limberjack.adapters.rsl_rl import RslRlVecEnv

_ROLLOUT = 24  # steps of each row between two updates
_SEEN = 20  # steps to average the reward over

_NETWORK = {"class_name": "MLPModel", "hidden_dims": [256, 128], "activation": "elu"}
_DRAWS = {"class_name": "GaussianDistribution", "init_std": 1.0}


def settings() -> dict[str, object]:
    """The settings of rsl_rl's runner."""
    return {
        "num_steps_per_env": _ROLLOUT,
        "save_interval": 1_000_000,
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "actor": {**_NETWORK, "obs_normalization": True, "distribution_cfg": _DRAWS},
        "critic": {**_NETWORK, "obs_normalization": True},
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": 5,
            "num_mini_batches": 4,
            "learning_rate": 1e-3,
            "gamma": 0.99,
        },
    }


def mean_reward(envs: RslRlVecEnv, runner: OnPolicyRunner) -> float:
    """The mean reward of some steps of the present policy."""
    policy, total = runner.get_inference_policy(device=envs.device), 0.0
    with torch.inference_mode():
        observations = envs.get_observations()
        for _ in range(_SEEN):
            observations, rewards, _, _ = envs.step(policy(observations).clone())
            total += float(rewards.mean())
    return total / _SEEN


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=50_000_000, help="steps of all rows together")
    parser.add_argument("--envs", type=int, default=4096, help="rows")
    parser.add_argument("--device", default="cuda:0", help="cuda:0, or cpu")
    given = parser.parse_args()

    vector = gpu.load_vector(
        *("cartpole", "balance", given.envs),
        device=given.device,
        seed=0,
        autoreset_mode="SameStep",
    )
    envs = RslRlVecEnv(vector)
    runner = OnPolicyRunner(envs, settings(), log_dir=None, device=given.device)
    before = mean_reward(envs, runner)
    runner.learn(max(given.steps // (given.envs * _ROLLOUT), 1))
    print(f"mean reward of a step: {before:.3f}, after learning {mean_reward(envs, runner):.3f}")
    vector.close()


if __name__ == "__main__":
    main()
