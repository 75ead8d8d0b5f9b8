"""A benchmark ends with its table, the bars it missed, a file, and an exit status."""

import importlib
import json
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def report(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module, which the benchmarks import from their own folder."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    return importlib.import_module("report")


@pytest.mark.parametrize(
    ("value", "quick", "status", "told"),
    [
        (2.0, False, 0, "1 of 1 bars met"),
        (0.5, False, 1, "0 of 1 bars met\nmissed: speed, walk"),
        (0.5, True, 0, "quick: the figures mean nothing"),
        (None, False, 0, "0 of 1 bars met\n1 not measured"),
    ],
)
def test_a_missed_bar_is_named_and_is_the_exit_status(
    report: Any,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    value: float | None,
    quick: bool,
    status: int,
    told: str,
) -> None:
    rows = [report.Row("speed", "walk", value, 1.0, "steps", value, bar=report.at_least(1.0))]
    with pytest.raises(SystemExit) as ended:
        report.finish(rows, "peer", quick, tmp_path / "new" / "file.json", {"rounds": 3})
    assert ended.value.code == status
    assert told in capsys.readouterr().out
    document = json.loads((tmp_path / "new" / "file.json").read_text(encoding="utf-8"))
    assert document["settings"] == {"quick": quick, "rounds": 3}
    assert [row["value"] for row in document["rows"]] == [value]
