"""Tests of limberjack.suite.dog."""

from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.randomize import scale, shift
from limberjack.suite import dog

_TASKS = ["stand", "walk", "trot", "run", "fetch"]
_MASS = 10.24  # kilograms, of all bodies but the ball


def set_root(physics: Any, height: float, tilt: float = 0.0, forward: float = 0.0) -> None:
    """The default pose at a height, tilted about the y axis, moving along the torso's x axis."""
    with physics.reset_context():
        physics.data.qpos[2] = height
        physics.data.qpos[3:7] = np.cos(tilt / 2), 0, np.sin(tilt / 2), 0
        physics.data.qvel[:3] = forward * np.array([np.cos(tilt), 0, -np.sin(tilt)])


def terms_of(task: str, *args: float) -> dict[str, float]:
    """The terms of the reward in a pose of `set_root`."""
    env = suite.load("dog", task)
    set_root(env.physics, *args)
    return env.task.reward_terms(env.physics)


def test_the_heights_of_the_default_pose_are_those_after_a_reset() -> None:
    randomize = {"body_pos": scale(0.9, 1.1), "jnt_pos": shift(-0.01, 0.01)}
    for seed, options in enumerate([{}, {"randomize": randomize}, {"randomize": randomize}]):
        env = suite.load("dog", "walk", {"random": seed}, options)
        env.reset()
        found = env.physics.default_heights()
        env.physics.reset()
        np.testing.assert_array_equal(found, env.physics.torso_pelvis_height())


def test_the_weight_is_that_of_all_bodies_of_the_dog() -> None:
    masses = suite.load("dog", "stand").physics.model.body_mass
    assert masses.sum() == pytest.approx(_MASS, abs=0.01)
    for task in _TASKS:  # the ball does not count
        weight = suite.load("dog", task).physics.body_weight()
        assert weight == pytest.approx(9.81 * masses.sum(), rel=1e-12)  # summed in another order


def test_each_row_stands_by_its_own_heights_and_weight() -> None:
    randomize: dict[str, Any] = {"body_mass": scale(0.5, 2), "body_pos": scale(0.9, 1.1)}
    randomize["opt.gravity"] = shift([0, 0, -2], [0, 0, 2])
    batch = suite.load_batch("dog", "walk", 3, 1, 5, environment_kwargs={"randomize": randomize})
    batch.reset()
    for row in range(3):
        env = suite.load("dog", "walk", {"random": 5 + row}, {"randomize": randomize})
        env.reset()
        assert batch.physics.body_weight()[row] == env.physics.body_weight()
        assert batch.physics.default_heights()[1][row] == env.physics.default_heights()[1]
    assert len(set(batch.physics.body_weight())) == 3


def test_standing_high_and_upright_is_rewarded() -> None:
    default = 0.41522  # metres
    for height, expected in ((0.0, 1.0), (-0.1 * default, 1.0), (-0.9 * default, None)):
        terms = terms_of("stand", default + height)
        if expected is None:
            assert terms["torso_height"] < 0.2
        else:
            assert terms["torso_height"] == terms["pelvis_height"] == expected
    cosine = np.cos(np.pi / 6)
    for tilt, expected in ((0.5, 1.0), (np.pi / 2, 1 / (1 + cosine)), (np.pi, 0.0)):
        terms = terms_of("stand", 1.0, tilt)
        for part in ("skull", "torso", "pelvis"):
            assert terms[f"{part}_upright"] == pytest.approx(expected, abs=1e-9)


def test_weight_on_the_paws_adds_at_most_a_tenth() -> None:
    env = suite.load("dog", "stand", {"random": 0})
    env.reset()
    assert terms_of("stand", 2.0)["touch"] == pytest.approx(0.9)  # in the air
    for force, expected in ((0.5, 0.95), (1.0, 1.0), (3.0, 1.0)):
        pressure = np.full(4, force * env.physics.body_weight() / 4)
        env.physics.touch_sensors = lambda pressure=pressure: pressure
        assert env.task.reward_terms(env.physics)["touch"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("task", "speed", "expected"),
    [
        *(("walk", 1.0, 1.0), ("walk", 2.0, 1.0), ("walk", 2.5, 0.6), ("walk", -1.0, 0.2)),
        *(("trot", 1.5, 0.6), ("trot", 6.0, 1.0), ("run", 4.5, 0.6), ("run", 9.0, 1.0)),
    ],
)
def test_moving_forward_is_rewarded_up_to_twice_the_speed(
    task: str, speed: float, expected: float
) -> None:
    for tilt in (0.0, 0.4):
        # Along the torso, wherever it points.
        assert terms_of(task, 1.0, tilt, speed)["forward"] == pytest.approx(expected)


