"""Tests of limberjack.suite.quadruped."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import quadruped

_UPRIGHT, _ON_SIDE, _UPSIDE_DOWN = (1, 0, 0, 0), (np.sqrt(0.5), np.sqrt(0.5), 0, 0), (0, 1, 0, 0)


def load(task: str, seed: int = 0, steps: int = 0) -> Any:
    """An environment after some random steps."""
    env = suite.load("quadruped", task, {"random": seed})
    env.reset()
    stream = np.random.RandomState(seed)
    for _ in range(steps):
        env.step(stream.uniform(-0.5, 0.5, 12))
    return env


def put(
    physics: Any, quaternion: Any, position: Any = (0, 0, 5), velocity: Any = (0, 0, 0)
) -> None:
    """Puts the torso in the air."""
    with physics.reset_context():
        root = physics.named.data
        root.qpos["root"] = [*position, *quaternion]
        root.qvel["root"][:3] = velocity


def test_a_start_is_turned_at_random_and_just_above_the_ground() -> None:
    env, tilts = load("walk"), []
    for _ in range(60):
        env.reset()
        x, y, z, *quaternion = env.physics.position()[:7]
        assert (x, y, env.physics.data.ncon) == (0, 0, 0)
        assert not env.physics.velocity().any()
        assert np.linalg.norm(quaternion) == pytest.approx(1)
        tilts.append(env.physics.torso_upright())
        with env.physics.reset_context():
            env.physics.named.data.qpos["root"] = [x, y, z - 0.01, *quaternion]
        assert env.physics.data.ncon > 0
    assert min(tilts) < -0.7
    assert max(tilts) > 0.7


def test_a_start_does_not_depend_on_the_pose_before_it() -> None:
    starts = []
    for steps in (0, 40):
        env = load("walk", steps=steps)
        env.task.random.seed(1)
        env.task.initialize_episode(env.physics)
        starts.append(env.physics.position())
    np.testing.assert_array_equal(*starts)


def test_a_start_that_is_impossible_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quadruped, "_MAX_RISES", 3)
    with pytest.raises(RuntimeError, match="contacts at every height up to 0 m; check whether"):
        load("walk")


@pytest.mark.parametrize(("task", "full"), [("walk", 0.5), ("run", 5.0)])
def test_moving_is_rewarded_by_forward_speed_and_uprightness(task: str, full: float) -> None:
    env = load(task)
    for speed, movement in ((full, 1), (2 * full, 1), (full / 2, 0.75), (0, 0.5), (-full, 0)):
        for quaternion, upright in ((_UPRIGHT, 1), (_ON_SIDE, 0.5), (_UPSIDE_DOWN, 0)):
            put(env.physics, quaternion, velocity=[speed, 0.3, 0])  # x stays forward
            terms = env.task.reward_terms(env.physics)
            assert terms == {"upright": pytest.approx(upright), "movement": pytest.approx(movement)}
            assert env.task.get_reward(env.physics) == pytest.approx(upright * movement)


def test_without_a_desired_speed_only_going_backward_is_not_rewarded() -> None:
    env, task = load("walk"), quadruped.Move(desired_speed=0, random=0)
    for speed, reward in ((0.0, 1.0), (3.0, 1.0), (-0.1, 0.0)):
        put(env.physics, _UPRIGHT, velocity=[speed, 0, 0])
        assert task.get_reward(env.physics) == reward


def test_escaping_is_rewarded_by_the_distance_of_the_workspace() -> None:
    env = load("escape")
    for distance, reward in ((0, 0), (15, 0.5), (30, 1), (50, 1)):
        put(env.physics, _UPRIGHT, position=[-0.8, distance, 0.2])
        assert env.task.get_reward(env.physics) == pytest.approx(reward)
    tilt = np.deg2rad(19) / 2  # within 20 degrees
    put(env.physics, [np.cos(tilt), np.sin(tilt), 0, 0], position=[0, 40, 5])
    assert env.task.get_reward(env.physics) == 1
    put(env.physics, _ON_SIDE, position=[0, 40, 5])
    expected = 1 / (1 + np.cos(np.deg2rad(20)))
    assert env.task.get_reward(env.physics) == pytest.approx(expected)


def test_each_terrain_is_a_rough_bowl() -> None:
    env, terrains = load("escape"), []
    for _ in range(2):
        env.reset()
        terrains.append(env.physics.model.hfield_data.reshape(201, 201).copy())
    assert (terrains[0] != terrains[1]).mean() > 0.75  # all but the corners
    for terrain in terrains:
        assert terrain.min() >= 0
        assert terrain.max() <= 1.2  # splines overshoot the bumps
        centre, ridge, corner = terrain[100, 100], terrain[100, 50], terrain[0, 0]
        assert centre < 0.02 < 0.1 < ridge
        assert corner == pytest.approx(0)


def test_range_finders_see_what_is_in_front() -> None:
    physics = load("escape").physics
    put(physics, _UPRIGHT, position=[0, 0, 500])
    np.testing.assert_array_equal(physics.rangefinder(), np.ones(20))  # nothing
    put(physics, _UPRIGHT, position=[0, 0, 1])
    assert ((physics.rangefinder() >= 0) & (physics.rangefinder() <= 1)).all()
    assert physics.rangefinder().min() < 1


def test_fetching_is_rewarded_by_both_distances() -> None:
    env = load("fetch")
    arena = 15 * np.sqrt(2)
    for ball, reach, fetch in (
        (0.8, 1, 1 - 0.4 / arena),
        (0.4, 1, 1),
        (10.8, 1 - 9.55 / arena, None),
    ):
        with env.physics.reset_context():
            env.physics.named.data.qpos["ball_root"][:3] = ball, 0, 0.15
        terms = env.task.reward_terms(env.physics)
        fetch = 1 - 10.4 / arena if fetch is None else fetch
        assert terms["reach"] == pytest.approx(reach)
        assert terms["fetch"] == pytest.approx(fetch)
        assert env.task.get_reward(env.physics) == pytest.approx(reach * (1 + fetch) / 2)
    assert not env.task.is_success({"fetch": 0.89})
    assert env.task.is_success({"fetch": 0.9})


def test_the_ball_is_thrown_anywhere_between_the_walls() -> None:
    env, thrown = load("fetch"), []
    for _ in range(20):
        env.reset()
        x, y, z = env.physics.named.data.qpos["ball_root"][:3]
        assert max(abs(x), abs(y)) <= 13.5
        assert z == 2
        root = env.physics.position()[:7]
        assert max(abs(root[:2])) <= 13.5
        np.testing.assert_array_equal(root[4:6], 0)  # only turned about the vertical
        thrown.append(env.physics.velocity()[22:24])
        assert not env.physics.velocity()[:22].any()
    assert 3 < np.std(thrown) < 7
    assert abs(np.mean(thrown)) < 3


@pytest.mark.parametrize("seed", range(3))
def test_things_are_seen_from_the_torso(seed: int) -> None:
    physics = load("fetch", seed, steps=20).physics
    data = physics.named.data
    frame, place = data.xmat["torso"].reshape(3, 3), data.xpos["torso"]
    toes = [f"toe_{leg}" for leg in ("front_left", "back_left", "back_right", "front_right")]
    ball, root = data.qvel["ball_root"], data.qvel["root"]
    state = [data.xpos["ball"] - place, ball[:3] - root[:3], ball[3:]]
    for found, expected in (
        (physics.origin(), -place @ frame),
        (physics.target_position(), (data.site_xpos["target"] - place) @ frame),
        (physics.ball_state(), (np.array(state) @ frame).ravel()),
        (physics.toe_positions(), (data.xpos[toes] - place) @ frame),
    ):
        np.testing.assert_allclose(found, expected, atol=1e-12)  # one product or several
    assert physics.torso_upright() == frame[2, 2]
    distance = np.hypot(*(data.site_xpos["target"] - data.xpos["ball"])[:2])
    assert physics.ball_to_target_distance() == pytest.approx(distance)


def test_the_observed_state_has_no_position() -> None:
    env = load("walk", steps=10)
    state = env.physics.egocentric_state()
    np.testing.assert_array_equal(state[:16], env.physics.position()[7:])
    np.testing.assert_array_equal(state[16:32], env.physics.velocity()[6:])
    np.testing.assert_array_equal(state[32:], env.physics.activation())
    np.testing.assert_array_equal(np.sinh(env.physics.force_torque()).shape, (24,))
    assert env.physics.imu().shape == (6,)


def test_a_start_does_not_open_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("limberjack.mujoco.rendering.thread.call", None)
    monkeypatch.setattr("limberjack.mujoco.camera.prepare", None)
    load("escape", steps=2)


def test_a_model_has_what_is_asked_for() -> None:
    sizes = []
    for kwargs in ({}, {"terrain": True}, {"rangefinders": True}, {"walls_and_ball": True}):
        xml = quadruped.make_model(floor_size=3, **kwargs)
        model = quadruped.Physics.from_xml_string(xml, suite.common.ASSETS).model
        assert list(model.geom_size[model.name2id("floor", "geom")]) == [3, 3, 0.5]
        sizes.append((model.ngeom, model.nsensor, model.nbody))
    geoms, sensors, bodies = sizes[0]
    assert sizes[1:] == [
        (geoms + 1, sensors, bodies),
        (geoms, sensors + 20, bodies),
        (geoms + 5, sensors, bodies + 1),
    ]
