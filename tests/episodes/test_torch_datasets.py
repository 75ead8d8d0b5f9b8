"""Loaders of PyTorch with any number of workers and ranks give every transition once."""

import itertools
import multiprocessing
import os
import pickle
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.data import Dataset, Kept, Pixels, collect, load

from .collected import PENDULUM, folder_of

torch: Any = pytest.importorskip("torch", reason="needs the extra 'torch'")
torch_datasets: Any = pytest.importorskip("limberjack.episodes.torch_datasets")

# On machines with fewer cores than the loaders have workers.
pytestmark = pytest.mark.filterwarnings("ignore:This DataLoader will create")

DataLoader = torch.utils.data.DataLoader

_FORM = (4, 3, (1, 2))


def _actions(samples: Iterable[dict[str, Any]]) -> np.ndarray:
    found = [sample["actions"].numpy() for sample in samples]
    return np.concatenate([np.zeros((0, 1)), *found])


def _sorted(values: np.ndarray) -> np.ndarray:
    return np.sort(values.ravel())


@pytest.fixture(scope="module")
def actions(pendulums: Dataset) -> np.ndarray:
    """Those of all transitions, which differ."""
    found = np.concatenate([episode.actions for episode in pendulums])
    assert len(np.unique(found)) == len(found) == 700
    return found


def test_tensors_share_the_memory_of_the_arrays(pendulums: Dataset) -> None:
    batch = next(pendulums.select(discount=0.9).batches(10))
    found = torch_datasets.tensors(batch)
    assert list(found) == [
        "observations", "actions", "rewards", "next_observations", "terminated", "truncated",
        "discounts", "returns_to_go",
    ]  # fmt: skip
    batch.actions[3] = 7
    batch.observations["velocity"][2] = 8
    assert found["actions"][3] == 7
    assert found["observations"]["velocity"][2] == 8
    assert found["terminated"].dtype == torch.bool
    assert found["rewards"].dtype == torch.float64
    windows = torch_datasets.tensors(next(pendulums.select(float32=True).windows(3)))
    assert "returns_to_go" not in windows
    assert windows["mask"].shape == (256, 3)
    assert windows["rewards"].dtype == torch.float32


@pytest.mark.usefixtures("pictures")
def test_loaders_give_pictures_as_bytes(tmp_path: Path) -> None:
    kept = Kept(pixels=Pixels(height=12, width=16, quality="fast"))
    collect(*PENDULUM[:2], "random", range(3), out=tmp_path, kept=kept, time_limit=0.2)
    dataset = load(tmp_path)
    before, after = (
        np.concatenate([episode.observations["pixels"][rows] for episode in dataset])
        for rows in (slice(None, -1), slice(1, None))
    )
    assert len(np.unique(before, axis=0)) > 20
    chosen = dataset.select(float32=True)  # of numbers
    for workers in (0, 2):
        loader = DataLoader(torch_datasets.Batches(chosen, 4), batch_size=None, num_workers=workers)
        batches = list(loader)
        found = [batch["observations"]["pixels"] for batch in batches]
        assert {pixels.dtype for pixels in found} == {torch.uint8}
        assert sum(map(len, found)) == 30
        _assert_same_pictures(torch.cat(found), before)
        following = torch.cat([batch["next_observations"]["pixels"] for batch in batches])
        _assert_same_pictures(following, after)
    windows = torch_datasets.Sequences(dataset, 5, 5)
    (batch,) = DataLoader(windows, batch_size=None)
    assert batch["observations"]["pixels"].shape == (6, 6, 12, 16, 3)
    np.testing.assert_array_equal(
        batch["observations"]["pixels"][:, :-1].reshape(before.shape), before
    )
    loader = DataLoader(torch_datasets.Transitions(dataset), batch_size=30)
    (batch,) = loader
    np.testing.assert_array_equal(batch["observations"]["pixels"], before)


def _assert_same_pictures(found: Any, expected: np.ndarray) -> None:
    """Compares pictures in any order."""
    ours, theirs = (np.sort([one.tobytes() for one in part]) for part in (found.numpy(), expected))
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_loader_gives_every_transition_by_its_number_once(
    workers: int, pendulums: Dataset, actions: np.ndarray
) -> None:
    dataset = torch_datasets.Transitions(pendulums.select(["velocity"], float32=True))
    assert len(dataset) == 700
    loader = DataLoader(dataset, batch_size=64, shuffle=True, num_workers=workers)
    found = _actions(loader)
    assert (found.ravel() != actions.astype(np.float32).ravel()).any()
    np.testing.assert_array_equal(_sorted(found), _sorted(actions.astype(np.float32)))


def test_a_transition_and_a_batch_of_them_are_found_by_number(pendulums: Dataset) -> None:
    dataset = torch_datasets.Transitions(pendulums)
    one, some = dataset[65], dataset[[65, 3]]
    assert one["actions"].shape == (1,)
    assert one["rewards"].shape == ()
    assert some["observations"]["velocity"].shape == (2, 1)
    assert one["actions"].item() == some["actions"][0].item() == pendulums[6].actions[5].item()
    (again, _) = dataset.__getitems__([65, 3])
    assert again["next_observations"]["velocity"] == some["next_observations"]["velocity"][0]
    with pytest.raises(IndexError, match="index 700 is out of range"):
        dataset[700]
    with pytest.raises(TypeError, match="'float' object cannot be interpreted as an integer"):
        dataset[1.5]  # pyright: ignore[reportArgumentType]
    sampler = torch.utils.data.BatchSampler(range(700), 256, drop_last=False)
    sizes = [len(s["rewards"]) for s in DataLoader(dataset, batch_size=None, sampler=sampler)]
    assert sizes == [256, 256, 188]


