"""Behaviour cloning: PyTorch learns to act as the policy of a dataset did, in minutes.

    pip install fsspec pyarrow torch
    python examples/behaviour_cloning.py --steps 10000 --out clone.safetensors

It first collects 32 episodes of walker walk, played by the bundled policy. With --out it keeps the
clone, which `limberjack run walker walk --policy mlp:clone.safetensors` plays.
It prints the mean returns of the dataset and, on seeds that are not in it, of the clone.
"""

import argparse
import itertools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]

from limberjack import data
from limberjack.episodes.torch_datasets import Sequences
from limberjack.evaluation import evaluate
from limberjack.policies import mlp

_TASK = "walker", "walk"  # that is collected
_COLLECTED, _HELD_OUT = range(32), 40_000  # seeds, and the first one of those to score
_BATCH = 256  # actions of the policy
_HIDDEN = 128
_LEARNING_RATE = 1e-3


def _clone(dataset: data.Dataset, card: mlp.Card, steps: int, seed: int) -> list[mlp.Layer]:
    """The layers of a network that learned the dataset's actions."""
    network = torch.nn.Sequential(
        torch.nn.Linear(card.num_observations, _HIDDEN),
        torch.nn.ReLU(),
        torch.nn.Linear(_HIDDEN, _HIDDEN),
        torch.nn.ReLU(),
        torch.nn.Linear(_HIDDEN, len(card.low)),
    )
    error = torch.zeros(())
    optimizer = torch.optim.Adam(network.parameters(), lr=_LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    mean, scale, low, high = (
        torch.tensor(numbers, dtype=torch.float32)
        for numbers in (card.mean, card.scale, card.low, card.high)
    )
    # The policy chose one action for so many steps, at the first of each window.
    repeat = card.action_repeat
    chosen = Sequences(dataset.select(float32=True), repeat, repeat, size=_BATCH, seed=seed)
    for batch in itertools.islice(_epochs(chosen), steps):
        seen = [batch["observations"][name][:, 0] for name, _ in card.layout]
        flat = torch.cat([values.reshape(len(values), -1) for values in seen], dim=1)
        action = low + (torch.tanh(network((flat - mean) / scale)) + 1) * (high - low) / 2
        error = torch.nn.functional.mse_loss(action, batch["actions"][:, 0])
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
        schedule.step()
    print(f"error of an action {error.item() ** 0.5:.4f}, root mean square")
    return [
        (layer.weight.detach().numpy(), layer.bias.detach().numpy())
        for layer in network
        if isinstance(layer, torch.nn.Linear)
    ]


def _epochs(sequences: Sequences) -> Any:
    """The batches of one epoch after the other, without an end."""
    for epoch in itertools.count():
        sequences.set_epoch(epoch)
        yield from sequences


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=10_000, help="of the optimiser")
    parser.add_argument("--seed", type=int, default=0, help="of the network and the order")
    parser.add_argument("--data", type=Path, help="folder of the dataset, collected if missing")
    parser.add_argument("--episodes", type=int, default=20, help="that score the clone")
    parser.add_argument("--out", type=Path, help="file for the clone")
    given = parser.parse_args()

    torch.manual_seed(given.seed)
    torch.set_num_threads(1)  # the network is small: more threads cost more than they bring
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.data or Path(temporary) / "data"
        if not folder.exists():
            data.collect(*_TASK, "pretrained", _COLLECTED, out=folder)
        dataset = data.load(folder)
        card = dataset.policy_card("behaviour cloning")
        out = given.out or Path(temporary) / "clone.safetensors"
        mlp.save(out, _clone(dataset, card, given.steps, given.seed), card)
        seeds = range(_HELD_OUT, _HELD_OUT + given.episodes)
        clone = evaluate(card.domain, card.task, f"mlp:{out}", seeds)
    before = np.mean([episode.total for episode in dataset])
    print(
        f"return of the dataset {before:.1f}, of the clone {clone.summary(clone.policy).mean:.1f}"
    )


if __name__ == "__main__":
    main()
