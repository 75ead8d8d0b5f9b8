"""Tests of limberjack.suite.utils.randomizers."""

from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import Physics
from limberjack.suite.utils import randomizers

_ONE_JOINT = (
    "<mujoco><worldbody><body><joint name='it' {}/><geom size='1'/></body></worldbody></mujoco>"
)
_MIXED = """
<mujoco>
  <worldbody>
    <body><freejoint/><geom size="1"/></body>
    <body><joint type="ball"/><geom size="1"/></body>
    <body><joint type="hinge" limited="true" range="10 20"/><geom size="1"/></body>
    <body><joint type="slide"/><geom size="1"/></body>
    <body><joint type="ball" limited="true" range="0 90"/><geom size="1"/></body>
    <body><joint type="hinge"/><geom size="1"/></body>
    <body><joint type="slide" limited="true" range="3 5"/><geom size="1"/></body>
  </worldbody>
</mujoco>
"""
_DRAWS = 500


def draws(attributes: str, seed: int = 0) -> np.ndarray:
    """Positions of one joint, drawn many times."""
    physics = Physics.from_xml_string(_ONE_JOINT.format(attributes))
    stream, drawn = np.random.RandomState(seed), []
    for _ in range(_DRAWS):
        randomizers.randomize_limited_and_rotational_joints(physics, stream)
        drawn.append(physics.data.qpos.copy())
    return np.array(drawn)


def angles(quaternions: np.ndarray) -> np.ndarray:
    """Angle of each rotation, radians, between 0 and pi."""
    return 2 * np.arccos(np.clip(np.abs(quaternions[:, 0]), 0, 1))


@pytest.mark.parametrize(
    ("attributes", "lower", "upper"),
    [
        ("type='hinge' limited='true' range='10 80'", np.radians(10), np.radians(80)),
        ("type='slide' limited='true' range='-3 5'", -3.0, 5.0),
        ("type='hinge'", -np.pi, np.pi),
    ],
)
def test_hinges_and_limited_slides_are_uniform_within_their_range(
    attributes: str, lower: float, upper: float
) -> None:
    drawn = draws(attributes)
    assert np.all((lower <= drawn) & (drawn <= upper))
    shares = np.histogram(drawn, 4, (lower, upper))[0] / _DRAWS
    assert np.all(np.abs(shares - 0.25) < 0.1), shares


def test_an_unlimited_slide_stays_where_it_is() -> None:
    physics = Physics.from_xml_string(_ONE_JOINT.format("type='slide'"))
    physics.data.qpos[:] = 3.5
    stream = np.random.RandomState(0)
    before = stream.get_state()[1].tolist()  # pyright: ignore[reportArgumentType, reportCallIssue, reportIndexIssue]
    randomizers.randomize_limited_and_rotational_joints(physics, stream)
    assert physics.data.qpos[0] == 3.5
    assert stream.get_state()[1].tolist() == before  # pyright: ignore[reportArgumentType, reportCallIssue, reportIndexIssue]


def test_a_ball_joint_is_turned_in_all_directions() -> None:
    drawn = draws("type='ball'")
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1.0)
    assert np.all(np.abs((drawn > 0).mean(axis=0) - 0.5) < 0.1)
    # Of uniform rotations the angle t has the density (1 - cos t) / pi: 82 % turn by more than 90°.
    assert abs((angles(drawn) > np.pi / 2).mean() - 0.818) < 0.08


@pytest.mark.parametrize("degrees", [30, 90])
def test_a_limited_ball_joint_is_turned_by_less_than_its_limit(degrees: int) -> None:
    drawn = angles(draws(f"type='ball' limited='true' range='0 {degrees}'"))
    limit = np.radians(degrees)
    assert np.all(drawn <= limit + 1e-9)
    shares = np.histogram(drawn, 4, (0, limit))[0] / _DRAWS
    assert np.all(np.abs(shares - 0.25) < 0.1), shares


def test_a_free_joint_is_turned_and_stays_in_its_place() -> None:
    physics = Physics.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    physics.data.qpos[:3] = 1.0, 2.0, 3.0
    for seed in range(50):
        stream = np.random.RandomState(seed)
        randomizers.randomize_limited_and_rotational_joints(physics, stream)
        np.testing.assert_array_equal(physics.data.qpos[:3], [1.0, 2.0, 3.0])
        rotation = physics.data.qpos[3:]
        assert np.linalg.norm(rotation) == pytest.approx(1.0)
        assert np.all(rotation >= 0)  # as dm_control


def test_joints_are_drawn_in_the_models_order() -> None:
    physics = Physics.from_xml_string(_MIXED)
    randomizers.randomize_limited_and_rotational_joints(physics, np.random.RandomState(3))
    stream = np.random.RandomState(3)
    free, ball = stream.rand(4), stream.randn(4)
    hinge = stream.uniform(np.radians(10), np.radians(20))
    axis = stream.randn(3)
    turn, limited_ball = stream.rand() * np.pi / 2, np.empty(4)
    mujoco.mju_axisAngle2Quat(limited_ball, axis / np.linalg.norm(axis), turn)
    tail = [stream.uniform(-np.pi, np.pi), stream.uniform(3, 5)]
    expected = [
        *(0, 0, 0, *free / np.linalg.norm(free)),
        *ball / np.linalg.norm(ball),
        hinge,
        0.0,
        *limited_ball,
        *tail,
    ]
    # Degrees are turned into radians by the compiler, perhaps rounded otherwise.
    np.testing.assert_allclose(physics.data.qpos, expected, rtol=1e-14)


def test_only_positions_are_written() -> None:
    physics = Physics.from_xml_string(_MIXED)
    physics.data.qvel[:] = 0.5
    xpos = physics.data.xpos.copy()
    randomizers.randomize_limited_and_rotational_joints(physics, np.random.RandomState(0))
    assert np.all(physics.data.qvel == 0.5)
    np.testing.assert_array_equal(physics.data.xpos, xpos)


def test_without_a_stream_numpys_own_is_used() -> None:
    physics = Physics.from_xml_string(_MIXED)
    before = np.random.get_state()
    try:
        np.random.seed(8)
        randomizers.randomize_limited_and_rotational_joints(physics)
        drawn = physics.position()
    finally:
        np.random.set_state(before)
    randomizers.randomize_limited_and_rotational_joints(physics, np.random.RandomState(8))
    np.testing.assert_array_equal(physics.position(), drawn)


@pytest.mark.parametrize("limit", [0.0, 0.3, np.pi])
def test_a_limited_quaternion_is_a_rotation_by_at_most_the_limit(limit: float) -> None:
    stream: Any = np.random.RandomState(0)
    drawn = np.array([randomizers.random_limited_quaternion(stream, limit) for _ in range(300)])
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1.0)
    assert np.all(angles(drawn) <= limit + 1e-9)
    assert angles(drawn).max() >= 0.95 * limit
    assert np.abs(drawn[:, 1:].mean(axis=0)).max() < 0.1
