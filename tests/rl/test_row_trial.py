"""An environment is examined before the rows of a batch are made."""

import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import guards
from limberjack.rl.action_specs import spec_of
from limberjack.rl.builds import Build
from limberjack.rl.control import Environment
from limberjack.rl.row_trial import Trial, control_timestep_of, draws_globally
from limberjack.suite import cartpole


def _load(seed: int) -> Environment:
    return suite.load("cartpole", "swingup", {"random": seed, "time_limit": 0.1})


class _Drawing(Environment):
    own = np.random.RandomState(3)
    newer = np.random.default_rng(3)
    plain = random.Random(3)
    draw: Any = None  # a function without arguments

    def step(self, action: Any) -> Any:
        type(self).draw()
        return super().step(action)


_DRAWS: list[tuple[Callable[[], float], str]] = [
    (lambda: np.random.uniform(), "NumPy's global stream"),
    (lambda: random.random(), "the stream of random"),
    (lambda: _Drawing.own.uniform(), "_Drawing.own"),
    (lambda: _Drawing.newer.uniform(), "_Drawing.newer"),
    (lambda: _Drawing.plain.random(), "_Drawing.plain"),
]


def _states() -> list[object]:
    key = np.random.get_state(legacy=False)["state"]["key"].tolist()
    return [key, random.getstate(), _Drawing.plain.getstate()]


@pytest.mark.parametrize(("draw", "name"), _DRAWS)
def test_a_shared_stream_that_is_drawn_from_is_named_and_put_back(
    draw: Callable[[], float], name: str
) -> None:
    env = _load(0)
    drawing = _Drawing(env.physics, env.task, time_limit=0.1)
    drawing.reset()
    states = [
        np.random.get_state(legacy=False)["state"]["key"].tolist(),
        random.getstate(),
        _Drawing.plain.getstate(),
    ]
    newer = _Drawing.newer.bit_generator.state
    _Drawing.draw = staticmethod(draw)  # pyright: ignore[reportAttributeAccessIssue]
    assert draws_globally(drawing, spec_of(env)) == name
    assert states == _states()
    assert _Drawing.newer.bit_generator.state == newer


def test_the_tasks_own_stream_is_not_shared() -> None:
    env = _load(0)
    assert draws_globally(env, spec_of(env)) is None


def test_a_row_with_other_specs_is_named_with_its_context() -> None:
    trial = Trial(Build.of(_load), 0, {}, 2)
    trial.compare(_load(1), 1, {})
    other = suite.load("cartpole", "two_poles", {"random": 1})
    with pytest.raises(ValueError, match=r"row 2, made with \{'poles': 2\}, has observation 'pos"):
        trial.compare(other, 2, {"poles": 2})
    slower = Environment(_load(0).physics, _load(0).task, n_sub_steps=3)
    with pytest.raises(ValueError, match=r"row 1 has control step of 0\.03; expected 0\.01"):
        trial.compare(slower, 1, {})
    trial.close()


def test_an_environment_in_two_rows_is_refused() -> None:
    env = _load(0)
    trial = Trial(Build.of(_load), 0, {}, 2)
    trial.compare(env, 0, {})
    with pytest.raises(ValueError, match=r"row 1 has the \w+ of another environment"):
        trial.compare(env, 1, {})
    trial.close()


class _EditsItsModel(cartpole.Balance):
    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        physics.model.geom_friction[0, 0] = self.random.uniform()


def test_models_that_starts_edit_count_as_memory_of_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guards, "_memory", lambda: 2**26)  # bytes: a model takes 2**23 or more

    def edits(seed: int) -> Environment:
        task = _EditsItsModel(swing_up=False, sparse=False, random=seed)
        return Environment(_load(seed).physics, task, time_limit=0.1)

    Trial(Build.of(_load), 0, {}, 64).close()
    Trial(Build.of(edits), 0, {}, 2).close()
    with pytest.raises(MemoryError, match="num_envs is 64, which takes"):
        Trial(Build.of(edits), 0, {}, 64)


def test_an_environment_without_a_control_step_has_none() -> None:
    class Bare:
        pass

    assert np.isnan(control_timestep_of(Bare()))  # pyright: ignore[reportArgumentType]
    assert control_timestep_of(_load(0)) == 0.01
