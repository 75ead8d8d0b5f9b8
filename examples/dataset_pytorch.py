"""A model of the dynamics, learned with PyTorch from a dataset that `limberjack collect` wrote.

    pip install fsspec pyarrow torch
    python examples/dataset_pytorch.py --steps 2000 --data reach

Without --data it first collects 64 short episodes of random actions. `num_workers` of the
`DataLoader` may be any number: each worker reads episodes of its own. It prints the error of the
predicted velocities, in the first and in the last tenth of the steps.
"""

import argparse
import itertools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]

from limberjack import data
from limberjack.episodes.torch_datasets import Batches

_BATCH = 256  # transitions
_LEARNING_RATE = 1e-3


def _joined(parts: list[torch.Tensor]) -> torch.Tensor:
    return torch.cat([values.reshape(len(values), -1) for values in parts], dim=1)


def _known_and_change(batch: dict[str, Any]) -> tuple[torch.Tensor, torch.Tensor]:
    """Observations with actions, and the change of the observations."""
    now, after = batch["observations"], batch["next_observations"]
    change = [after[name] - now[name] for name in now]
    return _joined([*now.values(), batch["actions"]]), _joined(change)


def _learn(dataset: data.Dataset, steps: int) -> tuple[float, float]:
    """Mean squared errors of the first and the last tenth of the steps."""
    batches = Batches(dataset.select(float32=True), _BATCH, seed=0)
    loader = torch.utils.data.DataLoader(batches, batch_size=None)
    known, change = _known_and_change(next(iter(loader)))
    scale = change.std(dim=0) + 1e-6  # so that all observations count alike
    model = torch.nn.Sequential(
        torch.nn.Linear(known.shape[1], 64),
        torch.nn.Tanh(),
        torch.nn.Linear(64, change.shape[1]),
    )
    optimizer = torch.optim.Adam(model.parameters(), lr=_LEARNING_RATE)
    errors: list[float] = []
    for epoch in itertools.count():
        batches.set_epoch(epoch)
        for batch in loader:
            known, change = _known_and_change(batch)
            error = torch.nn.functional.mse_loss(model(known), change / scale)
            optimizer.zero_grad()
            error.backward()
            optimizer.step()
            errors.append(error.item())
        if len(errors) >= steps:
            break
    tenth = max(1, steps // 10)
    return float(np.mean(errors[:tenth])), float(np.mean(errors[-tenth:]))


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=2000, help="of the optimiser")
    parser.add_argument("--data", type=Path, help="a folder that `limberjack collect` wrote")
    given = parser.parse_args()

    torch.manual_seed(0)
    torch.set_num_threads(1)  # the network is small: more threads cost more than they bring
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.data
        if folder is None:
            folder = Path(temporary)
            data.collect("reacher", "easy", "random", range(64), out=folder, time_limit=2.0)
        dataset = data.load(folder)
        print(f"{len(dataset)} episodes, {dataset.steps} transitions")
        before, after = _learn(dataset, given.steps)
    print(f"error {before:.4f} at first, {after:.4f} after {given.steps} steps")


if __name__ == "__main__":
    main()
