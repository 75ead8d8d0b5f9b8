"""Tests of limberjack.suite.humanoid_CMU."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import humanoid, humanoid_CMU
from limberjack.utils import rewards

_UPRIGHT = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]  # the root's frame has y up


@pytest.fixture
def physics() -> Any:
    """Thrown about."""
    env = suite.load("humanoid_CMU", "run", {"random": 0})
    env.reset()
    stream = np.random.RandomState(0)
    for _ in range(10):
        env.step(stream.uniform(-1, 1, 56))
    return env.physics


def set_pose(physics: Any, height: float) -> None:
    """Stands upright, every joint at zero, the root at a height."""
    with physics.reset_context():
        physics.data.qpos[:] = 0.0
        physics.data.qpos[2:7] = height, *_UPRIGHT


def test_limbs_are_seen_from_the_thorax(physics: Any) -> None:
    data, model = physics.data, physics.model
    thorax = model.name2id("thorax", "body")
    frame = data.xmat[thorax].reshape(3, 3)
    seen = []
    for limb in ("lhand", "lfoot", "rhand", "rfoot"):
        body = model.name2id(limb, "body")
        seen.append((data.xpos[body] - data.xpos[thorax]).dot(frame))
    np.testing.assert_array_equal(physics.extremities(), np.hstack(seen))
    np.testing.assert_array_equal(physics.torso_vertical_orientation(), frame[2])
    assert physics.thorax_upright() == physics.torso_upright() == frame[2, 1]
    assert physics.head_height() == data.xpos[model.name2id("head", "body"), 2]
    np.testing.assert_array_equal(physics.joint_angles(), data.qpos[7:])


def test_the_centre_of_mass_is_that_of_the_upper_body(physics: Any) -> None:
    model = physics.model
    thorax = model.name2id("thorax", "body")
    attached = [thorax]
    for body in range(thorax + 1, model.nbody):
        if model.body_parentid[body] in attached:
            attached.append(body)
    assert model.name2id("lhand", "body") in attached
    assert model.name2id("lfoot", "body") not in attached
    masses = model.body_mass[attached]
    centre = masses @ physics.data.xipos[attached] / masses.sum()
    # Summed in another order.
    np.testing.assert_allclose(physics.center_of_mass_position(), centre, atol=1e-12)


def test_upright_and_at_rest_it_faces_ahead_with_its_feet_below() -> None:
    physics = suite.load("humanoid_CMU", "stand").physics
    set_pose(physics, 1.0)
    left_hand, left_foot, right_hand, right_foot = physics.extremities().reshape(4, 3)
    assert physics.thorax_upright() == pytest.approx(1.0)
    assert physics.facing_up() == pytest.approx(0.0, abs=1e-12)
    assert left_foot[1] == pytest.approx(right_foot[1])
    assert left_foot[1] < -1.0
    assert left_hand[0] > 0.5 > -0.5 > right_hand[0]
    physics.data.qpos[3:7] = 1.0, 0.0, 0.0, 0.0
    physics.forward()
    assert physics.facing_up() == pytest.approx(1.0)  # on its back


@pytest.mark.parametrize(
    ("task", "speed", "movement"),
    [
        ("stand", 0.0, 1.0),
        ("stand", 2.0, None),
        ("walk", 0.0, 1 / 6),
        ("walk", 0.5, (5 * 0.5 + 1) / 6),
        ("walk", 3.0, 1.0),
        ("run", 1.0, (5 * 0.1 + 1) / 6),
        ("run", 10.0, 1.0),
    ],
)
def test_standing_upright_is_rewarded_by_the_speed_in_any_direction(
    task: str, speed: float, movement: float | None
) -> None:
    env = suite.load("humanoid_CMU", task)
    set_pose(env.physics, 1.0)
    assert env.physics.head_height() > 1.4
    for direction in ([1, 0], [0.6, -0.8]):
        velocity = speed * np.array(direction)
        env.physics.data.qvel[:3] = [*velocity, 7.0]  # the vertical does not count
        env.physics.forward()
        terms = env.task.reward_terms(env.physics)
        assert terms["standing"] == terms["upright"] == terms["small_control"] == 1.0
        still = rewards.mean_tolerance(velocity, margin=2)
        expected = still if movement is None else movement
        assert env.task.get_reward(env.physics) == pytest.approx(expected)


def test_a_start_is_a_random_pose_at_rest_from_which_it_falls() -> None:
    env = suite.load("humanoid_CMU", "walk", {"random": 0})
    tilts, kinds = [], set()
    for _ in range(40):
        env.reset()
        assert not env.physics.velocity().any()
        assert env.physics.data.ncon == 0
        np.testing.assert_array_equal(env.physics.position()[:3], [0, 0, 1])
        tilts.append(env.physics.thorax_upright())
        kinds.add(env.task.start(env.physics))
    # Free of contacts at this height, few are head down.
    assert min(tilts) < 0.0
    assert max(tilts) > 0.8
    assert kinds == {"face_up", "face_down", "on_side"}


def test_the_task_is_that_of_the_humanoid_with_a_cost_of_its_own() -> None:
    task = humanoid_CMU.HumanoidCMU(move_speed=3, random=0)
    assert isinstance(task, humanoid.Humanoid)
    assert task.planner_cost != humanoid.Humanoid.planner_cost
    physics = humanoid_CMU.Physics.from_xml_string(*humanoid_CMU.get_model_and_assets())
    assert (physics.model.nq, physics.model.nv, physics.model.nu) == (63, 62, 56)
    with pytest.raises(TypeError, match="pure_state"):
        humanoid_CMU.HumanoidCMU(3, pure_state=True)  # pyright: ignore[reportCallIssue]
