"""A model of the dynamics, learned with PyTorch from a dataset that `limberjack collect` wrote.

    pip install pyarrow
    pip install torch
    python examples/dataset_pytorch.py --steps 2000 --data reach

Without --data it first collects 64 short episodes of random actions. A `DataLoader` with workers
gives each of them episodes of its own; here one process reads. It prints the error of the predicted
velocities, in the first and in the last tenth of the steps.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch  # pyright: ignore[reportMissingImports]

from limberjack import data

_BATCH = 256  # transitions
_LEARNING_RATE = 1e-3


class Transitions(torch.utils.data.IterableDataset):
    """Observations with actions, and the change of the observations, shuffled in each pass."""

    def __init__(self, folder: Path) -> None:
        """Takes the folder of a dataset."""
        self._folder = folder
        self._passes = 0

    def __iter__(self) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Batches of float32."""
        dataset = data.load(self._folder)
        worker = torch.utils.data.get_worker_info()
        if worker is not None:  # each worker of a DataLoader reads episodes of its own
            dataset = dataset.part(worker.id, worker.num_workers)
        self._passes += 1
        for batch in dataset.batches(_BATCH, seed=self._passes):
            now, after = batch.observations, batch.next_observations
            known = [*now.values(), batch.actions]
            change = [after[name] - now[name] for name in now]
            yield _joined(known), _joined(change)


def _joined(parts: list[np.ndarray]) -> torch.Tensor:
    rows = [values.reshape(len(values), -1) for values in parts]
    return torch.from_numpy(np.concatenate(rows, axis=1, dtype=np.float32))


def _learn(folder: Path, steps: int) -> tuple[float, float]:
    """Mean squared errors of the first and the last tenth of the steps."""
    loader = torch.utils.data.DataLoader(Transitions(folder), batch_size=None)
    known, change = next(iter(loader))
    scale = change.std(dim=0) + 1e-6  # so that all observations count alike
    model = torch.nn.Sequential(
        torch.nn.Linear(known.shape[1], 64),
        torch.nn.Tanh(),
        torch.nn.Linear(64, change.shape[1]),
    )
    optimizer = torch.optim.Adam(model.parameters(), lr=_LEARNING_RATE)
    errors: list[float] = []
    while len(errors) < steps:
        for known, change in loader:
            error = torch.nn.functional.mse_loss(model(known), change / scale)
            optimizer.zero_grad()
            error.backward()
            optimizer.step()
            errors.append(error.item())
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
        before, after = _learn(folder, given.steps)
    print(f"error {before:.4f} at first, {after:.4f} after {given.steps} steps")


if __name__ == "__main__":
    main()
