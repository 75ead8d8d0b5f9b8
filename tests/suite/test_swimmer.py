"""Tests of limberjack.suite.swimmer."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import swimmer

_RADIUS = 0.1  # metres; of the target
_NOSE = 0.06  # metres; from the middle of the head, towards -y


@pytest.fixture(params=["swimmer6", "swimmer15"])
def env(request: pytest.FixtureRequest) -> Any:
    """Just begun."""
    env = suite.load("swimmer", request.param, {"random": 0})
    env.reset()
    return env


def put_target(physics: Any, x: float, y: float) -> None:
    """Moves the target to a position relative to the nose of a straight swimmer."""
    with physics.reset_context():
        physics.named.model.geom_pos["target", ["x", "y"]] = [x, y - _NOSE]


def test_the_reward_falls_with_the_distance_of_the_nose(env: Any) -> None:
    for distance, expected in [
        (0.0, 1.0),
        (0.99 * _RADIUS, 1.0),
        (6 * _RADIUS, 0.1),  # five radii from the surface
        (100.0, 2e-6),
    ]:
        for x, y in ((distance, 0.0), (0.0, -distance), (0.6 * distance, 0.8 * distance)):
            put_target(env.physics, x, y)
            # The target is 5 cm above the ground, as the swimmer is.
            assert env.physics.nose_to_target_dist() == pytest.approx(distance)
            reward = env.task.get_reward(env.physics)
            assert reward == pytest.approx(expected, rel=0.5 if distance == 100 else 1e-9)
            assert env.task.is_success({"near": reward}) == (expected == 1.0)


def test_the_target_is_seen_from_the_head(env: Any) -> None:
    physics = env.physics
    for turn in (0.0, 1.0, -2.5):
        put_target(physics, 0.3, -0.4)
        # Turned about the nose, the head sees the target turned the other way.
        physics.named.data.qpos["rootz"] = turn
        physics.forward()
        data = physics.named.data
        offset = data.geom_xpos["target"] - data.geom_xpos["nose"]
        c, s = np.cos(turn), np.sin(turn)
        expected = [c * offset[0] + s * offset[1], -s * offset[0] + c * offset[1]]
        np.testing.assert_allclose(physics.nose_to_target(), expected, atol=1e-12)


def test_velocities_are_those_of_each_link_in_its_own_frame(env: Any) -> None:
    physics = env.physics
    with physics.reset_context():
        physics.named.data.qpos["rootz"] = np.pi / 2
        physics.named.data.qvel["rootx"] = 0.3
    links = physics.body_velocities().reshape(-1, 3)
    assert len(links) == physics.model.nbody - 1
    # Moving along the world's x is moving towards -y of a swimmer turned left by 90 degrees.
    np.testing.assert_allclose(links, [[0.0, -0.3, 0.0]] * len(links), atol=1e-12)
    with physics.reset_context():
        physics.named.data.qvel["joint_0"] = 2.0
    turning = physics.body_velocities().reshape(-1, 3)[:, 2]
    np.testing.assert_allclose(turning, [0.0] + [2.0] * (len(links) - 1), atol=1e-12)


def test_starts_are_bent_at_rest_with_a_target_that_its_light_follows(env: Any) -> None:
    model, close, angles = env.physics.named.model, [], []
    for _ in range(300):
        env.reset()
        assert not env.physics.velocity().any()
        place = model.geom_pos["target", ["x", "y"]]
        assert abs(place).max() <= 2
        np.testing.assert_array_equal(model.light_pos["target_light", ["x", "y"]], place)
        is_close = env.task.start(env.physics) == "close"
        assert is_close == (abs(place).max() <= 0.3)
        close.append(is_close)
        angles.append(env.physics.joints())
    limit = 2 * np.pi / (env.physics.model.nbody - 1)
    assert abs(np.array(angles)).max() == pytest.approx(limit, rel=0.05)
    assert 0.1 < np.mean(close) < 0.35


@pytest.mark.parametrize("links", [3, 4, 8])
def test_a_swimmer_of_any_length(links: int) -> None:
    env = swimmer.swimmer(links, time_limit=0.3, random=0)
    env.reset()
    assert env.action_spec().shape == (links - 1,)
    assert (env.step_limit, env.control_timestep()) == (10, 0.03)
    assert env.physics.joints().shape == (links - 1,)
    limits = np.rad2deg(env.physics.named.model.jnt_range["joint_0"])
    np.testing.assert_allclose(limits, [-360 / links, 360 / links])
    assert swimmer.swimmer().physics.model.nu == 2


def test_cameras_step_back_from_longer_swimmers() -> None:
    short, long = (swimmer.swimmer(links).physics.named.model.cam_pos for links in (6, 12))
    for camera in ("tracking1", "tracking2"):
        np.testing.assert_allclose(long[camera], 2 * short[camera])
    np.testing.assert_array_equal(long["eyes"], short["eyes"])
