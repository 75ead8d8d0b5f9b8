"""Offline learning: TorchRL's IQL learns from a dataset of good and bad actions.

    pip install torchrl
    pip install fsspec pyarrow
    python examples/offline_iql.py --steps 5000 --out iql.safetensors

It first collects 64 episodes of cartpole swingup, with more random actions in some than in others,
and the bundled policy's otherwise. With --out it keeps the learned policy, which `limberjack run
cartpole swingup --policy mlp:iql.safetensors` plays. It prints the mean returns of the dataset and,
on other seeds, of the learned policy.
"""

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from tensordict import TensorDict  # pyright: ignore[reportMissingImports]
from tensordict.nn import TensorDictModule  # pyright: ignore[reportMissingImports]
from torchrl.data import (  # pyright: ignore[reportMissingImports]
    LazyTensorStorage,
    TensorDictReplayBuffer,
)
from torchrl.modules import (  # pyright: ignore[reportMissingImports]
    MLP,
    IndependentNormal,
    ProbabilisticActor,
    ValueOperator,
)
from torchrl.objectives import (  # pyright: ignore[reportMissingImports]
    IQLLoss,
    SoftUpdate,
)

from limberjack import data, policies
from limberjack.evaluation import evaluate
from limberjack.policies import mlp

_TASK = "cartpole", "swingup"  # that is collected
_REPEAT = 4  # control steps per action, as the bundled policy was trained
_RANDOM = (0.25, 0.5, 0.75, 1.0)  # shares of random actions in the episodes of seeds 0, 1, 2, 3 ...
_COLLECTED, _HELD_OUT = range(64), 40_000  # seeds, and the first one of those to score
_BATCH = 256  # transitions
_HIDDEN = [128, 128]
_LEARNING_RATE = 1e-3  # with a third of it most policies stay below the return of the dataset
_DISCOUNT = 0.99  # of a reward one control step later
_REWARD_SCALE = 0.05  # values of up to 5 are learned in fewer steps than those of up to 100
_EXPECTILE = 0.8  # of the values of a state's actions: nearer to 1, nearer to the best one's
_TEMPERATURE = 60.0  # inverse, of scaled rewards: how much more a better action counts
_TARGET_RATE = 0.02  # by which the target networks follow in each step


