"""Poses from which a released ball gets into the cup."""

from typing import Any

import numpy as np

from limberjack import suite
from limberjack.planner.arm.kinematics import GRASP, hand_poses
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.planner.manipulator.releases import Releases

_CUP = Receptacle.for_object("ball")
_JOINTS = ["ball_x", "ball_z"]


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
    physics = _env_with_ball_in_hand(0.25, 0.15).physics
    releases = Releases("ball", _JOINTS, _CUP)
    state = physics.get_state()
    assert releases.works(physics, _above(0.25, 0.15 + 0.13))
    assert not releases.works(physics, _above(0.1, 0.15 + 0.13))
    np.testing.assert_array_equal(physics.get_state(), state)


def test_beside_the_arms_base_a_path_leads_to_where_the_release_works() -> None:
    env = _env_with_ball_in_hand(0.05, 0.25)
    physics = env.physics
    releases = Releases("ball", _JOINTS, _CUP)
    path = None
    for trial in range(60):
        physics.data.time = 0.03 * trial
        path = path or releases.path(physics, _CUP.walls(physics))
    assert path is not None
    assert releases.works(physics, path.next_points(1)[-1])
