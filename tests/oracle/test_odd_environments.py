"""Tasks that remember, and subclasses of `Environment`, behave as on dm_control's own classes."""

import collections
from typing import Any

import numpy as np
import pytest

from tests.rl import odd_environments as odd

from .oracle import BOTH, theirs
from .same import assert_same

pytestmark = pytest.mark.oracle

_TASKS = (
    odd.Pole,
    odd.LastAction,
    odd.KeepsTheCallersArray,
    odd.Counting,
    odd.Queues,
    odd.Noisy,
    odd.Perturbed,
    odd.Potential,
    odd.Curriculum,
    odd.Slotted,
    odd.Constrained,
)


def _made(package: Any, task: Any, kind: Any = None) -> Any:
    kind = package("rl.control").Environment if kind is None else kind
    physics = package("mujoco").Physics
    if package is theirs:  # the tasks are ours, and set the controls of a simulation
        physics = type("Physics", (physics,), {"simulation": property(lambda self: self.data)})
    return odd.environment(task, 3, kind, physics)


def _delaying(package: Any) -> Any:
    class Delaying(package("rl.control").Environment):
        def reset(self) -> Any:
            time_step = super().reset()
            self.waiting = collections.deque([time_step.observation] * 3, maxlen=3)
            return time_step

        def step(self, action: Any) -> Any:
            time_step = super().step(action)
            if time_step.first():
                return time_step
            self.waiting.append(time_step.observation)
            return time_step._replace(observation=self.waiting[0])

    return Delaying


def _resetting(package: Any) -> Any:
    class Resetting(package("rl.control").Environment):
        resets = 0

        def reset(self) -> Any:
            self.resets += 1
            self.physics.model.body_mass[1] = self.task.random.uniform(0.1, 2.0)
            time_step = super().reset()
            observation = {**time_step.observation, "resets": np.array([self.resets])}
            return time_step._replace(observation=observation)

    return Resetting


def _ending(package: Any) -> Any:
    class Ending(package("rl.control").Environment):
        """Ends episodes itself, in the way that programs do."""

        def step(self, action: Any) -> Any:
            time_step = super().step(action)
            if time_step.mid() and time_step.observation["velocity"][0] > 0.5:
                self._reset_next_step = True
                return time_step._replace(step_type=type(time_step.step_type).LAST, discount=0.0)
            return time_step

    return Ending


def _wrapping(package: Any) -> Any:
    class Wrapping(package("rl.control").Environment):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            self._env = package("rl.control").Environment(*args, **kwargs)
            self._colours = np.random.RandomState(0)

        def __getattr__(self, name: str) -> Any:
            if name.startswith("__") or "_env" not in vars(self):
                raise AttributeError(name)
            return getattr(self._env, name)

        def reset(self) -> Any:
            return self._changed(self._env.reset())

        def step(self, action: Any) -> Any:
            time_step = self._env.step(action)
            return self.reset() if time_step.first() else self._changed(time_step)

        def _changed(self, time_step: Any) -> Any:
            colour = self._colours.uniform(size=4)
            self._env.physics.model.geom_rgba[0] = colour
            return time_step._replace(observation={**time_step.observation, "colour": colour})

    return Wrapping


@pytest.mark.parametrize("task", _TASKS)
def test_a_task_that_remembers_gives_the_same_numbers(task: Any) -> None:
    _assert_equal_episodes(*(_made(package, task) for package in BOTH))


@pytest.mark.parametrize("kind", [_delaying, _resetting, _ending, _wrapping])
@pytest.mark.parametrize("task", [odd.LastAction, odd.Counting, odd.Noisy])
def test_a_subclass_gives_the_same_numbers(kind: Any, task: Any) -> None:
    _assert_equal_episodes(*(_made(package, task, kind(package)) for package in BOTH))


def _assert_equal_episodes(ours: Any, theirs: Any) -> None:
    for number, action in enumerate(odd.actions_of(3 * odd.STEPS, 1)[:, 0]):
        if number == 2 * odd.STEPS + 2:  # in the middle of an episode
            assert_same(ours.reset(), theirs.reset(), "a reset")
        mine, expected = ours.step(action), theirs.step(action)
        assert_same(mine._replace(observation={}), expected._replace(observation={}), str(number))
        assert_same(dict(mine.observation), dict(expected.observation), f"step {number}")
