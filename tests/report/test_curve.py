"""The picture of many returns."""

import sys
from pathlib import Path

import pytest

from limberjack.report import write_distribution_plot

_POLICIES = {"mine": [1.0, 5.0, 3.0], "zero": [0.0, 0.0, 2.0]}


def _size(path: Path) -> tuple[int, int]:
    header = path.read_bytes()[:24]
    assert header.startswith(b"\x89PNG")
    return int.from_bytes(header[16:20], "big"), int.from_bytes(header[20:24], "big")


def test_returns_are_drawn_by_policy_and_by_start(tmp_path: Path) -> None:
    one, two = tmp_path / "one.png", tmp_path / "two.png"
    write_distribution_plot(one, "A task", _POLICIES, {"all": [1.0, 5.0, 3.0]})
    write_distribution_plot(two, "A task", _POLICIES, {"low": [1.0], "high": [5.0, 3.0]})
    assert _size(one) == _size(two) == (960, 600)
    assert one.read_bytes() != two.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.png", "two.png"]


def test_without_matplotlib_the_error_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"needs the extra 'video': pip install"):
        write_distribution_plot(tmp_path / "plot.png", "A task", _POLICIES, {})
    assert list(tmp_path.iterdir()) == []
