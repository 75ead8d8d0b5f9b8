"""Release of the ball where it does not just fall in, and its recovery from the arm."""

from typing import Any

import numpy as np

from limberjack import suite
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE
from limberjack.planner.arm.kinematics import GRASP, hand_poses
from limberjack.planner.manipulator.fetch import Stage
from limberjack.planner.manipulator.insert import Insert

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]
_JOINTS = ["ball_x", "ball_z"]


def test_a_ball_that_rests_on_high_is_shaken_off_and_one_in_the_cup_is_not() -> None:
    cost, physics = scene("insert_ball", 1058, _ARM, [0.0, 0.3, 0.0])
    data = physics.named.data
    for place, stage in (((-0.2, 0.3), Stage.SHAKE), (None, Stage.LEAVE)):
        cost.reset()
        data.qpos[_JOINTS] = data.site_xpos["target_ball"][[0, 2]] if place is None else place
        physics.forward()
        for _ in range(12):
            cost.update(physics)
        assert cost.stage()[0] is stage
        found = cost.proposals(physics, np.random.default_rng(0))
        turns = np.abs(found[:, -1, :4] - data.qpos[ARM]).max(axis=-1)
        assert (turns > 0.3).all() == (stage is Stage.SHAKE)


def test_an_arm_waits_with_an_open_hand_until_the_ball_has_rolled_in_or_missed() -> None:
    cost, physics = scene("insert_ball", 1058, _ARM, [0.0, 0.3, 0.0])
    data, release = physics.named.data, cost._release
    data.qpos[_JOINTS] = data.site_xpos["target_ball"][[0, 2]] + [0.05, 0.05]
    physics.forward()
    release.waits, release._kept = 3, np.array(_ARM)
    cost.update(physics)
    assert cost.stage()[0] is Stage.RELEASE
    (plan,) = cost.proposals(physics, np.random.default_rng(0))
    np.testing.assert_array_equal(plan[:, :4], np.repeat([_ARM], len(plan), axis=0))
    assert (plan[:, 4] < OPEN_ANGLE).all()
    assert list(cost.terms(physics)) == ["reward", "arm astray", "closed fingers"]
    data.qpos[_JOINTS] = data.site_xpos["target_ball"][[0, 2]] + [0.0, 0.4]
    physics.forward()
    cost.update(physics)
    assert cost.stage()[0] is not Stage.RELEASE


def _env_with_ball_in_hand(x: float, z: float) -> Any:
    """An upright cup at a place, and an arm that holds the ball."""
    env = suite.load("manipulator", "insert_ball", task_kwargs={"random": 1058})
    env.reset()
    assert env.task.start(env.physics) == "in_hand"
    for body in ("cup", "target_ball"):
        env.physics.named.model.body_pos[body, ["x", "z"]] = x, z
        env.physics.named.model.body_quat[body] = 1.0, 0.0, 0.0, 0.0
    env.physics.forward()
    return env


def _above(x: float, z: float) -> np.ndarray:
    """A pose of the hand, which points down, at a place."""
    now = np.array([-1.5, -0.5, -0.5, -0.5])
    return hand_poses(np.random.default_rng(0), np.array([x, z]), GRASP, now, 1, np.pi, 0.1)[0]


def test_a_ball_that_is_let_go_above_the_mouth_gets_in_and_one_beside_it_does_not() -> None:
    env = _env_with_ball_in_hand(0.25, 0.15)
    physics = env.physics
    release = Insert(env.task)._release
    assert release is not None
    state = physics.get_state()
    assert release.works(physics, _above(0.25, 0.15 + 0.13))
    assert not release.works(physics, _above(0.1, 0.15 + 0.13))
    np.testing.assert_array_equal(physics.get_state(), state)


def test_beside_the_arms_base_a_path_leads_to_where_the_release_works() -> None:
    env = _env_with_ball_in_hand(0.05, 0.25)
    cost, physics = Insert(env.task), env.physics
    cost.update(physics)  # finds the walls
    release, path = cost._release, None
    assert release is not None
    for trial in range(60):
        physics.data.time = 0.03 * trial
        path = path or release._path(physics)
    assert path is not None
    assert release.works(physics, path.next_points(1)[-1])
