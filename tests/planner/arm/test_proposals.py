"""Proposals of the arm, and the plans made of them."""

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE
from limberjack.planner.arm.kinematics import GRASP, direction, hand_places, hand_poses
from limberjack.planner.arm.path import Path, joint_sum
from limberjack.planner.arm.proposals import (
    Proposal,
    approaches,
    lifts,
    plans_along,
    plans_of,
    plans_on,
    straight_to,
)

_NOW = np.array([0.0, 0.5, 0.5, 0.5])
_NEAR = _NOW + np.array([0.4, 0.0, 0.0, 0.0])
_FAR = _NOW + np.array([0.4, 0.8, 0.0, 0.0])


def test_a_plan_passes_a_waypoint_at_each_knot_and_keeps_the_last() -> None:
    (plan,) = plans_of(_NOW, [Proposal([_NEAR, _FAR], [0.1, 0.2])], 5)
    np.testing.assert_allclose(plan[:, :4], [_NOW, _NEAR, _FAR, _FAR, _FAR], atol=1e-15)  # rounds
    np.testing.assert_array_equal(plan[:, 4], [0.1, 0.2, 0.2, 0.2, 0.2])


def test_a_slow_proposal_is_at_its_waypoints_after_so_many_knots() -> None:
    (plan,) = plans_of(_NOW, [Proposal([_FAR], [0.1], 4)], 6)
    parts = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.0])[:, None]
    np.testing.assert_allclose(plan[:, :4], _NOW + parts * (_FAR - _NOW), atol=1e-15)  # rounds


def test_an_arm_without_waypoints_keeps_still_and_no_proposals_are_no_plans() -> None:
    (plan,) = plans_of(_NOW, [Proposal([], [-1.0])], 4)
    np.testing.assert_array_equal(plan, np.repeat([[*_NOW, -1.0]], 4, axis=0))
    assert plans_of(_NOW, [], 4).shape == (0, 4, 5)


def test_a_longer_list_of_grasps_than_knots_is_cut() -> None:
    (plan,) = plans_of(_NOW, [Proposal([_NEAR], [0.0, 0.1, 0.2, 0.3])], 3)
    np.testing.assert_array_equal(plan[:, 4], [0.0, 0.1, 0.2])


def test_proposals_of_different_lengths_are_planned_as_if_alone() -> None:
    several = [
        Proposal([_NEAR, _FAR, _NEAR], [0.1], 2),
        Proposal([], [0.2]),
        Proposal([_FAR], [0.3, 0.4]),
    ]
    together = plans_of(_NOW, several, 5)
    for proposal, plan in zip(several, together, strict=True):
        np.testing.assert_array_equal(plans_of(_NOW, [proposal], 5), plan[None])


@pytest.mark.parametrize("duration", [1, 3])
def test_plans_of_many_equal_waypoints_are_the_same_as_proposals(duration: int) -> None:
    paths = np.stack([[_NEAR, _FAR], [_FAR, _NEAR]])
    along = plans_along(_NOW, paths, 5, [0.1, 0.2], duration)
    proposals = [Proposal(path, [0.1, 0.2], duration) for path in paths]
    np.testing.assert_array_equal(along, plans_of(_NOW, proposals, 5))
    np.testing.assert_array_equal(plans_along(_NOW, paths[0], 5, [0.1, 0.2], duration), along[0])
    still = plans_along(_NOW, [], 5, [0.1])
    np.testing.assert_array_equal(still, np.repeat([[*_NOW, 0.1]], 5, axis=0))


def test_plans_lead_along_a_path_at_several_speeds_with_a_grasp() -> None:
    end = _NOW + np.array([1.0, 0.0, 0.0, 0.0])
    plans = plans_on(Path(np.stack([_NOW, end]), joint_sum), _NOW, -0.3, 5)
    assert (plans[..., 4] == -0.3).all()
    np.testing.assert_array_equal(plans[:, 0, :4], np.repeat(_NOW[None], len(plans), axis=0))
    speeds = plans[:, 1, 0]
    assert (np.diff(speeds) >= 0).all()
    assert 0.0 < speeds[0] < speeds[-1] == 1.0


def test_lifts_end_above_the_hand_with_it_turned_little() -> None:
    env = suite.load("manipulator", "bring_ball", task_kwargs={"random": 1000})
    env.reset()
    data, now = env.physics.named.data, np.array([0.0, 0.9, 0.9, 0.7])
    data.qpos[ARM] = now
    env.physics.forward()
    found = lifts(np.random.default_rng(0), data, 0.3)
    ends = np.array([proposal.waypoints[-1] for proposal in found])
    raised = hand_places(ends, GRASP) - hand_places(now, GRASP)
    # Inverse kinematics and back, by sines and cosines: they round.
    np.testing.assert_allclose(raised[:, 0], 0.0, atol=1e-9)
    assert set(np.round(raised[:, 1], 9).tolist()) == {0.04, 0.12}
    assert np.abs(ends.sum(axis=-1) - now.sum()).max() <= 0.3
    assert {proposal.duration for proposal in found} == {1, 3}
    assert all(proposal.grasp == [0.3] for proposal in found)


def test_an_approach_comes_straight_on_and_closes_only_at_the_grasp() -> None:
    random = np.random.default_rng(0)
    poses = hand_poses(random, np.array([0.2, 0.2]), GRASP, _NOW, 3, np.pi, 0.3)
    found = approaches(poses, OPEN_ANGLE, 0.4)
    assert len(found) == 5 * len(poses)
    for number, proposal in enumerate(found):
        pose = poses[number // 5]
        places = hand_places(np.asarray(proposal.waypoints), 0.0)
        ahead = direction(pose.sum())
        far = (hand_places(pose, 0.0) - places) @ ahead
        # The arm's Jacobian is followed in a few steps.
        np.testing.assert_allclose(far, [0.06, 0.03, 0.0][-len(places) :], atol=2e-3)
        off = places + far[:, None] * ahead - hand_places(pose, 0.0)
        np.testing.assert_allclose(off, 0.0, atol=2e-3)
        closes = 1 + proposal.duration * len(places)
        assert proposal.grasp == [OPEN_ANGLE] * closes + [0.4]
    assert approaches(np.zeros((0, 4)), OPEN_ANGLE, 0.4) == []


def test_proposals_straight_to_poses_take_each_of_the_durations() -> None:
    found = straight_to(np.stack([_NEAR, _FAR]), 0.3, 1, 2)
    ends = [(proposal.waypoints[0].tolist(), proposal.duration) for proposal in found]
    assert ends == [(pose.tolist(), knots) for pose in (_NEAR, _FAR) for knots in (1, 2)]
    assert all(proposal.grasp == [0.3] for proposal in found)
