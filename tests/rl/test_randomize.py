"""Domain randomisation: rows and single environments draw the same, and starts stay the same."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.randomize import scale, shift, stream_beside

_RANDOMIZE = {
    "geom_friction": scale(0.7, 1.3),
    "body_mass": scale(0.8, 1.2),
    "actuator_gear": scale(0.9, 1.1),
    "opt.gravity": shift([-1, 0, -1], [1, 0, 1]),
}
_ENVIRONMENT = {"randomize": _RANDOMIZE}


@pytest.mark.parametrize("task", suite.ALL_TASKS, ids="-".join)
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


@pytest.mark.parametrize("task", suite.ALL_TASKS, ids="-".join)
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


def test_the_stream_beside_follows_from_the_other_and_leaves_it_alone() -> None:
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
def test_what_cannot_be_randomised_is_said(randomize: Any, error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        suite.load("humanoid", "walk", environment_kwargs={"randomize": randomize}).reset()
