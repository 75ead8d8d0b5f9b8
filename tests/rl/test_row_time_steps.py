"""Time steps of rows: the forms that environments may return, and arrays that never change."""

import collections
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, cast

import dm_env
import numpy as np
import pytest
from dm_env import specs

from limberjack import suite
from limberjack.rl.rows import RowsEnvironment

_ACTIONS = np.linspace(-1, 1, 3)[:, None]  # of three rows

_Observe = Callable[[Mapping[str, Any]], object]  # Any: values of an observation, also wrong ones


class _Longer(NamedTuple):
    """A time step with the action beside it, as some programs' wrappers return it."""

    step_type: dm_env.StepType
    reward: object
    discount: object
    observation: object
    action: object


class _Wrapper(dm_env.Environment):
    """Changes the observations, and returns longer time steps."""

    def __init__(self, seed: int, observe: _Observe = lambda given: given) -> None:
        self._env = suite.load("cartpole", "swingup", {"random": seed})
        self._observe = observe

    def _longer(self, time_step: dm_env.TimeStep, action: object) -> dm_env.TimeStep:
        observation = self._observe(time_step.observation)
        longer = _Longer(
            time_step.step_type, time_step.reward, time_step.discount, observation, action
        )
        return cast(dm_env.TimeStep, longer)

    def reset(self) -> dm_env.TimeStep:
        return self._longer(self._env.reset(), None)

    def step(self, action: Any) -> dm_env.TimeStep:  # Any: as dm_env declares it
        return self._longer(self._env.step(action), action)

    def observation_spec(self) -> Any:  # of dm_env: a nested structure
        return self._env.observation_spec()

    def action_spec(self) -> Any:  # of dm_env: a nested structure
        return self._env.action_spec()


def test_a_wrapper_may_return_time_steps_with_more_fields() -> None:
    rows = RowsEnvironment(_Wrapper, 3, 1, seed=0)
    plain = suite.load_batch("cartpole", "swingup", 3, 1, seed=0)
    for time_steps in ((rows.reset(), plain.reset()), (rows.step(_ACTIONS), plain.step(_ACTIONS))):
        ours, expected = time_steps
        np.testing.assert_array_equal(ours.reward, expected.reward)
        for name, values in expected.observation.items():
            np.testing.assert_array_equal(ours.observation[name], values)


@pytest.mark.parametrize(
    ("observe", "named"),
    [
        (lambda given: {"position": given["position"]}, "['position']"),
        (lambda given: {**given, "time": np.zeros(1)}, "['position', 'time', 'velocity']"),
        (lambda given: {"place": given["position"], "velocity": given["velocity"]}, "['place',"),
        (
            lambda given: collections.defaultdict(float, position=given["position"], speed=0.0),
            "['position', 'speed']",
        ),
    ],
)
def test_an_observation_with_other_names_is_refused(observe: _Observe, named: str) -> None:
    rows = RowsEnvironment(lambda seed: _Wrapper(seed, observe), 2, 1, seed=0)
    with pytest.raises(ValueError, match=r"expected \['position', 'velocity'\]") as raised:
        rows.reset()
    assert f"the observation has {named}" in str(raised.value)


@pytest.mark.parametrize("value", [np.zeros(2, np.float32), np.zeros(3), 0.0, None])
def test_an_observation_of_another_form_is_refused(value: object) -> None:
    def observe(given: Mapping[str, Any]) -> object:  # Any: values of an observation
        return {**given, "velocity": value}

    rows = RowsEnvironment(lambda seed: _Wrapper(seed, observe), 2, 1, seed=0)
    with pytest.raises(ValueError, match="observation 'velocity' has shape"):
        rows.reset()


def test_lists_and_numbers_of_the_form_of_the_spec_are_accepted() -> None:
    def observe(given: Mapping[str, Any]) -> object:  # Any: values of an observation
        return {name: values.tolist() for name, values in given.items()}

    rows = RowsEnvironment(lambda seed: _Wrapper(seed, observe), 2, 1, seed=0)
    expected = suite.load_batch("cartpole", "swingup", 2, 1, seed=0).reset().observation
    for name, values in rows.reset().observation.items():
        np.testing.assert_array_equal(values, expected[name])


def test_a_time_step_is_the_callers_own() -> None:
    def played(writes: bool) -> list[np.ndarray]:
        batch = suite.load_batch("cartpole", "swingup", 3, 1, seed=0, vectorised=False)
        seen = []
        for steps in (batch.reset(), *(batch.step(_ACTIONS) for _ in range(3)), batch.reset([1])):
            seen.append(steps.observation["position"].copy())
            if writes:
                for values in (*steps.observation.values(), steps.reward, steps.step_type):
                    values[:] = 7
        return seen

    np.testing.assert_array_equal(played(writes=True), played(writes=False))


def test_earlier_time_steps_never_change() -> None:
    batch = suite.load_batch("cartpole", "swingup", 3, 1, seed=0, vectorised=False)
    seen = [batch.reset()]
    kept = [seen[0].observation["position"].copy()]
    for _ in range(3):
        seen.append(batch.step(_ACTIONS))
        kept.append(seen[-1].observation["position"].copy())
    batch.reset([0])
    batch.copy_row(0, 2)
    np.testing.assert_array_equal([one.observation["position"] for one in seen], kept)


def test_specs_of_rows_have_a_leading_axis() -> None:
    rows = RowsEnvironment(_Wrapper, 2, 1, seed=0)
    spec = rows.observation_spec()["velocity"]
    assert isinstance(spec, specs.Array)
    assert spec.shape == (2, 2)
