"""The benchmark of the viewer runs and reports its measurements; the figures are not tested."""

import json
from pathlib import Path

import pytest

from tests.programs import run_benchmark

# Chromium draws some hundred pictures without a graphics card.
pytestmark = [pytest.mark.slow, pytest.mark.browser]

pytest.importorskip(
    "limberjack.viewer.studio", reason="MuJoCo Studio does not load here", exc_type=ImportError
)


def test_a_quick_run_does_what_a_person_does(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("viewer.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    rows = {row["measure"]: row for row in json.loads(file.read_text(encoding="utf-8"))["rows"]}
    assert sorted(rows) == [
        *("a frame of the page", "pause", "push", "reset", "run", "seed", "speed", "step")
    ]
    for name, row in rows.items():
        assert row["value"] > 0
        if row["bar"] is not None:
            assert row["bar"]["limit"] == 300, name
            assert row["theirs"] >= row["ours"]