def test_the_ball_is_fetched_with_the_mouth() -> None:
    env = suite.load("dog", "fetch", {"random": 0})
    physics = env.physics
    set_root(physics, 0.42)
    mouth = physics.named.data.site_xpos[["upper_bite", "lower_bite"]].mean(axis=0)
    near_target, far = [0.15, 0.0, 0.03], [5.0, 5.0, 0.03]  # within two radii of the target
    for place, least, most, fetched in (
        (mouth, 0.8, 0.999, None),
        (near_target, 1.0, 1.0, True),
        (far, 0.0, 0.3, False),
    ):
        physics.named.data.qpos["ball_root"][:3] = place
        physics.forward()
        terms = env.task.reward_terms(physics)
        assert least <= terms["reach_ball"] <= most
        assert terms["fetch_ball"] >= 0.5
        if fetched is not None:
            assert env.task.is_success(terms) == fetched


def test_the_ball_is_seen_from_the_head() -> None:
    env = suite.load("dog", "fetch", {"random": 0})
    physics = env.physics
    set_root(physics, 0.42)
    physics.named.data.qvel["root"][:3] = 0.0, 1.0, 0.0
    physics.named.data.qvel["ball_root"][:3] = 1.0, 0.0, 2.0
    physics.forward()
    head = physics.named.data.site_xmat["head"].reshape(3, 3)
    place = physics.named.data.geom_xpos["ball"] - physics.named.data.site_xpos["head"]
    expected = np.concatenate([place @ head, np.array([1.0, -1.0, 2.0]) @ head])
    # Rounded on its way through the spatial velocity.
    np.testing.assert_allclose(physics.ball_in_head_frame(), expected, atol=1e-12)


def test_a_start_is_the_default_pose_turned_and_thrown_with_any_activation() -> None:
    env = suite.load("dog", "fetch", {"random": 0})
    model, seen = env.physics.model, []
    for _ in range(100):
        env.reset()
        data = env.physics.named.data
        np.testing.assert_array_equal(data.qpos["root"][:3], model.qpos0[:3])
        np.testing.assert_array_equal(env.physics.joint_angles(), np.zeros(73))
        assert abs(data.xmat["torso", "zz"]) == pytest.approx(1.0)
        assert not data.qvel["root"][2:5].any()
        ball, velocity = data.qpos["ball_root"][:3], data.qvel["ball_root"][:3]
        assert np.linalg.norm(ball[:2]) == pytest.approx(7.5)
        assert 0 <= velocity[2] <= np.sqrt(2 * 9.81 * 3)
        assert velocity[:2] @ ball[:2] <= 0
        assert abs(env.physics.activation()).max() <= 1
        seen.append([*data.qvel["root"][[0, 1, 5]], data.xmat["torso", "xx"]])
    spread = np.std(seen, axis=0)
    assert (abs(spread[:3] - 2) < 0.5).all()
    assert spread[3] == pytest.approx(np.sqrt(0.5), abs=0.1)


def test_factors_are_observed_on_request_and_named_by_subclasses_or_numbered() -> None:
    class Calm(dog.Move):
        def get_reward_factors(self, physics: Any) -> np.ndarray:
            return np.append(super().get_reward_factors(physics), 0.5)

    physics = suite.load("dog", "walk").physics
    move = dog.Move(1, random=0, observe_reward_factors=True)
    factors = move.get_observation(physics)["reward_factors"]
    assert list(move.reward_terms(physics)) == list(dog.Move.FACTORS)
    np.testing.assert_array_equal(list(move.reward_terms(physics).values()), factors)
    calm = Calm(1, random=0)
    assert calm.reward_terms(physics)["factor_7"] == 0.5
    assert calm.get_reward(physics) == move.get_reward(physics) * 0.5


def test_the_floor_and_what_is_on_it_are_chosen() -> None:
    physics = dog.Physics.from_xml_string(*dog.get_model_and_assets(3, remove_ball=False))
    np.testing.assert_array_equal(physics.named.model.geom_size["floor"], [3, 3, 0.1])
    assert physics.model.ncam == 4
    bare = suite.load("dog", "run").physics.model
    assert (bare.geom_size[0, 0], bare.ncam, bare.nmesh, bare.nskin) == (135, 2, 0, 0)
    with pytest.raises(ValueError, match="ball"):
        bare.name2id("ball", "geom")


def test_every_part_that_collides_is_drawn() -> None:
    model = suite.load("dog", "fetch").physics.model
    collides = (model.geom_contype | model.geom_conaffinity) > 0
    assert (model.geom_group[collides] < 3).all()  # MuJoCo draws the groups 0 to 2
    assert mujoco.mjtGeom.mjGEOM_MESH not in model.geom_type