class Mixed:
    """Acts as the bundled policy, or at random."""

    def __init__(self) -> None:
        """Loads the bundled policy."""
        (path,) = (one.path for one in policies.bundled() if (one.domain, one.task) == _TASK)
        self._expert = mlp.load(path)
        self._streams: dict[int, np.random.RandomState] = {}
        self._shares: dict[int, float] = {}

    def reset_batch(self, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """Begins episodes in rows, each with a stream of its own."""
        for row, seed in zip(rows.tolist(), seeds, strict=True):
            self._streams[row] = np.random.RandomState(seed)
            self._shares[row] = _RANDOM[seed % len(_RANDOM)]

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        """The actions of all rows."""
        actions = self._expert.act_batch(observations)
        for row, stream in self._streams.items():
            drawn = stream.uniform(-1, 1, actions.shape[1:])
            if stream.uniform() < self._shares[row]:
                actions[row] = drawn
        return actions


def _transitions(dataset: data.Dataset, card: mlp.Card) -> TensorDict:
    """The transitions from each action to the next one, with observations as the card says."""
    repeat = dataset.recipe.facts["action_repeat"]
    chosen = dataset.select(float32=True, discount=_DISCOUNT, n_step=repeat)
    ends = np.cumsum(chosen.lengths)
    firsts = ends - chosen.lengths
    acted = [np.arange(first, end, repeat) for first, end in zip(firsts, ends, strict=True)]
    batch = chosen.transitions(np.concatenate(acted))
    mean, scale = (np.array(values, np.float32) for values in (card.mean, card.scale))
    before, after = (
        (mlp.flattened(card.layout, observed) - mean) / scale
        for observed in (batch.observations, batch.next_observations)
    )
    arrays = {
        "observation": before,
        "action": batch.actions,
        ("next", "observation"): after,
        ("next", "reward"): batch.rewards[:, None] * np.float32(_REWARD_SCALE),
        ("next", "terminated"): batch.terminated[:, None],
        ("next", "done"): (batch.terminated | batch.truncated)[:, None],
    }
    tensors: dict[Any, torch.Tensor] = {
        key: torch.from_numpy(array) for key, array in arrays.items()
    }
    return TensorDict(tensors, [len(batch)])


def _actor(observations: int, actions: int) -> tuple[torch.nn.Module, ProbabilisticActor]:
    """A network, and its output as the mean of the actions' distribution, whose width is fixed."""
    network = MLP(observations, actions, num_cells=_HIDDEN, activation_class=torch.nn.ReLU)
    module = TensorDictModule(
        torch.nn.Sequential(network, torch.nn.Tanh()), in_keys=["observation"], out_keys=["loc"]
    )
    how = {"scale": 1.0, "tanh_loc": False}
    return network, ProbabilisticActor(
        module, in_keys=["loc"], distribution_class=IndependentNormal, distribution_kwargs=how
    )


def _learn(known: TensorDict, repeat: int, steps: int) -> list[mlp.Layer]:
    """The layers of the policy that IQL learned from transitions of actions within -1 and 1."""
    observations, actions = known["observation"].shape[-1], known["action"].shape[-1]
    network, actor = _actor(observations, actions)
    sizes = {"out_features": 1, "num_cells": _HIDDEN, "activation_class": torch.nn.ReLU}
    action_value = MLP(observations + actions, **sizes)
    loss = IQLLoss(
        actor,
        ValueOperator(action_value, in_keys=["observation", "action"]),
        value_network=ValueOperator(MLP(observations, **sizes), in_keys=["observation"]),
        expectile=_EXPECTILE,
        temperature=_TEMPERATURE,
    )
    loss.make_value_estimator(gamma=_DISCOUNT**repeat)
    targets = SoftUpdate(loss, tau=_TARGET_RATE)
    optimizer = torch.optim.Adam(loss.parameters(), lr=_LEARNING_RATE)
    # To 0, as IQL's authors do for the actor: otherwise each of the last steps changes the policy.
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(len(known)), batch_size=_BATCH)
    buffer.extend(known)
    for _ in range(steps):
        losses = loss(buffer.sample())
        optimizer.zero_grad()
        (losses["loss_actor"] + losses["loss_qvalue"] + losses["loss_value"]).backward()
        optimizer.step()
        schedule.step()
        targets.step()
    return [
        (layer.weight.detach().numpy(), layer.bias.detach().numpy())
        for layer in network
        if isinstance(layer, torch.nn.Linear)
    ]


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=5_000, help="of the optimiser")
    parser.add_argument("--seed", type=int, default=0, help="of the networks and the order")
    parser.add_argument("--data", type=Path, help="folder of the dataset, collected if missing")
    parser.add_argument("--episodes", type=int, default=20, help="that score the policy")
    parser.add_argument("--out", type=Path, help="file for the policy")
    given = parser.parse_args()

    torch.manual_seed(given.seed)
    torch.set_num_threads(1)  # the networks are small: more threads cost more than they bring
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.data or Path(temporary) / "data"
        if not folder.exists():
            data.collect(*_TASK, Mixed, _COLLECTED, out=folder, action_repeat=_REPEAT)
        dataset = data.load(folder)
        card = dataset.policy_card("IQL")
        out = given.out or Path(temporary) / "iql.safetensors"
        mlp.save(out, _learn(_transitions(dataset, card), card.action_repeat, given.steps), card)
        seeds = range(_HELD_OUT, _HELD_OUT + given.episodes)
        facts = dataset.recipe.facts
        learned = evaluate(facts["domain"], facts["task"], f"mlp:{out}", seeds)
    before = np.mean([episode.total for episode in dataset])
    mean = learned.summary(learned.policy).mean
    print(f"return of the dataset {before:.1f}, of the learned policy {mean:.1f}")


if __name__ == "__main__":
    main()
