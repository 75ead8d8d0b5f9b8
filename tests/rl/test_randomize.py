"""Domain randomisation: rows draw like single environments, and starts do not change."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.randomize import scale, shift, show_drawn, stream_beside
from tests.representatives import REPRESENTATIVES

_RANDOMIZE = {
    "geom_friction": scale(0.7, 1.3),
    "body_mass": scale(0.8, 1.2),
    "actuator_gear": scale(0.9, 1.1),
    "opt.gravity": shift([-1, 0, -1], [1, 0, 1]),
}
_ENVIRONMENT = {"randomize": _RANDOMIZE}


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_a_row_draws_and_moves_as_the_single_environment(task: tuple[str, str]) -> None:
    limit = {"time_limit": 15 * (0.025 if task[0] == "humanoid" else 0.01)}
    batch = suite.load_batch(*task, 3, 2, 5, limit, _ENVIRONMENT)
    singles = [suite.load(*task, {"random": 5 + i, **limit}, _ENVIRONMENT) for i in range(3)]
    batched, told = batch.reset(), [env.reset() for env in singles]
    for step in range(50):
        for row, (env, single) in enumerate(zip(singles, told, strict=True)):
            for name, value in single.observation.items():
                np.testing.assert_array_equal(batched.observation[name][row], value, f"step {step}")
            for name, value in env.randomization.items():
                np.testing.assert_array_equal(batch.randomization[name][row], value)
        action = np.random.RandomState(step).uniform(-1, 1, batch.action_spec().shape)
        batched = batch.step(action)
        told = [env.step(a) for env, a in zip(singles, action, strict=True)]


@pytest.mark.parametrize("task", [("stacker", "stack_4"), ("manipulator", "insert_peg")])
def test_sizes_differ_by_row_in_the_reward_too(task: tuple[str, str]) -> None:
    environment = {"randomize": {"geom_size": scale(0.9, 1)}}
    batch = suite.load_batch(*task, 3, 2, 5, environment_kwargs=environment)
    batch.reset()
    reward = batch.step(np.zeros((3, 5))).reward
    for row in range(3):
        env = suite.load(*task, {"random": 5 + row}, environment)
        env.reset()
        assert env.step(np.zeros(5)).reward == reward[row]


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_starts_stay_those_without_randomisation(task: tuple[str, str]) -> None:
    plain, randomized = (
        suite.load(*task, {"random": 1}),
        suite.load(*task, {"random": 1}, _ENVIRONMENT),
    )
    for _ in range(3):
        plain.reset()
        randomized.reset()
        np.testing.assert_array_equal(plain.physics.position(), randomized.physics.position())


def test_draws_lie_within_their_bounds_differ_by_episode_and_reach_the_model() -> None:
    env = suite.load("humanoid", "stand", {"random": 0}, _ENVIRONMENT)
    nominal = env.physics.model.body_mass.copy()
    seen = []
    for _ in range(3):
        env.reset()
        mass = env.randomization["body_mass"]
        np.testing.assert_array_equal(env.physics.model.body_mass, mass)
        ratio = mass[1:] / nominal[1:]
        assert ratio.min() >= 0.8
        assert ratio.max() <= 1.2
        assert env.physics.model.body_subtreemass[0] == pytest.approx(mass.sum())  # set_const
        seen.append(mass)
    assert not np.array_equal(seen[0], seen[1])


def test_other_environments_keep_their_model() -> None:
    one = suite.load("humanoid", "stand", {"random": 0})
    before = one.physics.model.body_mass.copy()
    suite.load("humanoid", "stand", {"random": 0}, _ENVIRONMENT).reset()
    np.testing.assert_array_equal(one.physics.model.body_mass, before)


def test_the_stream_for_model_fields_depends_on_the_tasks_and_does_not_advance_it() -> None:
    stream, twin = np.random.RandomState(3), np.random.RandomState(3)
    assert stream_beside(stream).rand() == stream_beside(twin).rand()
    assert stream.rand() == twin.rand()
    assert stream_beside(stream).rand() != stream_beside(np.random.RandomState(3)).rand()


@pytest.mark.parametrize(
    ("randomize", "error", "message"),
    [
        ({"geom_frictio": scale(1, 2)}, ValueError, "Did you mean 'geom_friction'"),
        ({"geom_type": scale(1, 2)}, ValueError, "part of the model's structure"),
        ({"opt.timestep": scale(1, 2)}, ValueError, "part of the model's structure"),
        ({"body_mass": 3}, TypeError, "expected scale"),
        ({"body_mass": scale}, TypeError, "expected scale"),
        (["body_mass"], TypeError, "expected a mapping"),
        ({"body_mass": lambda random, nominal: 1.0}, ValueError, r"shape \(\); expected .*\(17,\)"),
        ({"body_mass": lambda random, nominal: nominal * np.nan}, ValueError, "finite"),
    ],
)
def test_fields_that_cannot_be_randomised_are_refused(
    randomize: Any, error: Any, message: str
) -> None:
    with pytest.raises(error, match=message):
        suite.load("humanoid", "walk", environment_kwargs={"randomize": randomize}).reset()


def test_scale_draws_one_factor_for_each_object_and_shift_one_amount_for_each_number() -> None:
    stream = np.random.RandomState(0)
    nominal = np.arange(1.0, 13.0).reshape(4, 3)
    factors = scale(0.5, 2.0)(stream, nominal) / nominal
    np.testing.assert_allclose(factors, np.repeat(factors[:, :1], 3, axis=1))  # rounding
    assert len(np.unique(factors[:, 0])) == 4
    amounts = shift([0, 10, 20], [1, 11, 21])(stream, nominal) - nominal
    assert len(np.unique(amounts)) == 12
    assert ((amounts > [0, 10, 20]) & (amounts < [1, 11, 21])).all()


def test_a_draw_that_writes_to_the_models_values_does_not_change_the_next_draws() -> None:
    def doubled(random: np.random.RandomState, nominal: np.ndarray) -> np.ndarray:
        nominal *= 2
        return nominal

    env = suite.load("humanoid", "stand", {"random": 0}, {"randomize": {"body_mass": doubled}})
    plain = suite.load("humanoid", "stand", {"random": 0}).physics.model.body_mass
    for _ in range(2):
        env.reset()
        np.testing.assert_array_equal(env.randomization["body_mass"], 2 * plain)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_draw_with_one_number_that_is_not_finite_is_refused(bad: float) -> None:
    def spoilt(random: np.random.RandomState, nominal: np.ndarray) -> np.ndarray:
        nominal[3] = bad
        return nominal

    env = suite.load("humanoid", "stand", {"random": 0}, {"randomize": {"body_mass": spoilt}})
    with pytest.raises(
        ValueError, match=rf"(?s)'body_mass'\] drew .*{bad}.* expected finite numbers"
    ):
        env.reset()


@pytest.mark.parametrize(
    "draw",
    [scale("a", 1), shift([1, 2], [3, 4]), scale(np.inf, np.inf), lambda random: 1.0],  # pyright: ignore[reportArgumentType]
)
def test_a_draw_that_raises_is_named_with_its_field(draw: Any) -> None:
    env = suite.load("humanoid", "stand", None, {"randomize": {"body_mass": draw}})
    with pytest.raises((TypeError, ValueError), match=r"randomize\['body_mass'\], which is "):
        env.reset()


def test_a_draw_of_another_shape_is_refused_though_it_has_as_many_numbers() -> None:
    options = {"randomize": {"geom_friction": lambda random, nominal: nominal.T}}
    env = suite.load("humanoid", "stand", {"random": 0}, options)
    with pytest.raises(ValueError, match=r"shape \(3, (\d+)\); expected .* shape \(\1, 3\)"):
        env.reset()


def test_the_stream_for_model_fields_depends_on_the_position_of_the_tasks() -> None:
    stream = np.random.RandomState(3)
    stream.rand()
    first = stream_beside(stream).rand()
    stream.rand()  # the same 624 numbers as before, at another position
    assert stream_beside(stream).rand() != first


def test_drawn_values_are_shown_in_the_rows_they_belong_to() -> None:
    shown: dict[str, np.ndarray] = {}
    show_drawn(shown, {"opt.gravity": np.array([1.0, 2.0])}, 1, num_envs=3)
    assert shown["opt.gravity"].tolist() == [[0, 0], [1, 2], [0, 0]]
    array = shown["opt.gravity"]
    show_drawn(shown, {"opt.gravity": np.array([[3.0, 4.0], [5.0, 6.0]])}, np.array([0, 2]), 3)
    assert array.tolist() == [[3, 4], [1, 2], [5, 6]]


def test_constants_that_follow_from_drawn_fields_differ_by_row() -> None:
    batch = suite.load_batch("humanoid", "stand", 3, 2, 5, environment_kwargs=_ENVIRONMENT)
    assert batch.physics.model.body_subtreemass.shape == (3, 17)  # read before they are drawn
    batch.reset()
    for seeds in ([5, 6, 7], [9, 6, 8]):
        batch.reset(seeds=seeds)
        for row, seed in enumerate(seeds):
            env = suite.load("humanoid", "stand", {"random": seed}, _ENVIRONMENT)
            env.reset()
            for name in ("body_subtreemass", "dof_invweight0", "body_inertia"):
                found = getattr(batch.physics.model, name)
                expected = getattr(env.physics.model, name)
                np.testing.assert_array_equal(
                    found[row] if found.ndim > expected.ndim else found, expected
                )
            torso = env.physics.named.model.body_subtreemass["torso"]
            assert batch.physics.named.model.body_subtreemass["torso"][row] == torso
    with pytest.raises(ValueError, match="MuJoCo computes it from fields that differ by row"):
        batch.physics.model.body_subtreemass[0] = 1.0
