"""Checks of environments before their episodes are played."""

import contextlib
from typing import Any

import dm_env
import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.episodes.environments import (
    checked_environment,
    checked_repeat,
    inside,
    step_limit_of,
)
from limberjack.mujoco.fingerprint import fingerprint
from limberjack.rl import control
from limberjack.workers.factories import Make, factory_of
from tests import plain_domain
from tests.rl import odd_environments as odd


class _Global(plain_domain.Push):
    """Draws its starts from NumPy's global stream."""

    def initialize_episode(self, physics: Any) -> None:
        physics.data.qpos[:] = np.random.uniform(-1, 1)


def _of_task(task: Any, time_limit: float = 0.1) -> control.Environment:
    physics = plain_domain.push().physics
    return control.Environment(physics, task, time_limit=time_limit, control_timestep=0.02)


def _unseeded(seed: int) -> control.Environment:
    return plain_domain.push()


def _global(seed: int) -> control.Environment:
    return _of_task(_Global(seed))


def _longer(seed: int) -> control.Environment:
    return plain_domain.push(0.1 * (1 + seed), random=seed)


def _repeating(seed: int) -> control.Environment:
    return plain_domain.push(random=seed, environment_kwargs={"action_repeat": 3})


class _Nested(plain_domain.Push):
    def get_observation(self, physics: Any) -> Any:
        return {"arm": {"place": physics.data.qpos.copy()}, "speed": physics.data.qvel.copy()}


def _nested(seed: int) -> control.Environment:
    return _of_task(_Nested(seed))


def _catch(seed: int) -> dm_env.Environment:
    return odd.Catch(seed)


def test_the_environment_is_that_of_seed_0_and_has_the_length_of_the_others() -> None:
    factory = factory_of(plain_domain.make)
    with contextlib.closing(checked_environment(factory, [7, 8], is_kept=True)) as environment:
        made = plain_domain.make(0)
        first, expected = environment.reset(), made.reset()
        np.testing.assert_array_equal(first.observation["place"], expected.observation["place"])
        assert step_limit_of(environment) == 25


def test_an_environment_of_any_class_is_accepted() -> None:
    for make in (odd.nested, odd.distracting, odd.scaled):
        checked_environment(factory_of(make), [0, 1], is_kept=True).close()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (plain_domain.endless, "an episode might never end: give it a time_limit where it is made"),
        (_unseeded, "makes an environment that differs each time it is called with seed 0"),
        (_global, "draws from .*, so an episode does not depend on its seed alone: draw from task"),
        (
            _longer,
            "differs for seed 1: its episodes have 10 steps of 0.02 s, and those of seed 0 5",
        ),
        (_catch, "a Catch has no limberjack.rl.control.Environment inside, whose model, state"),
    ],
)
def test_an_environment_whose_episodes_cannot_be_promised_is_refused(
    make: Make, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        checked_environment(factory_of(make), [0, 1], is_kept=False)


def test_nested_observations_are_refused_with_the_name_of_the_environment() -> None:
    with pytest.raises(TypeError, match="observation 'arm' is a dict; expected an arr") as caught:
        checked_environment(factory_of(_nested), [0, 1], is_kept=False)
    assert caught.value.__notes__ == [f"environment '{__name__}:_nested'"]


def test_what_cannot_be_named_may_be_played_but_not_kept() -> None:
    factory = factory_of(lambda seed: plain_domain.make(seed))
    checked_environment(factory, [0], is_kept=False).close()
    with pytest.raises(
        ValueError, match="cannot be distinguished from other functions of that nam"
    ):
        checked_environment(factory, [0], is_kept=True)


def test_a_task_of_the_suite_without_an_end_is_refused() -> None:
    with pytest.raises(ValueError, match=r"give it a time_limit \(--time-limit SECONDS"):
        checked_environment(factory_of("lqr", "lqr_2_1"), [0], is_kept=False)
    checked_environment(factory_of("lqr", "lqr_2_1", 0.1), [0], is_kept=False).close()


def test_actions_are_repeated_as_asked_or_as_the_environment_does() -> None:
    actor = policies.find("zero")
    assert checked_repeat(None, plain_domain.make(0), actor) == 1
    assert checked_repeat(None, _repeating(0), actor) == 3
    assert checked_repeat(2, _repeating(0), actor) == 2
    for wrong in (0, True, 1.5):
        with pytest.raises((TypeError, ValueError), match="action_repeat is"):
            checked_repeat(wrong, plain_domain.make(0), actor)  # pyright: ignore


def test_the_planner_acts_at_every_control_step() -> None:
    environment = suite.load("manipulator", "bring_ball")
    planner = policies.find("planner", environment)
    assert checked_repeat(1, environment, planner) == 1
    repeating = suite.load("manipulator", "bring_ball", environment_kwargs={"action_repeat": 2})
    for repeat, one in ((2, environment), (None, repeating)):
        with pytest.raises(ValueError, match="'planner' acts at every control step: leave it at"):
            checked_repeat(repeat, one, planner)


def _remembering(seed: int) -> control.Environment:
    return odd.of_task(odd.LastAction, seed)


def test_vectorised_batches_are_refused_if_they_would_change_numbers() -> None:
    for factory in (factory_of(plain_domain.make), factory_of("humanoid", "walk")):
        checked_environment(factory, [0], is_kept=True, vectorised=True).close()
    own = factory_of(_remembering)
    with pytest.raises(ValueError, match=r"LastAction sets self\.last"):
        checked_environment(own, [0], is_kept=True, vectorised=True)
    for vectorised in (None, False):
        checked_environment(own, [0], is_kept=True, vectorised=vectorised).close()


def test_the_environment_that_identifies_results_is_the_same_for_all_seeds() -> None:
    factory = factory_of("lqr", "lqr_2_1", time_limit=0.3)  # whose model depends on the seed
    models = []
    for seeds in (range(2), range(64, 66)):
        with contextlib.closing(checked_environment(factory, seeds, is_kept=True)) as environment:
            models.append(fingerprint(inside(environment).physics.model._official))
    assert models[0] == models[1]
