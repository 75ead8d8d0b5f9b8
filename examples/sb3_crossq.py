"""Stable-Baselines3 on a batch: CrossQ learns reacher easy in minutes, in one process.

    pip install sb3-contrib stable-baselines3
    python examples/sb3_crossq.py --steps 60000 --envs 8 --out reacher.zip

It prints SB3's table every eight episodes, at the end the return on seeds that it has not trained
on, and with --out it keeps the model, which `limberjack run reacher easy --action-repeat 2 --policy
sb3:reacher.zip` plays. `limberjack train reacher easy` learns the same with JAX in less time, and
continues after a kill.
"""

import argparse
import time
from typing import Any

import torch  # pyright: ignore[reportMissingImports]
from sb3_contrib import CrossQ  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.evaluation import (  # pyright: ignore[reportMissingImports]
    evaluate_policy,
)
from stable_baselines3.common.vec_env import VecMonitor  # pyright: ignore[reportMissingImports]

from limberjack import sb3

ACTION_REPEAT = 2  # control steps of 20 ms
# Of CrossQ: networks of this size learn as much per step as larger ones, and in less time.
SETTINGS: dict[str, Any] = {
    "learning_rate": 5e-4,
    "learning_starts": 1000,
    "batch_size": 128,
    "gamma": 0.99,
    "train_freq": 1,  # a step of all rows
    "policy_kwargs": {"net_arch": [128, 128]},
}
_UPDATES = 0.5  # for each action of a row
_TRAINED, _HELD_OUT = 1_000_000, 40_000  # first seeds of the rows
_EPISODES = 100


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=60_000, help="control steps of all rows")
    parser.add_argument("--envs", type=int, default=8, help="rows of the batch")
    parser.add_argument("--seed", type=int, default=0, help="of the networks and the rows")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of an episode")
    parser.add_argument("--out", help="file for the model")
    given = parser.parse_args()

    torch.set_num_threads(1)  # the networks are small: more threads cost more than they gain
    how = {"action_repeat": ACTION_REPEAT, "time_limit": given.seconds}
    # Staggered rows are at different times of their episodes. VecMonitor logs the returns.
    envs = VecMonitor(sb3.make_vec_env("reacher", "easy", given.envs, stagger=True, **how))
    model = CrossQ(
        "MlpPolicy",
        envs,
        **SETTINGS,
        gradient_steps=max(1, round(_UPDATES * given.envs)),
        seed=given.seed,
        device="cpu",
        verbose=1,
    )
    envs.seed(_TRAINED + 1000 * given.seed)  # instead of the model's own seed
    began = time.process_time()
    model.learn(given.steps // ACTION_REPEAT, log_interval=8)
    seconds = time.process_time() - began
    if given.out is not None:
        model.save(given.out)

    # A row for each seed; each plays its first episode.
    held_out = VecMonitor(sb3.make_vec_env("reacher", "easy", _EPISODES, seed=_HELD_OUT, **how))
    mean, spread = evaluate_policy(model, held_out, n_eval_episodes=_EPISODES)
    print(
        f"{ACTION_REPEAT * model.num_timesteps} control steps in {seconds:.0f} processor seconds: "
        f"return {mean:.1f} +- {spread:.1f} over the seeds {_HELD_OUT}:{_HELD_OUT + _EPISODES}"
    )
    envs.close()
    held_out.close()


if __name__ == "__main__":
    main()
