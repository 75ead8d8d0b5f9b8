"""The stages of the stacker's tasks, each reached by a planted scene, and their costs."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner.stacker.box_grip import HIGH
from limberjack.planner.stacker.stack import Stack, Stage
from limberjack.planner.stacker.tower import ALOFT, HALF

from .scenes import TOP, place_boxes, point_hand, scene

_AROUND = np.radians(24.0)  # by which fingers around a box have closed
_HELD = (0.2, 0.1)  # x and z of a box that is lifted
_BELOW_HAND = _HELD[1] + HIGH  # height of the hand that holds it


def _updated(places: list[tuple[float, float]], **of_scene: Any) -> tuple[Stack, Any]:
    """A cost after one planning step in a scene, and its physics."""
    task, physics = scene(places, **of_scene)
    cost = Stack(task)
    cost.update(physics)
    return cost, physics


def _holding() -> tuple[Stack, Any]:
    """The hand has taken box0 for the place on box1, which stands."""
    task, physics = scene([_HELD, (0.0, HALF)])
    point_hand(physics, _HELD[0], _BELOW_HAND, _AROUND)
    cost = Stack(task)
    cost.update(physics)
    return cost, physics


def _after(cost: Stack, physics: Any, plannings: int) -> Stage:
    for _ in range(plannings):
        cost.update(physics)
    return cost.stage()[0]


def test_boxes_on_the_floor_are_fetched() -> None:
    cost, _ = _updated([(0.3, HALF), (0.2, HALF)])
    assert cost.stage()[:3] == (Stage.FETCH, "box1", 0)


@pytest.mark.parametrize(("seconds", "stage"), [(0.1, Stage.DODGE), (1.0, Stage.FETCH)])
def test_the_arm_dodges_boxes_that_are_aloft_in_the_first_moments(
    seconds: float, stage: Stage
) -> None:
    cost, physics = _updated([(0.3, 0.5), (0.2, HALF)], seconds=seconds)
    assert cost.stage()[0] is stage
    place_boxes(physics, [(0.3, HALF)])
    assert _after(cost, physics, 1) is Stage.FETCH


def test_a_box_that_is_held_is_carried_until_it_is_lost() -> None:
    cost, physics = _holding()
    assert cost.stage()[:3] == (Stage.CARRY, "box0", 1)
    place_boxes(physics, [(_HELD[0], _HELD[1] - 0.038)])  # it creeps out of the hand
    assert _after(cost, physics, 1) is Stage.CARRY
    place_boxes(physics, [(_HELD[0], _HELD[1] - 0.06)])
    assert _after(cost, physics, 1) is Stage.FETCH
    place_boxes(physics, [(_HELD[0], _HELD[1] - 0.038)])  # held too badly to be taken
    assert _after(cost, physics, 1) is Stage.FETCH


def test_a_box_must_be_held_better_to_be_taken_than_to_be_kept() -> None:
    for lower, stage in ((0.002, Stage.CARRY), (0.0105, Stage.FETCH)):
        task, physics = scene([(_HELD[0], _HELD[1] - lower), (0.0, HALF)])
        point_hand(physics, _HELD[0], _BELOW_HAND, _AROUND)
        assert _after(Stack(task), physics, 1) is stage
    cost, physics = _holding()
    place_boxes(physics, [(_HELD[0], _HELD[1] - 0.0105)])
    assert _after(cost, physics, 1) is Stage.CARRY


def test_a_box_is_carried_with_finer_variations() -> None:
    cost, physics = _holding()
    assert cost.noise_scale < 1.0
    place_boxes(physics, [(0.3, HALF)])
    cost.update(physics)
    assert cost.noise_scale == 1.0


def test_the_hand_leaves_a_tower_that_stands_until_it_falls() -> None:
    cost, physics = _updated([(0.0, TOP), (0.0, HALF)])
    assert cost.stage()[:3] == (Stage.LEAVE, None, 2)
    assert cost.noise_scale == 1.0
    place_boxes(physics, [(0.2, HALF)])
    assert _after(cost, physics, 1) is Stage.FETCH


def test_the_arm_shakes_off_a_box_that_stays_aloft_beside_the_tower() -> None:
    aloft = ALOFT + 0.05
    cost, physics = _updated([(0.3, aloft), (0.2, HALF)])
    assert _after(cost, physics, 13) is Stage.FETCH
    assert _after(cost, physics, 1) is Stage.SHAKE
    place_boxes(physics, [(0.3, HALF)])
    assert _after(cost, physics, 1) is Stage.FETCH
    place_boxes(physics, [(0.3, aloft)])  # the count begins again
    assert _after(cost, physics, 4) is Stage.FETCH


def test_a_tilted_box_leans_on_the_arm_and_a_flat_one_of_that_height_does_not() -> None:
    for angle, stage in ((0.5, Stage.SHAKE), (0.0, Stage.FETCH)):
        cost, physics = _updated([(0.3, TOP), (0.2, HALF)])
        place_boxes(physics, [(0.3, TOP)], angle)
        assert _after(cost, physics, 15) is stage


def test_without_progress_the_arm_retreats_and_then_takes_another_box() -> None:
    cost, physics = _updated([(0.3, HALF), (0.2, HALF)])
    assert _after(cost, physics, 19) is Stage.FETCH
    assert _after(cost, physics, 1) is Stage.RETREAT
    assert cost.stage()[1] == "box1"
    assert _after(cost, physics, 11) is Stage.RETREAT
    assert _after(cost, physics, 1) is Stage.FETCH
    assert cost.stage()[1] == "box0"


def test_a_hand_that_comes_nearer_is_given_time() -> None:
    cost, physics = _updated([(0.3, HALF), (0.2, HALF)])
    for height in (0.3, 0.2, 0.12, 0.07):
        point_hand(physics, 0.2, height)
        assert _after(cost, physics, 15) is Stage.FETCH


def test_patience_begins_again_with_another_goal_and_after_a_retreat() -> None:
    cost, physics = _updated([(0.3, HALF), (0.2, HALF)])
    assert _after(cost, physics, 15) is Stage.FETCH
    place_boxes(physics, [(0.0, HALF)])  # it stands: box1 comes onto it
    assert _after(cost, physics, 20) is Stage.FETCH
    assert _after(cost, physics, 1) is Stage.RETREAT
    # It waits in the meantime.
    assert [_after(cost, physics, 1) for _ in range(20)] == [Stage.RETREAT] * 11 + [Stage.FETCH] * 9
    assert _after(cost, physics, 1) is Stage.RETREAT


def test_a_tower_that_stands_ends_a_retreat() -> None:
    cost, physics = _updated([(0.3, HALF), (0.0, HALF)])
    assert _after(cost, physics, 20) is Stage.RETREAT
    place_boxes(physics, [(0.0, TOP)])
    assert _after(cost, physics, 1) is Stage.LEAVE
    place_boxes(physics, [(0.3, HALF)])
    assert _after(cost, physics, 1) is Stage.FETCH


def test_an_episode_begins_without_stages_of_the_last() -> None:
    cost, physics = _updated([(0.3, HALF), (0.2, HALF)])
    assert _after(cost, physics, 20) is Stage.RETREAT
    cost.reset()
    assert _after(cost, physics, 1) is Stage.FETCH


_OWN_TERMS = {
    Stage.LEAVE: {"hand at the target"},
    Stage.DODGE: {"falling boxes"},
    Stage.RETREAT: {"retreat"},
    Stage.SHAKE: {"boxes on the arm"},
    Stage.CARRY: {"carry", "fetch"},
    Stage.FETCH: {"carry", "fetch"},
}
_COMMON_TERMS = {"reward", "shaken tower", "boxes in the way", "hand at the floor"}


def _in_stage(stage: Stage) -> tuple[Stack, Any]:
    """A cost in a stage; box1 stands in its place."""
    if stage is Stage.CARRY:
        return _holding()
    x, z = {Stage.LEAVE: (0.0, TOP), Stage.DODGE: (0.3, 0.5), Stage.SHAKE: (0.3, 0.2)}.get(
        stage, (0.3, HALF)
    )
    seconds = 0.1 if stage is Stage.DODGE else 1.0
    cost, physics = _updated([(x, z), (0.0, HALF)], seconds=seconds)
    waits = {Stage.SHAKE: 14, Stage.RETREAT: 20}.get(stage, 0)
    assert _after(cost, physics, waits) is stage
    return cost, physics


@pytest.mark.parametrize("stage", Stage)
def test_each_stage_has_terms_and_plans_of_its_own(stage: Stage) -> None:
    cost, physics = _in_stage(stage)
    assert set(cost.terms(physics)) == _COMMON_TERMS | _OWN_TERMS[stage]
    plans = cost.proposals(physics, np.random.default_rng(0))
    assert plans.shape[1:] == (cost.settings.knots, 5)
    assert np.isfinite(plans).all()
    is_still = np.ptp(plans[..., :4], axis=1).max(axis=-1) == 0.0
    assert {-1.0, 0.5, 1.0} <= set(plans[is_still][:, -1, 4].tolist())


def _cost_after(stage: Stage, change: Any) -> tuple[float, float]:
    """Costs in a stage before and after a change of the physics."""
    cost, physics = _in_stage(stage)
    before = cost.step_cost(physics).item()
    change(physics)
    return before, cost.step_cost(physics).item()


@pytest.mark.parametrize(
    ("stage", "worse"),
    [
        (Stage.LEAVE, lambda physics: point_hand(physics, 0.05, TOP)),
        (Stage.DODGE, lambda physics: place_boxes(physics, [(0.3, 0.6)])),
        (Stage.SHAKE, lambda physics: place_boxes(physics, [(0.3, 0.25)])),
        (Stage.CARRY, lambda physics: place_boxes(physics, [(_HELD[0] + 0.1, _HELD[1])])),
        (Stage.FETCH, lambda physics: place_boxes(physics, [(0.36, HALF)])),
        (Stage.FETCH, lambda physics: place_boxes(physics, [(0.03, HALF)], first=1)),
    ],
)
def test_a_worse_state_of_a_stage_costs_more(stage: Stage, worse: Any) -> None:
    before, after = _cost_after(stage, worse)
    assert after > before


def test_a_held_box_costs_more_the_further_it_has_crept_out_of_the_hand() -> None:
    found = []
    for crept in (0.01, 0.02):
        before, after = _cost_after(
            Stage.CARRY, lambda p, by=crept: point_hand(p, _HELD[0], _BELOW_HAND + by, _AROUND)
        )
        found.append(after - before)
    assert found[1] - found[0] > 0.2


def test_a_held_box_costs_less_near_its_place_and_least_in_it() -> None:
    cost, physics = _holding()
    found = []
    for x, z in (_HELD, (0.1, TOP + 0.06), (0.0, TOP + 0.03), (0.0, TOP)):
        place_boxes(physics, [(x, z)])
        point_hand(physics, x, z + HIGH, _AROUND)
        found.append(cost.step_cost(physics).item())
    assert found == sorted(found, reverse=True)
    assert len(set(found)) == len(found)


def test_four_boxes_are_planned_with_fewer_samples_than_two() -> None:
    tasks = [suite.load("stacker", name, {"random": 0}).task for name in ("stack_2", "stack_4")]
    two, four = (Stack(task).settings.samples for task in tasks)
    assert four < two
