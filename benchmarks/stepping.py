"""Steps per second of one environment, and the overhead of a step over the physics.

Limberjack, dm_control and the bare MuJoCo calls run the same episodes, alternating in blocks of
steps in a rotating order. Comparisons always use the times of the same steps within the same
fraction of a second; at the end of each episode the three must be in the same state.
"""

import copy
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import peers
from report import Bar, Row, at_least, at_most, compared, mean_of, rates

from limberjack.rl.action_specs import bounds_to_try

__all__ = ["Contest", "measure"]

_STEPS_PER_BLOCK = 25
_SEED = 0

_FASTER = at_least(1.1)  # steps per second over dm_control's, on each task
_FASTER_ON_AVERAGE = at_least(1.3)  # the geometric mean of all tasks
_SHARE_OF_OVERHEAD = at_most(0.5)  # overhead over MuJoCo's calls, relative to dm_control's

_BARE = "bare"


def measure(tasks: Sequence[tuple[str, str]], num_episodes: int, num_steps: int) -> list[Row]:
    """A row for each task, and one for their average.

    Args:
      tasks: the tasks to play.
      num_episodes: episodes of each task.
      num_steps: steps of each episode, at most its full length.
    """
    contests = [
        Contest(
            f"{domain}:{task}",
            {
                package: peers.suite(package).load(domain, task, {"random": _SEED})
                for package in peers.installed()
            },
        )
        for domain, task in tasks
    ]
    for _ in range(num_episodes):
        for contest in contests:
            contest.play(num_steps)
    speeds = [contest.speed_row("steps per second", _FASTER) for contest in contests]
    average = mean_of(speeds, "geometric mean", _FASTER_ON_AVERAGE)
    return [*speeds, average, *(contest.overhead_row() for contest in contests)]


class Contest:
    """One task, run by the installed packages and by MuJoCo alone."""

    def __init__(self, subject: str, environments: Mapping[str, Any]) -> None:
        """Takes the task's name, and an environment of each package."""
        self._subject, self._environments = subject, environments
        self._model: Any = None
        self._data: Any = None
        environment = self._environments[peers.OURS]
        self._spec = environment.action_spec()
        self._num_substeps = round(environment.control_timestep() / environment.physics.timestep())
        self._random = np.random.RandomState(_SEED)
        # Seconds per step of each block.
        self._seconds: dict[str, list[float]] = {name: [] for name in (*self._environments, _BARE)}

    def play(self, num_steps: int) -> None:
        """Runs an episode."""
        low, high = bounds_to_try(self._spec)
        actions = self._random.uniform(low, high, (num_steps, *self._spec.shape))
        for environment in self._environments.values():
            environment.reset()
        self._become(self._environments[peers.OURS].physics)
        players: list[tuple[str, Callable[[Sequence[Any]], float]]] = [
            *((name, _player(env)) for name, env in self._environments.items()),
            (_BARE, self._play_bare),
        ]
        for start in range(0, num_steps, _STEPS_PER_BLOCK):
            block = list(actions[start : start + _STEPS_PER_BLOCK])
            for name, play in players:
                self._seconds[name].append(play(block) / len(block))
            players.append(players.pop(0))
        for name, environment in self._environments.items():
            if not np.array_equal(environment.physics.data.qpos, self._data.qpos):
                raise RuntimeError(f"{self._subject}: {name} did not do the same steps")

    def _become(self, physics: Any) -> None:
        """Sets the bare simulation to a physics' state."""
        model, data = physics.model._official, physics.data._data
        self._model = copy.copy(model)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_copyData(self._data, self._model, data)

    def _play_bare(self, actions: Sequence[Any]) -> float:
        """Seconds for MuJoCo's calls alone."""
        model, data, num_whole = self._model, self._data, self._num_substeps - 1
        is_split = model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4.value
        seconds = 0.0
        for action in actions:
            data.ctrl[:] = action
            start = time.perf_counter()
            if is_split:
                mujoco.mj_step2(model, data)
                mujoco.mj_step(model, data, num_whole)
            else:
                mujoco.mj_step(model, data, num_whole + 1)
            mujoco.mj_step1(model, data)
            seconds += time.perf_counter() - start
        return seconds

    def speed_row(self, measure: str, bar: Bar) -> Row:
        """Steps per second, beside dm_control's."""
        ours, theirs = (rates(self._seconds.get(n, [])) for n in (peers.OURS, peers.THEIRS))
        return compared(measure, self._subject, ours, theirs, "/s", bar)

    def overhead_row(self) -> Row:
        """Overhead of a step over MuJoCo's calls."""
        added = {
            name: [a - b for a, b in zip(self._seconds[name], self._seconds[_BARE], strict=True)]
            for name in self._environments
        }
        micro = {name: statistics.median(values) * 1e6 for name, values in added.items()}
        ours, theirs = micro[peers.OURS], micro.get(peers.THEIRS)
        return Row(
            measure="added to MuJoCo's calls",
            subject=self._subject,
            ours=ours,
            theirs=theirs,
            unit="us",
            value=None if theirs is None else ours / theirs,
            bar=_SHARE_OF_OVERHEAD,
            details={"bare_us": 1e6 * statistics.median(self._seconds[_BARE])},
        )


def _player(environment: Any) -> Callable[[Sequence[Any]], float]:
    """A function that returns the seconds taken by steps with the given actions."""

    def play(actions: Sequence[Any]) -> float:
        start = time.perf_counter()
        for action in actions:
            environment.step(action)
        return time.perf_counter() - start

    return play
