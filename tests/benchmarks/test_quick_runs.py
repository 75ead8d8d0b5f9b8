"""Each benchmark runs and reports its measurements with their bars; the figures are not tested."""

import importlib.util
import json
from pathlib import Path

import pytest

from tests.programs import report_without_places, run_benchmark

# They take seconds each, and share their report and options with the one that is not slow.
_NOT_SLOW = "suite_speed.py --without-peers --only batch --only size"

_HAS_DM_CONTROL = importlib.util.find_spec("dm_control") is not None
_READERS = {
    "buffer of a quarter": 0.4,
    "episodes": None,
    "float32, 5 steps, returns": 0.5,
    "transitions by number": None,
    "windows of 16": 0.5,
    "windows of 16, padded": 0.5,
    "windows of 16, stride 1": 0.5,
}
_ROWS = (1.6, 2.1, 2.0, 5.5)
_SIZES = "84x84", "480x640"

# By the command: each row of the report, its measure and the limit of its bar.
_RUNS: dict[str, list[tuple[str, float | None]]] = {
    "collecting.py": [("collect / evaluate", 0.8), ("read / evaluate", 5.0)] * 2,
    "many.py": [
        ("processor seconds to make", 4.5),
        ("peak megabytes when made", 750.0),
        ("peak megabytes after a step", None),
        ("threads more", 8.0),
        ("speed of many / separate", 0.95),
    ],
    "path_searches.py": [
        ("path search, median", None),
        ("path search, 99th percentile", 100),
        ("path search, worst", 300),
    ],
    "reading.py": [
        *[("batches over loopback / batches", 0.7)] * 2,
        *((f"{name} / batches", limit) for name, limit in _READERS.items() for _ in range(2)),
    ],
    "rows.py": [
        *(("rows / vectorised", limit) for limit in _ROWS),
        *[("rows / AsyncVectorEnv", 0.6)] * 4,
    ],
    "scaling.py --only random": [("random, {cores} workers / one process", 1.15)],
    "steps_per_second.py --without-peers --threads 2": [
        ("batch / MuJoCo alone", 0.9),
        ("batch / not persistent", None),
        ("vector / MuJoCo alone", 0.88),
        ("vector / not persistent", None),
        ("reset of all / episode", 2),
        ("2 threads / 1", 1.8),
        ("memory of one more row", 0.3),
        ("two halves / plain loop", 1.6),
    ],
    _NOT_SLOW: [("batch / bare Batch", 0.65), ("lines", 2000), ("lines", 2000)],
    "suite_speed.py --without-peers --only single": [
        ("steps per second", 1.1),
        ("steps per second", 1.3),
    ],
    "suite_speed.py --without-peers --only load": [("load / compile", 1.2), ("second load", 10)],
    "suite_speed.py --without-peers --only memory": [("memory", 800), ("memory", 400)],
    "writing.py": [("a unit", 2.0), ("planning", 10.0), ("planning", 10.0), ("footer", 5.0)],
}


def _quick(command: str, file: Path) -> tuple[str, str]:
    """The output of a quick run, and the text of its JSON."""
    script, *options = command.split()
    done = run_benchmark(script, *options, "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert "quick: the figures mean nothing" in done.stdout
    return done.stdout, file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "command",
    [pytest.param(one, marks=() if one == _NOT_SLOW else pytest.mark.slow) for one in _RUNS],
)
def test_a_quick_run_reports_every_measure_with_its_bar(command: str, tmp_path: Path) -> None:
    table, text = _quick(command, tmp_path / "results" / "quick.json")
    report = report_without_places(text)
    assert report["settings"]["quick"] is True
    cores = report["machine"]["usable_cores"]
    expected = [(measure.format(cores=cores), limit) for measure, limit in _RUNS[command]]
    rows = report["rows"]
    assert [(row["measure"], row["bar"] and row["bar"]["limit"]) for row in rows] == expected
    for row in rows:
        assert row["value"] is None or row["value"] > 0
        assert row["ours"] > 0
        assert row["measure"] in table


@pytest.mark.slow
@pytest.mark.usefixtures("pictures")
def test_pictures_are_compared_at_both_sizes_and_the_renderer_is_named(tmp_path: Path) -> None:
    table, text = _quick("rendering.py", tmp_path / "quick.json")
    report = json.loads(text)
    assert f"drawn by {report['settings']['renderer']}" in table
    rows = {(row["measure"], row["subject"].split()[-1]): row for row in report["rows"]}
    measures = ("render / mujoco.Renderer", "render / dm_control", "fast / full", "depth / colours")
    assert rows.keys() == {
        *((measure, size) for measure in measures for size in _SIZES),
        ("batch / mujoco.Renderer", "84x84"),
        *(("batch / loop", quality) for quality in ("fast", "full")),
    }
    limits = {key: row["bar"]["limit"] for key, row in rows.items() if row["bar"] is not None}
    assert limits["render / mujoco.Renderer", "480x640"] == 0.95
    assert [limits["render / dm_control", size] for size in _SIZES] == [1.8, 1.0]
    assert limits["batch / mujoco.Renderer", "84x84"] == 0.9
    for (measure, _), row in rows.items():
        has_value = measure != "render / dm_control" or _HAS_DM_CONTROL
        assert (row["value"] is not None) is has_value
