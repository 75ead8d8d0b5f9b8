"""Which cost belongs to which task, and which files decide what the planner does."""

from types import SimpleNamespace

import pytest

from limberjack import suite
from limberjack.planner.library import cost_for, sources_for


def _names(domain: str, task: str) -> list[str]:
    return [file.stem for file in sources_for(suite.load(domain, task).task)]


def test_the_files_of_one_domain_do_not_depend_on_those_of_another() -> None:
    common = {"sampling", "servos", "tracking", "twin", "cost"}
    humanoid, stacker = _names("humanoid", "stand"), _names("stacker", "stack_2")
    assert set(humanoid) == {*common, "costs_humanoid"}
    arm = {"arm", "arm_ways", "box_grip", "boxes", "planar_ik", "unsticking"}
    assert set(stacker) == {*common, "costs_stacker", *arm}
    assert humanoid == sorted(humanoid)


def test_a_task_without_a_cost_is_told_what_to_write() -> None:
    for find in (cost_for, sources_for):
        with pytest.raises(ValueError, match="write a subclass of limberjack"):
            find(SimpleNamespace())
