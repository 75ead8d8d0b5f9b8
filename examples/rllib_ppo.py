"""RLlib's PPO, each of whose env runners steps a batch in its own process.

    pip install 'ray[rllib]' torch
    python examples/rllib_ppo.py --steps 1000000 --envs 64 --runners 2

The env runners make the batch through Gymnasium's vector entry point; the id names the module that
registers it, which holds in Ray's processes too. It prints the mean return as it learns. A million
steps of a humanoid are a beginning, not a solution.
"""

import argparse

import ray  # pyright: ignore[reportMissingImports]
from ray.rllib.algorithms.ppo import PPOConfig  # pyright: ignore[reportMissingImports]

_ROLLOUT = 64  # steps of each row between two updates


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000, help="steps of all rows together")
    parser.add_argument("--envs", type=int, default=64, help="rows of each env runner's batch")
    parser.add_argument("--runners", type=int, default=1, help="processes beside the learner's")
    parser.add_argument("--seconds", type=float, default=25.0, help="length of an episode")
    given = parser.parse_args()

    # Flat float32 observations. RLlib gives each env runner one core, hence one thread.
    arguments = {
        "flat": True, "dtype": "float32", "num_threads": 1, "time_limit": given.seconds,
    }  # fmt: skip
    update = _ROLLOUT * given.envs * max(1, given.runners)
    config = (
        PPOConfig()
        .environment("limberjack:limberjack/humanoid-stand-v0", env_config=arguments)
        .env_runners(
            num_env_runners=given.runners,
            num_envs_per_env_runner=given.envs,
            gym_env_vectorize_mode="vector_entry_point",
            rollout_fragment_length=_ROLLOUT,
        )
        .training(train_batch_size_per_learner=update, minibatch_size=update // 4, num_epochs=4)
        .debugging(seed=0)
    )
    ray.init(num_cpus=given.runners + 1, include_dashboard=False)
    algorithm = config.build_algo()
    steps = 0
    while steps < given.steps:
        results = algorithm.train()["env_runners"]
        steps = int(results["num_env_steps_sampled_lifetime"])
        # No episode may have ended yet.
        print(f"{steps} steps, mean return {results.get('episode_return_mean', float('nan')):.1f}")
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
