"""FlashSAC of unilab-rl on MuJoCo Warp: simulation, replay and learning on one device.

    pip install mujoco-warp torch warp-lang unilab-rl
    python examples/unilab_flash_sac.py --steps 2000000 --envs 1024 --device cuda:0
    PYTHONPATH=examples limberjack evaluate cartpole swingup --policy unilab_flash_sac:Policy

With --device cpu it runs anywhere, slowly. It prints the mean reward of a step in the first and in
the last tenth of learning, and writes the policy to flash_sac.pt in the working directory, from
which `Policy` reads it. Not measured on a GPU yet.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from uni_rl.algos.flash_sac import FlashSACLearner  # pyright: ignore[reportMissingImports]

from limberjack import gpu

_FILE = Path("flash_sac.pt")
_MOST = 1_000_000  # transitions to keep, those of all rows together
_FIRST = 10_000  # transitions before the first update
_BATCH = 2048  # transitions for an update
_UPDATES = 2  # of the critics after each step of all rows; one of them updates the actor too


def learner_of(observation_size: int, action_size: int, device: str) -> FlashSACLearner:
    """FlashSAC with the library's own settings, run as it is instead of compiled."""
    return FlashSACLearner(
        observation_size, action_size, observation_size, device=device, use_compile=False
    )


class Replay:
    """The last transitions of all rows, on the device."""

    def __init__(self, steps: int) -> None:
        self._steps, self._added, self._kept = steps, 0, {}

    def add(self, **transitions: torch.Tensor) -> None:
        """Writes the transitions of a step of all rows over the oldest ones."""
        for name, values in transitions.items():
            if name not in self._kept:
                self._kept[name] = values.new_empty(self._steps, *values.shape, dtype=torch.float32)
            self._kept[name][self._added % self._steps] = values
        self._added += 1

    def draw(self, count: int) -> dict[str, torch.Tensor]:
        """Transitions drawn with equal probability, by the names that FlashSAC reads."""
        rewards = self._kept["rewards"]
        most = min(self._added, self._steps) * rewards.shape[1]
        chosen = torch.randint(most, (count,), device=rewards.device)
        batch = {name: values.flatten(0, 1)[chosen] for name, values in self._kept.items()}
        return {**batch, "critic": batch["obs"], "next_critic": batch["next_obs"]}


def learn(envs: gpu.VectorEnv, learner: FlashSACLearner, steps: int) -> torch.Tensor:
    """Collects and learns for so many steps of all rows; returns their mean rewards, (steps,)."""
    replay, means = Replay(max(_MOST // envs.num_envs, 1)), []
    observations, _ = envs.reset()
    done = torch.zeros(envs.num_envs, device=envs.device)
    for _ in range(steps):
        actions = learner.actor.explore(observations, done)
        before = observations
        observations, rewards, terminated, truncated, info = envs.step(actions)
        done = (terminated | truncated).float()
        replay.add(
            obs=before,
            actions=actions,
            rewards=rewards,
            next_obs=info["final_obs"],
            dones=done,
            truncated=truncated,
        )
        learner.update_reward_stats(rewards, done)
        means.append(rewards.mean())
        for update in range(_UPDATES if len(means) * envs.num_envs >= _FIRST else 0):
            batch = replay.draw(_BATCH)
            learner.update_critic(batch, read_metrics=False)
            if update == 0:
                learner.update_actor(batch, read_metrics=False)
            learner.soft_update_target()
    return torch.stack(means)


class Policy:
    """The policy of the last run, for `limberjack evaluate`."""

    def __init__(self) -> None:
        saved = torch.load(_FILE, weights_only=True)
        self._actor = learner_of(*saved["sizes"], device="cpu").actor
        self._actor.load_state_dict(saved["actor"])

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        """The most likely actions, (64, nu)."""
        rows = [np.reshape(values, (len(values), -1)) for values in observations.values()]
        flat = torch.from_numpy(np.concatenate(rows, axis=-1, dtype=np.float32))
        return self._actor.explore(flat, deterministic=True).numpy()


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=2_000_000, help="steps of all rows together")
    parser.add_argument("--envs", type=int, default=1024, help="rows")
    parser.add_argument("--device", default="cuda:0", help="cuda:0, or cpu")
    given = parser.parse_args()

    torch.manual_seed(0)
    envs = gpu.load_vector(
        *("cartpole", "swingup", given.envs),
        device=given.device,
        seed=0,
        autoreset_mode="SameStep",  # so that each step is a transition of every row
    )
    sizes = envs.layout[-1].slice.stop, envs.action_shape[-1]
    learner = learner_of(*sizes, device=given.device)
    means = learn(envs, learner, max(given.steps // given.envs, 1))
    tenth = max(len(means) // 10, 1)
    first, last = (float(some.mean()) for some in (means[:tenth], means[-tenth:]))
    print(f"mean reward of a step: {first:.3f}, after learning {last:.3f}")
    torch.save({"sizes": sizes, "actor": learner.actor.state_dict()}, _FILE)
    envs.close()


if __name__ == "__main__":
    main()
