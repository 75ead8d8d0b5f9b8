"""Datasets that several modules of tests read."""

from pathlib import Path

import pytest

from limberjack.data import Dataset, Kept, collect, load

from .collected import ARM, PENDULUM


@pytest.fixture(scope="session")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """70 episodes of 10 steps, in two files."""
    folder = tmp_path_factory.mktemp("pendulums")
    domain, task, seconds = PENDULUM
    collect(domain, task, "random", range(70), out=folder, time_limit=seconds, num_threads=1)
    return load(folder)


@pytest.fixture(scope="session")
def arms(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Two episodes of 5 steps, with states, kinds of starts and model fields, in two files."""
    folder = tmp_path_factory.mktemp("arms")
    domain, task, seconds = ARM
    kept = Kept(states=True)
    seeds = range(63, 65)
    collect(domain, task, "random", seeds, out=folder, kept=kept, time_limit=seconds, num_threads=1)
    return load(folder)


@pytest.fixture
def damaged(pendulums: Dataset, tmp_path: Path) -> Path:
    """A folder with one file, a byte of whose data has changed."""
    path = pendulums.shards[0].path
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    (tmp_path / path.name).write_bytes(content)
    return tmp_path
