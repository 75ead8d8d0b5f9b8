"""Datasets as episodes, and as batches of transitions."""

from pathlib import Path

import numpy as np
import pytest

from limberjack.data import Batch, Dataset, load
from limberjack.episodes.parquet import Shard

from .collected import assert_equal


def test_episodes_come_in_the_order_of_their_seeds(pendulums: Dataset) -> None:
    assert len(pendulums) == 70
    assert pendulums.steps == 700
    assert pendulums.seeds == list(range(70)) == [episode.seed for episode in pendulums]
    assert_equal(pendulums.episode(66), list(pendulums)[66])
    with pytest.raises(KeyError, match="no episode of seed 70; the first one has seed 0"):
        pendulums.episode(70)


def _all(batches: list[Batch], name: str) -> np.ndarray:
    parts = [getattr(batch, name) for batch in batches]
    return np.concatenate([p["velocity"] if isinstance(p, dict) else p for p in parts])


@pytest.mark.parametrize("size", [1, 37, 640, 700, 1000])
def test_batches_in_order_have_every_transition_once(size: int, pendulums: Dataset) -> None:
    batches = list(pendulums.batches(size))
    assert [len(batch) for batch in batches[:-1]] == [size] * (len(batches) - 1)
    assert sum(map(len, batches)) == 700
    episodes = list(pendulums)
    observed = [episode.observations["velocity"] for episode in episodes]
    np.testing.assert_array_equal(
        _all(batches, "observations"), np.concatenate([v[:-1] for v in observed])
    )
    np.testing.assert_array_equal(
        _all(batches, "next_observations"), np.concatenate([v[1:] for v in observed])
    )
    for name in ("actions", "rewards", "terminated", "truncated"):
        expected = np.concatenate([getattr(episode, name) for episode in episodes])
        np.testing.assert_array_equal(_all(batches, name), expected)


def test_shuffled_batches_have_the_same_transitions_in_another_order(pendulums: Dataset) -> None:
    ordered = _all(list(pendulums.batches(50)), "actions")
    once, again, other = (
        _all(list(pendulums.batches(50, seed=seed)), "actions") for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(once, again)
    assert (once != other).any()
    assert (once != ordered).any()
    np.testing.assert_array_equal(np.sort(once, axis=0), np.sort(ordered, axis=0))


def test_a_batch_may_be_changed_and_an_episode_may_not(pendulums: Dataset) -> None:
    batch = next(pendulums.batches(10))
    batch.observations["velocity"][:] = 0
    batch.actions[:] = 0
    with pytest.raises(ValueError, match="read-only"):
        pendulums.episode(0).rewards[:] = 0


def test_files_are_read_when_they_are_needed(
    pendulums: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []
    read = Shard.opened

    def counting(shard: Shard) -> object:
        opened.append(shard.path)
        return read(shard)

    monkeypatch.setattr(Shard, "opened", counting)
    dataset = load(pendulums.shards[0].path.parent)
    assert opened == []
    next(iter(dataset))
    next(dataset.batches(10))
    assert opened == [dataset.shards[0].path] * 2


def test_parts_have_every_file_once(pendulums: Dataset) -> None:
    parts = [pendulums.part(k, 2) for k in range(2)]
    assert sorted(seed for part in parts for seed in part.seeds) == pendulums.seeds
    for k, n in ((2, 3), (-1, 2), (3, 3)):
        with pytest.raises(ValueError, match=f"there is no part {k} of {n} in 2 files"):
            pendulums.part(k, n)


@pytest.mark.parametrize("size", [0, -1, 2.5])
def test_a_batch_has_at_least_one_transition(size: int, pendulums: Dataset) -> None:
    with pytest.raises(ValueError, match="size is"):
        next(pendulums.batches(size))


def test_a_folder_without_a_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="has no complete file of a dataset"):
        load(tmp_path)
    with pytest.raises(ValueError, match="is no folder; expected one that"):
        load(tmp_path / "missing")


def test_damaged_data_is_an_error_that_names_the_file(damaged: Path) -> None:
    with pytest.raises(ValueError, match=r"seeds-0000000000-0000000064.parquet is damaged"):
        list(load(damaged))
