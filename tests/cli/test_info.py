"""`limberjack info`."""

import json
from pathlib import Path

import pytest

from limberjack.data import Kept, collect
from tests.episodes.collected import copy, damaged, hashes

from .conftest import invoke


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset with kinds of starts."""
    folder = tmp_path_factory.mktemp("info")
    kept = Kept(states=True)
    collect("stacker", "stack_2", "zero", range(3), out=folder, kept=kept, time_limit=0.05)
    return folder


def test_returns_sizes_versions_and_recipe_are_printed(folder: Path) -> None:
    result = invoke("info", str(folder))
    assert result.exit_code == 0, result.stderr
    for text in ("level_0", "stacker stack_2: 3 episodes of seeds 0 to 2", "pyarrow ", "states"):
        assert text in result.stdout


def test_json_has_the_hashes(folder: Path) -> None:
    found = json.loads(invoke("info", str(folder), "--json").stdout)
    assert found["sha256"] == hashes(folder)
    assert found["seeds"] == [0, 1, 2]
    assert found["returns"]["episodes"] == 3


def test_a_forged_file_is_one_line_and_status_2(folder: Path, tmp_path: Path) -> None:
    (path,) = copy(folder, tmp_path / "forged").glob("episodes/*")
    path.write_bytes(damaged(path.read_bytes()))
    for options, message in (([], "is damaged"), (["--verify"], "has another SHA-256 than in")):
        result = invoke("info", str(tmp_path / "forged"), *options)
        assert result.exit_code == 2
        assert result.stdout == ""
        assert result.stderr.startswith(f"limberjack: {path} {message}")
        assert result.stderr.count("\n") == 1


def test_hashes_are_compared_if_that_is_wanted(folder: Path) -> None:
    assert invoke("info", str(folder), "--verify").exit_code == 0
