"""A benchmark ends with its table, the bars it missed, a file, and an exit status."""

import json
from pathlib import Path

import pytest
import report


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


def test_two_quantities_are_compared_round_by_round() -> None:
    ours, theirs = report.rates([0.5, 1.0, 0.25], work=2), [2.0, 1.0, 2.0]
    row = report.compared("speed", "walk", ours, theirs, "/s", report.at_least(2.0), {"rows": 3})
    assert (row.ours, row.theirs, row.value, row.is_met) == (4.0, 2.0, 2.0, True)
    assert row.details["rows"] == row.details["ratio"]["count"] == 3
    alone = report.compared("speed", "walk", ours, [], "/s", report.at_least(2.0))
    assert (alone.ours, alone.theirs, alone.value, alone.is_met) == (4.0, None, None, None)


def test_a_mean_is_geometric_and_needs_a_value_of_each_row() -> None:
    rows = [report.compared("speed", name, [x], [1.0], "/s") for name, x in (("a", 2), ("b", 8))]
    mean = report.mean_of(rows, "geometric mean", report.at_most(3))
    assert (mean.measure, mean.unit, mean.is_met) == ("speed", "/s", False)
    assert (mean.ours, mean.theirs, mean.value) == pytest.approx((4.0, 1.0, 4.0))
    unmeasured = report.compared("speed", "c", [2.0], [], "/s")
    assert report.mean_of([*rows, unmeasured], "geometric mean").value is None
