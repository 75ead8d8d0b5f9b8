"""Fetching of the ball and the peg."""

import numpy as np
import pytest

from limberjack.planner.arm.hand import ARM
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.manipulator.fetch import Stage
from limberjack.utils.arrays import rows_of_a_batch

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]
_FOLDED, _PEG_ON_IT = [2.72, -1.57, 0.34, 2.17], [-0.177, 0.336, -0.90]


def test_a_hand_that_fails_to_grasp_for_long_withdraws_and_comes_again() -> None:
    place = hand_places(np.array(_ARM), GRASP + 0.05)
    cost, physics = scene("bring_ball", 1000, _ARM, [*place, 0.0])
    stages = []
    for _ in range(40):
        cost.update(physics)
        stages.append(cost.stage()[0])
    assert stages[:25] == [Stage.FETCH] * 25
    assert stages.count(Stage.WITHDRAW) == 10
    assert stages[-1] is Stage.FETCH


def test_the_arm_stretches_under_a_peg_that_lies_on_it() -> None:
    cost, physics = scene("bring_peg", 1000, _FOLDED, _PEG_ON_IT)
    now, fetch = physics.named.data.qpos[ARM], cost._fetch
    for _ in range(20):
        cost.update(physics)
    assert fetch.lies_on_arm
    end = fetch.paths.plans(now, 40)[-1][-1, :4]
    assert np.abs(end[1:]).max() < 0.6 < np.abs(now[1:]).max()


def test_an_object_counts_as_held_only_between_closed_fingers() -> None:
    place = hand_places(np.array(_ARM), GRASP)
    cost, physics = scene("bring_ball", 1000, _ARM, [*place, 0.0])
    data, fetch = physics.named.data, cost._fetch
    for angle, held in ((fetch.prop.firm, True), (fetch.prop.ready, False)):
        data.qpos[["thumb", "finger"]] = angle
        physics.forward()
        fetch.observe(data)
        assert fetch.has == held


@pytest.mark.parametrize("task", ["bring_ball", "bring_peg"])
def test_a_hand_nearer_to_an_object_costs_less(task: str) -> None:
    ahead = hand_places(np.array(_ARM), GRASP + 0.1)
    cost, physics = scene(task, 1000, _ARM, [*ahead, np.pi - sum(_ARM)])
    batch = physics.replicate(2, 1, []).physics
    data, joints = batch.named.data, cost.task.object_joints
    data.qpos[ARM] = _ARM
    data.qpos[joints] = np.stack(
        [[*hand_places(np.array(_ARM), GRASP + far), np.pi - sum(_ARM)] for far in (0.05, 0.1)]
    )
    batch.forward()
    with rows_of_a_batch(2):
        terms = cost.terms(batch)
    assert terms["fetch"][0] < terms["fetch"][1]
    assert list(terms) == ["carry", "fetch", "hand at the floor"]
