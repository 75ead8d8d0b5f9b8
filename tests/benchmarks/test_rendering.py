"""The rendering benchmark runs and reports its measurements; the figures are not tested."""

import importlib.util
import json
from typing import Any

import pytest

from tests.programs import run_benchmark

# It takes seconds, and shares its report and options with the one in test_suite_speed.py.
pytestmark = pytest.mark.slow

_HAS_DM_CONTROL = importlib.util.find_spec("dm_control") is not None


@pytest.fixture(scope="module")
def quick(pictures: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any]]:
    """The output of a quick run, and its JSON."""
    file = tmp_path_factory.mktemp("rendering") / "quick.json"
    done = run_benchmark("rendering.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    return done.stdout, json.loads(file.read_text(encoding="utf-8"))


def test_every_comparison_has_its_line_at_both_sizes(quick: tuple[str, dict[str, Any]]) -> None:
    found = {(row["measure"], row["subject"].split()[-1]) for row in quick[1]["rows"]}
    measures = ("render / mujoco.Renderer", "render / dm_control", "fast / full", "depth / colours")
    sizes = ("84x84", "480x640")
    wanted = {(measure, size) for measure in measures for size in sizes}
    assert found == wanted | {("batch / mujoco.Renderer", "84x84")}
    for measure, _ in found:
        assert measure in quick[0]


def test_each_comparison_is_a_ratio_with_its_bar(quick: tuple[str, dict[str, Any]]) -> None:
    bars = {
        (row["measure"], row["subject"].split()[-1]): row["bar"]["limit"]
        for row in quick[1]["rows"]
        if row["bar"] is not None
    }
    assert bars["render / mujoco.Renderer", "84x84"] == 0.95
    assert bars["render / mujoco.Renderer", "480x640"] == 0.95
    assert bars["render / dm_control", "84x84"] == 1.8
    assert bars["render / dm_control", "480x640"] == 1.0
    assert bars["batch / mujoco.Renderer", "84x84"] == 0.9
    for row in quick[1]["rows"]:
        if row["measure"] != "render / dm_control" or _HAS_DM_CONTROL:
            assert row["value"] == pytest.approx(row["ours"] / row["theirs"])
        else:
            assert row["is_met"] is None


def test_the_renderer_is_named(quick: tuple[str, dict[str, Any]]) -> None:
    renderer = quick[1]["settings"]["renderer"]
    assert f"drawn by {renderer}" in quick[0]
    assert quick[1]["settings"]["quick"] is True
