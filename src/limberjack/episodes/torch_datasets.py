"""PyTorch's kinds of datasets over a `Dataset`, for its `DataLoader`; needs the extra `torch`.

    from torch.utils.data import DataLoader

    batches = Batches(dataset.select(float32=True), 256, seed=0)
    loader = DataLoader(batches, batch_size=None, num_workers=4)
    for epoch in range(10):
        batches.set_epoch(epoch)            # another order in each epoch
        for batch in loader:
            learn(batch["observations"]["joint_angles"], batch["actions"], batch["rewards"])

`Batches` and `Sequences` read files one after the other. Each worker of a loader, and each rank of
a distributed run, reads episodes of its own, so that all of them together give every transition
once in an epoch; their numbers of batches may differ. `Transitions` has an index, for samplers:
episodes are read when they are needed and kept in memory.

A sample is a dictionary with the names of `Batch` or `Windows`, of tensors, which share the memory
of the arrays; observations are a dictionary by name. This is the only module here that imports
torch.
"""

import dataclasses
import operator
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from limberjack.episodes.dataset import Dataset
from limberjack.episodes.reading import Batch, Windows
from limberjack.utils.requirements import missing_extra

try:
    import torch  # pyright: ignore[reportMissingImports]
    import torch.distributed  # pyright: ignore[reportMissingImports]
    import torch.utils.data  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise missing_extra("torch") from error

__all__ = ["Batches", "Sequences", "Transitions", "tensors"]

_Sample = dict[str, Any]  # a tensor, or a dictionary of them: torch is not always installed


def tensors(part: Batch | Windows) -> _Sample:
    """The arrays by name, as tensors in their memory; those that are None are left out."""
    found: _Sample = {}
    for field in dataclasses.fields(part):
        values = getattr(part, field.name)
        if isinstance(values, Mapping):
            found[field.name] = {key: torch.from_numpy(one) for key, one in values.items()}
        elif values is not None:
            found[field.name] = torch.from_numpy(values)
    return found


def _item(sample: _Sample, number: int) -> _Sample:
    """A transition of a batch."""
    return {
        name: _item(values, number) if isinstance(values, dict) else values[number]
        for name, values in sample.items()
    }


class Transitions(torch.utils.data.Dataset):
    """Transitions by their numbers, in the order of seeds and steps.

    With `DataLoader(..., batch_size=256, shuffle=True)`, PyTorch stacks single transitions. A
    `sampler` that gives lists of numbers, with `batch_size=None`, gets whole batches, and is
    faster. In a distributed run, `DistributedSampler` repeats a few transitions so that all ranks
    have as many.
    """

    def __init__(self, dataset: Dataset) -> None:
        """Takes a dataset with the choices of its `select`."""
        self._dataset = dataset

    def __len__(self) -> int:
        return self._dataset.steps

    def __getitem__(self, index: int | Sequence[int]) -> _Sample:
        """A transition, or a batch of several; raises IndexError if there is no such one."""
        if isinstance(index, Sequence | np.ndarray):
            return tensors(self._dataset.transitions(index))
        return _item(tensors(self._dataset.transitions([operator.index(index)])), 0)

    def __getitems__(self, indices: Sequence[int]) -> list[_Sample]:
        """Single transitions, read together; a `DataLoader` calls it."""
        batch = self[indices]
        return [_item(batch, number) for number in range(len(indices))]


class _Stream(torch.utils.data.IterableDataset):
    """The base of `Batches` and `Sequences`: shares of an epoch, and its order."""

    def __init__(
        self, dataset: Dataset, seed: int | None, rank: int | None, ranks: int | None
    ) -> None:
        self._dataset, self._seed = dataset, seed
        self._rank, self._ranks = _place(rank, ranks)
        # In memory that is shared with the workers of a loader, which may live for several epochs.
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()

    def set_epoch(self, epoch: int) -> None:
        """Chooses the order of the iterations that begin from now on, in all workers."""
        self._epoch.fill_(epoch)

    def __iter__(self) -> Iterator[_Sample]:
        """The batches of this worker of this rank."""
        worker = torch.utils.data.get_worker_info()
        k, workers = (0, 1) if worker is None else (worker.id, worker.num_workers)
        k, n = self._rank * workers + k, min(self._ranks * workers, len(self._dataset))
        if k < n:  # there are no more parts than episodes
            for found in self._read(self._dataset.part(k, n), self._seed_of_epoch()):
                yield tensors(found)

    def _read(self, part: Dataset, seed: int | None) -> Iterator[Batch] | Iterator[Windows]:
        raise NotImplementedError

    def _seed_of_epoch(self) -> int | None:
        if self._seed is None:
            return None
        mixed = np.random.SeedSequence([self._seed, int(self._epoch)])
        return int(mixed.generate_state(1)[0])


def _place(rank: int | None, ranks: int | None) -> tuple[int, int]:
    """The rank and the number of ranks, those of a distributed run by default."""
    distributed = torch.distributed
    if rank is None and ranks is None:
        if not (distributed.is_available() and distributed.is_initialized()):
            return 0, 1
        return distributed.get_rank(), distributed.get_world_size()
    if rank is None or ranks is None or not 0 <= rank < ranks:
        raise ValueError(f"rank is {rank} of {ranks}; expected both, rank from 0 to ranks - 1")
    return rank, ranks


class Batches(_Stream):
    """The batches of `Dataset.batches`, shared among workers and ranks."""

    def __init__(
        self,
        dataset: Dataset,
        size: int,
        *,
        seed: int | None = None,
        buffer: int = 0,
        rank: int | None = None,
        ranks: int | None = None,
    ) -> None:
        """Takes a dataset with the choices of its `select`.

        Args:
          dataset: all of it; each worker and rank takes its part.
          size, seed, buffer: as for `Dataset.batches`. With a seed, epochs differ in their order.
          rank, ranks: the number of this process in a distributed run, from 0, and how many there
            are; by default those of `torch.distributed` where it is initialised.

        Raises:
          ValueError: a number is out of range.
        """
        super().__init__(dataset, seed, rank, ranks)
        self._size, self._buffer = size, buffer
        dataset.batches(size, seed=seed, buffer=buffer)  # it checks them

    def _read(self, part: Dataset, seed: int | None) -> Iterator[Batch]:
        return part.batches(self._size, seed=seed, buffer=self._buffer)


class Sequences(_Stream):
    """The batches of `Dataset.windows`, shared among workers and ranks."""

    def __init__(
        self,
        dataset: Dataset,
        length: int,
        stride: int = 1,
        pad: tuple[int, int] = (0, 0),
        *,
        size: int = 256,
        seed: int | None = None,
        buffer: int = 0,
        rank: int | None = None,
        ranks: int | None = None,
    ) -> None:
        """Takes a dataset with the choices of its `select`.

        Args:
          dataset, rank, ranks: as for `Batches`.
          length, stride, pad, size, seed, buffer: as for `Dataset.windows`.

        Raises:
          ValueError: a number is out of range, or no episode is long enough for a window.
        """
        super().__init__(dataset, seed, rank, ranks)
        self._form = (length, stride, pad)
        self._size, self._buffer = size, buffer
        dataset.windows(*self._form, size=size, seed=seed, buffer=buffer)  # it checks them

    def _read(self, part: Dataset, seed: int | None) -> Iterator[Windows]:
        if not part.count_windows(*self._form):
            return iter(())
        return part.windows(*self._form, size=self._size, seed=seed, buffer=self._buffer)
