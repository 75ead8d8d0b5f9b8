"""Inverse kinematics of the planar arm, against MuJoCo's own"""

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner.arm.collision import is_clear
from limberjack.planner.arm.kinematics import (
    GRASP,
    PINCH,
    angle_of,
    direction,
    drawn_back,
    hand_places,
    hand_poses,
    hand_poses_each,
    nudged,
)

_ARM = ["arm_root", "arm_shoulder", "arm_elbow", "arm_wrist"]
_PLANE = [0, 2]


@pytest.mark.parametrize(("site", "forward"), [("grasp", GRASP), ("pinch", PINCH)])
def test_every_pose_has_the_hand_where_it_is_wanted(site: str, forward: float) -> None:
    physics = suite.load("manipulator", "bring_ball", task_kwargs={"random": 0}).physics
    random = np.random.default_rng(0)
    found = 0
    for _ in range(20):
        point = random.uniform([-0.3, 0.1], [0.3, 0.6])
        angle = random.uniform(-np.pi, np.pi)
        for pose in hand_poses(random, point, forward, np.zeros(4), 5, angle, tilt=0.2):
            with physics.reset_context():
                physics.named.data.qpos[_ARM] = pose
            reached = physics.named.data.site_xpos[site][_PLANE]
            # Closed forms and MuJoCo's rotations round differently: by 3e-16 metres here.
            np.testing.assert_allclose(reached, point, rtol=0, atol=1e-12)
            pointing = physics.named.data.site_xmat[site, ["xz", "zz"]]
            assert pointing @ direction(angle) >= np.cos(0.2) - 1e-9
            found += 1
    assert found > 40


def test_poses_keep_the_limits_and_the_nearest_come_first() -> None:
    physics = suite.load("manipulator", "bring_ball", task_kwargs={"random": 0}).physics
    limits = physics.named.model.jnt_range[_ARM[1:]]
    now = np.array([7.0, 0.5, 0.5, 0.5])  # the root has turned once
    poses = hand_poses(np.random.default_rng(0), np.array([0.2, 0.2]), GRASP, now, 20)
    assert len(poses) == 20
    assert (np.abs(poses[:, 0] - now[0]) <= np.pi).all()
    assert (poses[:, 1:] > limits[:, 0]).all()
    assert (poses[:, 1:] < limits[:, 1]).all()
    far = np.abs(poses - now).max(axis=-1)
    assert (np.diff(far[:11]) >= 0).all()
    assert far[10] >= far[9]
    assert far[9] <= far[10:].min()


def test_many_points_at_once_are_reached_as_each_is_wanted() -> None:
    random = np.random.default_rng(3)
    points = random.uniform([-0.25, 0.15], [0.25, 0.5], (12, 2))
    points[5] = 0.6, 0.4  # out of reach
    angles, tilts = random.uniform(-3.0, 3.0, 12), np.linspace(0.05, 0.6, 12)
    forward, now = np.linspace(0.06, 0.09, 12), random.uniform(-1.0, 1.0, (12, 4))
    each = hand_poses_each(random, points, forward, now, 4, angles, tilts)
    assert [len(poses) <= 4 for poses in each] == [True] * 12
    assert len(each[5]) == 0
    assert sum(len(poses) for poses in each) > 20
    for poses, point, ahead, angle, tilt, start in zip(
        each, points, forward, angles, tilts, now, strict=True
    ):
        # Closed forms both ways, which round differently.
        places = hand_places(poses, ahead)
        np.testing.assert_allclose(places, np.tile(point, (len(poses), 1)), rtol=0, atol=1e-12)
        off = (poses.sum(axis=-1) - angle + np.pi) % (2 * np.pi) - np.pi
        assert (np.abs(off) <= tilt + 1e-9).all()
        far = np.abs(poses - start).max(axis=-1)
        assert (np.diff(far[:2]) >= 0).all()
        assert (far[2:] >= far[:2].max(initial=0.0)).all()


def test_one_point_of_many_is_found_as_if_it_were_alone_and_none_gives_none() -> None:
    point, now = np.array([0.2, 0.3]), np.zeros(4)
    alone = hand_poses(np.random.default_rng(0), point, GRASP, now, 6, 1.0, 0.3)
    each = hand_poses_each(np.random.default_rng(0), point[None], GRASP, now, 6, 1.0, 0.3)
    assert len(alone) > 3
    np.testing.assert_array_equal(each, [alone])
    assert hand_poses_each(np.random.default_rng(0), np.zeros((0, 2)), GRASP, now, 6) == []


