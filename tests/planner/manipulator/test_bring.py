"""The cost of bringing the ball and the peg."""

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner.arm.hand import ARM, PLANE
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.manipulator.bring import Bring
from limberjack.planner.manipulator.fetch import Stage
from limberjack.utils.arrays import rows_of_a_batch

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]
_HARD_TARGET = 1134  # the seed: its target is low and beside the middle


def _held_peg() -> list[float]:
    return [*hand_places(np.array(_ARM), GRASP), np.pi - sum(_ARM)]


@pytest.mark.parametrize(
    ("place", "stage"), [((0.1, 0.022), Stage.FETCH), ((-0.57, 0.2), Stage.RAKE)]
)
def test_a_ball_within_reach_is_fetched_and_one_in_a_corner_is_raked(
    place: tuple[float, float], stage: Stage
) -> None:
    cost, physics = scene("bring_ball", 1000, _ARM, [*place, 0.0])
    for _ in range(4):
        cost.update(physics)
    assert cost.stage()[0] is stage


def test_a_ball_that_starts_in_the_hand_is_carried_and_its_distance_costs() -> None:
    env = suite.load("manipulator", "bring_ball", task_kwargs={"random": 1001})
    env.reset()
    assert env.task.start(env.physics) == "in_hand"
    cost, physics = Bring(env.task), env.physics
    physics.named.data.qpos[["thumb", "finger"]] = cost._fetch.prop.firm
    physics.forward()
    cost.update(physics)
    assert cost.stage()[0] is Stage.CARRY
    batch = physics.replicate(2, 1, ["body_pos", "body_quat"]).physics
    saved = {name: np.repeat(v, 2, axis=0) for name, v in env.snapshot().physics.items()}
    saved["body_pos"][1, physics.model.name2id("target_ball", "body")] = 2.0, 0.0, 2.0  # far away
    batch.simulation.load(saved)
    with rows_of_a_batch(2):
        near_by, far = cost.terms(batch)["carry"]
    assert far > near_by


def test_proposals_for_a_held_ball_end_at_the_target() -> None:
    cost, physics = scene("bring_ball", 1001, _ARM, [0.0, 0.3, 0.0])
    proposals = cost._carrying(physics.named.data, np.random.default_rng(0))
    target = physics.named.data.site_xpos["target_ball"][PLANE]
    ends = [hand_places(np.array(p.waypoints[-1]), GRASP) for p in proposals]
    # Inverse kinematics and back, by sines and cosines: they round.
    assert min(np.abs(end - target).max() for end in ends) < 1e-9


def test_a_peg_leans_at_a_target_where_the_hand_cannot_hold_it_straight() -> None:
    cost, physics = scene("bring_peg", _HARD_TARGET, _ARM, _held_peg())
    data, random, peg = physics.named.data, np.random.default_rng(0), cost._fetch.prop
    assert len(peg.poses_at_target(data, random, 200)) == 0
    for _ in range(8):
        cost._search_target(peg, data)
    pose = cost._fetch.paths.plans(data.qpos[ARM], 40)[-1][-1, :4]
    data.qpos[ARM] = pose
    data.qpos[cost.task.object_joints] = [*hand_places(pose, GRASP), np.pi - pose.sum()]
    physics.forward()
    assert cost.task.get_reward(physics) > 0.99


def test_a_new_episode_begins_with_fetching() -> None:
    cost, physics = scene("bring_peg", 1000, _ARM, [0.0, 0.017, 1.3])
    for _ in range(3):
        cost.update(physics)
    cost.reset()
    assert cost.stage()[0] is Stage.FETCH
    np.testing.assert_array_equal(cost._sag, np.zeros(4))
