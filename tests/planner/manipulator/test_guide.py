"""The path around a receptacle, and the progress on it."""

import numpy as np

from limberjack.planner.arm.path import Path, joint_sum
from limberjack.planner.manipulator.guide import Guide, few_of

_START, _END = np.array([0.0, 0.5, 0.5, 0.5]), np.array([1.0, 0.5, 0.5, 0.5])


def _led() -> Guide:
    guide = Guide()
    guide.follow(Path(np.stack([_START, _END]), joint_sum))
    return guide


def test_without_a_path_the_end_is_infinitely_far_and_there_are_no_plans() -> None:
    guide = Guide()
    assert guide.left(_START) == np.inf
    assert not guide.is_astray(_START)
    assert guide.plans(_START, 0.0, 5).shape == (0, 5, 5)


def test_plans_lead_along_the_path_at_several_speeds_with_a_grasp() -> None:
    plans = _led().plans(_START, -0.3, 5)
    assert (plans[..., 4] == -0.3).all()
    np.testing.assert_array_equal(plans[:, 0, :4], np.repeat(_START[None], len(plans), axis=0))
    speeds = plans[:, 1, 0]
    assert (np.diff(speeds) >= 0).all()
    assert 0.0 < speeds[0] < speeds[-1] == 1.0


def test_an_arm_that_makes_no_headway_for_long_does_not_advance() -> None:
    guide = _led()
    assert all(guide.advances(1.0) for _ in range(29))
    assert guide.advances(0.8)  # headway
    assert all(guide.advances(0.75) for _ in range(28))  # too little of it
    assert not guide.advances(0.75)


def test_an_arm_far_off_the_path_is_astray() -> None:
    guide = _led()
    assert not guide.is_astray(_START + np.array([0.0, 0.5, 0.0, 0.0]))
    assert guide.is_astray(_START + np.array([0.0, 0.5, 0.5, 0.0]))


def test_a_path_that_is_dropped_is_searched_again_after_a_while() -> None:
    guide = _led()
    guide.drop(7)
    assert guide.path is None
    assert guide.patience == 7


def test_another_attempt_has_twelve_of_the_poses_or_all_of_fewer() -> None:
    poses = np.arange(80.0).reshape(20, 4)
    for given, count in ((poses, 12), (poses[:5], 5)):
        few = few_of(np.random.default_rng(0), given)
        assert len({tuple(pose) for pose in few}) == count
        assert np.isin(few[:, 0], given[:, 0]).all()
