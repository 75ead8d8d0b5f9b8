"""Results name the sources that they depend on."""

import json
import shutil
from pathlib import Path

import pytest
import sources


def test_every_result_lists_its_sources() -> None:
    ledger = json.loads((sources.RESULTS / "sources.json").read_text(encoding="utf-8"))
    assert sorted(ledger) == sources.names()
    for name, entry in ledger.items():
        assert entry["parts"] == sources.parts_of(name)


def test_every_part_is_there() -> None:
    for name in sources.names():
        for part in sources.parts_of(name):
            assert list(sources._PACKAGE.glob(part)), f"{name}: {part}"


def test_a_result_is_older_once_one_of_its_sources_changes(tmp_path: Path) -> None:
    package, results = tmp_path / "package", tmp_path / "results"
    shutil.copytree(sources._PACKAGE, package, ignore=shutil.ignore_patterns("*.pyc"))
    for name in ("scores/walker-walk-planner.json", "suite_speed.json"):
        path = results / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("{}")
        sources.record(name, results, package)
    assert sources.outdated(results, package) == []
    for changed, older in (
        ("gym/vector.py", []),
        ("suite/humanoid.py", ["suite_speed.json"]),
        ("planner/cost.py", ["scores/walker-walk-planner.json", "suite_speed.json"]),
    ):
        (package / changed).write_text("pass\n")
        assert sources.outdated(results, package) == older


def test_a_new_file_needs_an_entry_in_the_table() -> None:
    with pytest.raises(KeyError, match="name the parts that it depends on"):
        sources.parts_of("unheard_of.json")
