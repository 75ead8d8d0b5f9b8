"""Datasets that several modules of tests read."""

from pathlib import Path

import pytest

from limberjack.data import Dataset, Kept, collect, load
from tests.plain_pictures import draw_without_shadows

from .collected import ARM, PENDULUM, copy, of_64, path_of
from .collected import damaged as damaged_content


@pytest.fixture(scope="session")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """70 episodes of 10 steps, in two files."""
    folder = tmp_path_factory.mktemp("pendulums")
    domain, task, seconds = PENDULUM
    how = {"time_limit": seconds, "num_threads": 1, "file_mb": of_64(PENDULUM)}
    collect(domain, task, "random", range(70), out=folder, **how)
    return load(folder)


@pytest.fixture(scope="session")
def arms(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Two episodes of 5 steps, with states, kinds of starts and model fields, in two files."""
    folder = tmp_path_factory.mktemp("arms")
    domain, task, seconds = ARM
    kept = Kept(states=True)
    seeds = range(63, 65)
    how = {"time_limit": seconds, "num_threads": 1, "file_mb": of_64(ARM, kept)}
    collect(domain, task, "random", seeds, out=folder, kept=kept, **how)
    return load(folder)


@pytest.fixture(autouse=True)
def _no_shadows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Films are of the episodes; shadows are tested with the renderer."""
    draw_without_shadows(monkeypatch)


@pytest.fixture
def damaged(pendulums: Dataset, tmp_path: Path) -> Path:
    """A copy of a dataset, a byte of whose first file has changed."""
    path = path_of(pendulums.shards[0])
    folder = copy(path.parents[1], tmp_path / "damaged")
    (folder / "episodes" / path.name).write_bytes(damaged_content(path.read_bytes()))
    return folder