@pytest.mark.parametrize(("workers", "ranks"), [(0, 1), (0, 3), (3, 1), (2, 2)])
def test_all_workers_and_ranks_give_every_transition_once(
    workers: int, ranks: int, pendulums: Dataset, actions: np.ndarray
) -> None:
    found = [
        _actions(
            DataLoader(
                torch_datasets.Batches(pendulums, 64, seed=1, buffer=50, rank=rank, ranks=ranks),
                batch_size=None,
                num_workers=workers,
            )
        )
        for rank in range(ranks)
    ]
    np.testing.assert_array_equal(_sorted(np.concatenate(found)), _sorted(actions))


def test_all_workers_and_ranks_give_every_window_once(pendulums: Dataset) -> None:
    found = [
        key
        for rank in range(2)
        for sample in DataLoader(
            torch_datasets.Sequences(pendulums, *_FORM, size=32, seed=1, rank=rank, ranks=2),
            batch_size=None,
            num_workers=2,
        )
        for key in zip(sample["seeds"].tolist(), sample["steps"].tolist(), strict=True)
    ]
    whole = [
        key
        for windows in pendulums.windows(*_FORM)
        for key in zip(windows.seeds.tolist(), windows.steps.tolist(), strict=True)
    ]
    assert sorted(found) == whole


def test_an_epoch_has_an_order_of_its_own_in_workers_that_live_on(pendulums: Dataset) -> None:
    batches = torch_datasets.Batches(pendulums, 64, seed=1)
    loader = DataLoader(batches, batch_size=None, num_workers=1, persistent_workers=True)
    orders = []
    for epoch in (0, 1, 0):
        batches.set_epoch(epoch)
        orders.append(_actions(loader))
        np.testing.assert_array_equal(orders[-1], _actions(batches))  # as in this process
    assert (orders[0] != orders[1]).any()
    np.testing.assert_array_equal(orders[0], orders[2])
    other = torch_datasets.Batches(pendulums, 64, seed=2)
    assert (_actions(other) != orders[0]).any()
    recorded = _actions(torch_datasets.Batches(pendulums, 64))
    np.testing.assert_array_equal(recorded, _actions(torch_datasets.Batches(pendulums, 700)))


def test_more_workers_than_episodes_read_each_once(pendulums: Dataset) -> None:
    three = pendulums.part(0, 23).part(0, 1)
    assert len(three) == 3
    found = [_actions(torch_datasets.Batches(three, 64, rank=rank, ranks=5)) for rank in range(5)]
    assert [len(part) for part in found] == [10, 10, 10, 0, 0]
    np.testing.assert_array_equal(
        np.concatenate(found), np.concatenate([episode.actions for episode in three])
    )


def test_a_part_without_windows_gives_none(mixed: Dataset) -> None:
    lengths = [
        sum(len(sample["mask"]) for sample in torch_datasets.Sequences(mixed, 8, rank=k, ranks=2))
        for k in range(2)
    ]
    assert lengths == [0, 3]


@pytest.fixture
def mixed(pendulums: Dataset, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """Two episodes, of which the first one is said to have five steps."""
    two = pendulums.part(0, 35)
    monkeypatch.setattr(two.shards[0], "lengths", [5, *two.shards[0].lengths[1:]])
    assert (len(two), two.lengths) == (2, [5, 10])
    return two


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"size": 0}, "size is 0"),
        ({"buffer": 3}, "buffer is 3, and there is no seed"),
        ({"rank": 2, "ranks": 2}, "rank is 2 of 2; expected both, rank from 0 to ranks - 1"),
        ({"rank": 0}, "rank is 0 of None; expected both"),
    ],
)
def test_bad_arguments_are_refused_at_once(
    choices: dict[str, int], message: str, pendulums: Dataset
) -> None:
    with pytest.raises(ValueError, match=message):
        torch_datasets.Batches(pendulums, **{"size": 3, **choices})
    with pytest.raises(ValueError, match="length is 11; expected at most 10"):
        torch_datasets.Sequences(pendulums, 11)


def test_a_dataset_can_be_sent_to_workers_that_are_started_afresh(pendulums: Dataset) -> None:
    copy = pickle.loads(pickle.dumps(torch_datasets.Transitions(pendulums)))
    assert copy[3]["actions"] == torch_datasets.Transitions(pendulums)[3]["actions"]


def _run_rank(rank: int, folder: Path, queue: Any) -> None:
    """A process of a distributed run, with a loader of two workers."""
    torch.distributed.init_process_group(
        "gloo", init_method=f"file://{folder / 'ranks'}", rank=rank, world_size=2
    )
    batches = torch_datasets.Batches(load(folder / "data"), 64, seed=1)
    loader = DataLoader(batches, batch_size=None, num_workers=2)
    queue.put(_actions(loader))
    torch.distributed.destroy_process_group()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork processes")
def test_the_processes_of_a_distributed_run_give_every_transition_once(
    pendulums: Dataset, actions: np.ndarray, tmp_path: Path
) -> None:
    (tmp_path / "data").symlink_to(folder_of(pendulums))
    # Forked, as a loader's workers are on Linux: importing PyTorch again takes ten seconds.
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    ranks = [context.Process(target=_run_rank, args=(k, tmp_path, queue)) for k in range(2)]
    for process in ranks:
        process.start()
    found = [queue.get(timeout=120) for _ in ranks]
    for process in ranks:
        process.join(timeout=60)
        assert process.exitcode == 0
    assert [len(part) for part in found] == [350, 350]
    np.testing.assert_array_equal(
        _sorted(np.array(list(itertools.chain(*found)))), _sorted(actions)
    )
