"""TorchRL's collector over a batch: tensordicts of transitions from a policy of yours.

    pip install torchrl
    python examples/torchrl_collect.py --steps 100000 --envs 64

TorchRL wraps the Gymnasium vector environment. It resets rows by itself, hence the autoreset mode
DISABLED; then `next` of a row that ended has the last observation of its episode. It prints what
was collected.
"""

import argparse
import time
from typing import Any

import torch  # pyright: ignore[reportMissingImports]
from tensordict.nn import (  # pyright: ignore[reportMissingImports]
    NormalParamExtractor,
    TensorDictModule,
)
from torchrl.collectors import Collector  # pyright: ignore[reportMissingImports]
from torchrl.envs import GymWrapper  # pyright: ignore[reportMissingImports]
from torchrl.modules import (  # pyright: ignore[reportMissingImports]
    MLP,
    ProbabilisticActor,
    TanhNormal,
)

from limberjack import gym

_SECONDS = 2.5  # of an episode, 100 steps, so that some end soon
_ROLLOUT = 32  # steps of each row in a batch of transitions


def _policy(env: Any) -> Any:
    """A Gaussian policy, squashed into the actions' range, with one small network."""
    size = env.action_spec.shape[-1]
    network = torch.nn.Sequential(
        MLP(in_features=env.observation_spec["observation"].shape[-1], out_features=2 * size),
        NormalParamExtractor(),
    )
    module = TensorDictModule(network, in_keys=["observation"], out_keys=["loc", "scale"])
    return ProbabilisticActor(
        module, in_keys=["loc", "scale"], distribution_class=TanhNormal, spec=env.action_spec
    )


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100_000, help="steps of all rows together")
    parser.add_argument("--envs", type=int, default=64, help="rows of the vector environment")
    given = parser.parse_args()

    torch.manual_seed(0)
    torch.set_num_threads(1)  # the network is small: more threads cost more than they bring
    envs: Any = gym.load_vector(
        "humanoid",
        "walk",
        given.envs,
        time_limit=_SECONDS,
        flat=True,
        dtype="float32",
        autoreset_mode="Disabled",
    )
    envs.autoreset_mode = envs.metadata["autoreset_mode"]  # TorchRL asks the environment itself
    env = GymWrapper(envs)
    env.set_seed(0)
    rollout = _ROLLOUT * given.envs
    batches = max(1, given.steps // rollout)
    collector = Collector(
        env,
        _policy(env),
        frames_per_batch=rollout,
        total_frames=batches * rollout,
        auto_register_policy_transforms=True,  # the default from TorchRL 0.15 on
    )

    frames, ended, reward = 0, 0, 0.0
    began = time.perf_counter()
    for batch in collector:  # (envs, _ROLLOUT): train here
        frames += batch.numel()
        ended += int(batch["next", "done"].sum())
        reward += float(batch["next", "reward"].sum())
    rate = frames / (time.perf_counter() - began)
    print(f"{frames} transitions, {rate:.0f} a second, {ended} episodes ended")
    print(f"mean reward {reward / frames:.4f}")
    collector.shutdown()


if __name__ == "__main__":
    main()
