"""Planting faults: caught, missed, stale and broken ones."""

from pathlib import Path
from typing import Any

import plant_faults as tool
import pytest

from limberjack import __file__ as _package

_REPOSITORY = Path(__file__).parents[2]
_SOURCE = "def double(x):\n    unused = 0\n    return 2 * x\n"
_TEST = """
from limberjack.sums.double import double

def test_three_doubled_is_six():
    assert double(3) == 6
"""
_ALWAYS = "def test_nothing_is_true():\n    assert False\n"


@pytest.fixture
def copy(tmp_path: Path) -> Any:
    """A copy of a small repository with a package of the same name as this one."""
    small = tmp_path / "small"
    for name, text in (
        ("src/limberjack/__init__.py", ""),
        ("src/limberjack/sums/__init__.py", ""),
        ("src/limberjack/sums/double.py", _SOURCE),
        ("tests/sums/test_double.py", _TEST),
        ("pytest.ini", "[pytest]\n"),
    ):
        (small / name).parent.mkdir(parents=True, exist_ok=True)
        (small / name).write_text(text, encoding="utf-8")
    (tmp_path / "copy").mkdir()
    return tool.Copy(tmp_path / "copy", small)


def _planted(copy: Any, old: str, new: str) -> tuple[str, str]:
    return copy.verdict(tool.Fault("sums/double.py", old, new))


def test_a_fault_that_a_test_notices_is_caught_by_name(copy: Any) -> None:
    kind, why = _planted(copy, "2 * x", "2 + x")
    assert (kind, why) == (tool.CAUGHT, "tests/sums/test_double.py::test_three_doubled_is_six")


def test_a_fault_that_no_test_notices_is_missed(copy: Any) -> None:
    assert _planted(copy, "unused = 0", "unused = 1")[0] == tool.MISSED


@pytest.mark.parametrize(("old", "count"), [("3 * x", 0), ("x", 2)])
def test_a_text_that_does_not_occur_exactly_once_is_stale(copy: Any, old: str, count: int) -> None:
    kind, why = _planted(copy, old, "y")
    assert kind == tool.STALE
    assert f"{count} times" in why


def test_a_missing_file_is_stale(copy: Any) -> None:
    assert copy.verdict(tool.Fault("sums/treble.py", "x", "y"))[0] == tool.STALE


def test_a_fault_with_which_nothing_can_be_imported_is_broken(copy: Any) -> None:
    assert _planted(copy, "2 * x", "2 *")[0] == tool.BROKEN


def test_a_test_that_also_fails_without_the_fault_is_broken(copy: Any) -> None:
    (copy.folder / "tests" / "sums" / "test_broken.py").write_text(_ALWAYS, encoding="utf-8")
    kind, why = _planted(copy, "unused = 0", "unused = 1")
    assert kind == tool.BROKEN
    assert "fails without the fault too" in why


def test_the_source_is_as_it_was_afterwards(copy: Any) -> None:
    _planted(copy, "2 * x", "2 + x")
    planted = copy.folder / "src" / "limberjack" / "sums" / "double.py"
    assert planted.read_text(encoding="utf-8") == _SOURCE


def test_there_are_faults_in_every_part_and_each_changes_something() -> None:
    faults = tool.listed([])
    parts = {Path(fault.file).parts[0] for fault in faults}
    assert {"rl", "mujoco", "gym", "utils", "evaluation", "suite"} <= parts
    assert len(set(faults)) == len(faults) >= 40
    for fault in faults:
        assert fault.old != fault.new, fault
        assert tool.part_of(fault.file, _REPOSITORY), fault
    assert tool.listed(["rl/batch.py"]) == [f for f in faults if f.file == "rl/batch.py"]


def test_no_fault_is_stale() -> None:
    sources = {fault.file: Path(_package).parent / fault.file for fault in tool.listed([])}
    for fault in tool.listed([]):
        assert tool.planted(sources[fault.file].read_text(encoding="utf-8"), fault), fault