@pytest.mark.parametrize("point", [(0.6, 0.4), (0.0, -0.1), (0.45, 0.0)])
def test_what_is_out_of_reach_or_under_the_floor_has_no_pose(point: tuple[float, float]) -> None:
    poses = hand_poses(np.random.default_rng(0), np.array(point), GRASP, np.zeros(4), 5)
    assert poses.shape == (0, 4)


def test_fingertips_of_a_given_width_keep_off_the_floor() -> None:
    point, down = np.array([0.2, 0.045]), angle_of(np.array([0.0, -1.0]))

    def lowest_tip(width: float | None) -> float:
        random = np.random.default_rng(0)
        poses = hand_poses(random, point, GRASP, np.zeros(4), 20, down, 1.0, width=width)
        sides = direction(poses.sum(axis=-1) + np.pi / 2)[:, 1]
        middles = np.array([hand_places(pose, 0.096)[1] for pose in poses])
        return float((middles - 0.03 * np.abs(sides)).min())

    assert lowest_tip(None) < 0.005 < lowest_tip(0.03)


def test_a_hand_that_is_folded_back_onto_the_arm_is_not_clear() -> None:
    straight, folded = np.array([0.3, 0.3, 0.3, 0.3]), np.array([0.0, 0.0, 2.6, 1.3])
    assert is_clear(np.stack([straight, folded]), 0.1).tolist() == [True, False]


def test_an_angle_is_that_of_its_direction() -> None:
    for angle in (-2.0, 0.0, 0.5, 3.0):
        assert angle_of(direction(angle)) == pytest.approx(angle)
    assert angle_of(np.array([0.0, 1.0])) == 0.0


def test_a_nudge_moves_the_wrist_and_turns_the_hand_as_asked() -> None:
    random = np.random.default_rng(3)
    for joints in random.uniform(0.4, 1.2, (20, 4)):  # bent: a straight arm cannot go on
        moved = nudged(joints, np.array([0.03, -0.02]), 0.1)
        step = hand_places(moved, 0.0) - hand_places(joints, 0.0)
        # Newton steps: three of them leave 2.2e-8 metres at worst here, three more only rounding.
        np.testing.assert_allclose(step, [0.03, -0.02], rtol=0, atol=3e-8)
        left, turned = [0.03, -0.02] - step, (moved - joints).sum()
        again = nudged(moved, left, 0.1 - turned)
        step = hand_places(again, 0.0) - hand_places(joints, 0.0)
        np.testing.assert_allclose(step, [0.03, -0.02], rtol=0, atol=1e-12)
        np.testing.assert_allclose(moved.sum() - joints.sum(), 0.1, rtol=0, atol=1e-12)


def test_a_hand_that_is_drawn_back_moves_along_itself() -> None:
    poses = hand_poses(np.random.default_rng(0), np.array([0.2, 0.2]), GRASP, np.zeros(4), 40)
    back = drawn_back(poses, 0.06)
    possible = np.isfinite(back).all(axis=-1)
    assert 10 < possible.sum() < len(poses)  # some are at the end of their reach
    assert not np.isfinite(back[~possible]).any()
    poses, back = poses[possible], back[possible]
    expected = hand_places(poses, GRASP) - 0.06 * direction(poses.sum(axis=-1))
    # Closed forms there and back: they round.
    np.testing.assert_allclose(hand_places(back, GRASP), expected, rtol=0, atol=1e-12)
    turned = (back - poses).sum(axis=-1) / (2 * np.pi)
    # Whole turns, as sums of angles that round.
    np.testing.assert_allclose(turned, np.round(turned), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(back[:, 3], poses[:, 3])
    assert (np.sign(back[:, 1]) == np.sign(poses[:, 1])).all()
    assert np.abs(back[:, 0] - poses[:, 0]).max() < np.pi


def test_places_beside_the_hands_middle_line_may_differ() -> None:
    points, now = np.array([[0.2, 0.1], [0.2, 0.1]]), np.zeros(4)
    aside = np.array([-0.04, 0.04])
    each = hand_poses_each(np.random.default_rng(0), points, GRASP, now, 4, lateral=aside)
    for poses, beside, point in zip(each, aside.tolist(), points, strict=True):
        assert len(poses) == 4
        reached = hand_places(poses, GRASP, beside)
        # Closed forms there and back: they round.
        np.testing.assert_allclose(reached, np.repeat(point[None], 4, axis=0), atol=1e-12)
