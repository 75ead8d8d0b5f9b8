"""Kinds of comparisons with dm_control, each a function of a task that counts what it compares.

    tally = KINDS["episodes"].compare(("humanoid", "walk"), 0)
    print(tally.comparisons, tally.steps)

Every function compares the time steps of both packages bit by bit. A difference is an
AssertionError that names the task, seed, step, field and values.
"""

import copy
import dataclasses
import inspect
import itertools
import pickle
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple
from unittest import mock

import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode

from limberjack import gym
from limberjack.mujoco import batch_simulation
from limberjack.rl.randomize import scale
from tests.oracle import twins
from tests.oracle.oracle import BOTH, ours, theirs
from tests.oracle.rows import Between, Play, Rows, first_difference

__all__ = ["KINDS", "SEEDS", "Kind", "Tally", "Task", "self_check"]

Task = tuple[str, str]

SEEDS = 5
_EPISODES, _EPISODE_STEPS = 2, 1000
_SIZES, _THREADS, _MODES = (1, 5, 64, 200), (1, 2), tuple(AutoresetMode)
_STEPS = 300  # of rows, and of each argument
_FEW = 5  # rows
_SEED = 100  # of rows; those of whole episodes begin at 0

_OF_EVERY_FACTORY = ("time_limit", "random", "environment_kwargs")
_RANDOMIZE = {
    "geom_size": scale(0.95, 1.05),
    "site_size": scale(0.5, 1.5),
    "body_mass": scale(0.8, 1.2),
}


@dataclasses.dataclass
class Tally:
    """Numbers of compared environments or batches, and of their time steps."""

    comparisons: int = 0
    steps: int = 0

    def add(self, steps: int) -> None:
        """Counts one comparison."""
        self.comparisons += 1
        self.steps += steps

    def add_rows(self, found: Rows, expected: Rows, where: str) -> None:
        """Compares rows and counts them."""
        difference = first_difference(found, expected)
        assert not difference, f"{where}: {difference}"
        self.add(expected.fields["kind"].size)


class Kind(NamedTuple):
    """A kind of comparison.

    Attributes:
      compare: the comparison of a part of a task.
      parts: number of parts of a task.
      steps: what a part costs, as a number of steps of single environments.
    """

    compare: Callable[[Task, int], Tally]
    parts: int
    steps: int


# Called with the pair at every step of an episode.
_Disturb = Callable[[twins.Twins], None]


def _episodes(task: Task, part: int, disturb: _Disturb | None = None) -> Tally:
    """Whole episodes of one seed, with random, zero and bang-bang actions."""
    tally, seed = Tally(), part
    for actions in twins.ACTIONS:
        env = _whole_episodes(task, seed)
        policy, where = env.actions(actions, seed), env.where
        for episode in range(_EPISODES):
            env.where = f"{where}, {actions} actions, episode {episode}"
            env.reset()
            for action in policy:
                if disturb is not None:
                    disturb(env)
                if env.step(action).last():
                    break
            env.assert_same_physics("data.qpos", "data.qvel")
            tally.add(env.step_count)
    return tally


def _whole_episodes(task: Task, seed: int) -> twins.Twins:
    """The task with episodes of 1,000 steps, also where they have no limit."""
    env = twins.load(*task, seed)
    if env.ours.step_limit is not None:
        return env
    limit = _EPISODE_STEPS * env.ours.control_timestep()
    return twins.load(*task, seed, task_kwargs={"time_limit": limit})


def _batches(task: Task, part: int) -> Tally:
    """Batches of every size on every number of threads in every autoreset mode.

    Rows of the largest share an `MjData`, as otherwise only those of still larger ones do.
    """
    tally = Tally()
    play = Play(task, _SEED, _STEPS)
    expected = play.of_dm_control(range(max(_SIZES)))
    for num_envs, threads, mode in itertools.product(_SIZES, _THREADS, _MODES):
        where = f"{play.where}, {num_envs} rows, {threads} threads, {mode.value}"
        with mock.patch.object(batch_simulation, "_A_FEW", max(_SIZES) - 1):
            found = play.of_batch(num_envs, threads, mode)
        tally.add_rows(found, expected.some(range(num_envs)), where)
    return tally


def _arguments(task: Task, part: int) -> Tally:
    """Every keyword argument, of one environment and of a batch."""
    tally = Tally()
    for kwargs, environment_kwargs in _variants(task):
        play = Play(task, _SEED, _STEPS, 120, kwargs, environment_kwargs)
        where = f"{play.where}, {kwargs}, {environment_kwargs}"
        is_accepted = [_is_accepted(play, package) for package in BOTH]
        assert is_accepted[0] == is_accepted[1], f"{where}: accepted {is_accepted}"
        if not is_accepted[0]:
            tally.add(0)
            continue
        env = _pair(play, where, lambda: np.random.RandomState(_SEED))
        tally.add(_steps(env))
        tally.add_rows(play.of_batch(_FEW, 2), play.of_dm_control(range(_FEW)), where)
    shown = twins.load(*task, _SEED, visualize_reward=True)
    shown.where += ", visualize_reward"
    tally.add(_steps(shown, "model.mat_rgba"))
    return tally


def _variants(task: Task) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Arguments of the factory and of the environment: one at a time, then together."""
    factory = getattr(theirs("suite"), task[0]).SUITE[task[1]]
    made = theirs("suite").load(*task)
    changed = {}
    for name, parameter in inspect.signature(factory).parameters.items():
        if name not in _OF_EVERY_FACTORY and isinstance(parameter.default, bool | int):
            default = parameter.default
            changed[name] = not default if isinstance(default, bool) else default + 1
    yield {"time_limit": 33.3 * made.control_timestep()}, {}
    yield {"time_limit": float("inf")}, {}
    for name, value in changed.items():
        yield {name: value}, {}
    for_environments = {"flat_observation": True, "legacy_step": False}
    for name, value in for_environments.items():
        yield {}, {name: value}
    yield changed, for_environments
    # Refused by most factories, which choose the control step themselves.
    yield {}, {"n_sub_steps": 3}
    yield {}, {"control_timestep": 2 * made.control_timestep()}


def _is_accepted(play: Play, package: Callable[[str], Any]) -> bool:
    try:
        play.load(package, 0)
    except (TypeError, ValueError):
        return False
    return True


def _pair(play: Play, where: str, random: Callable[[], Any]) -> twins.Twins:
    """The environments of both packages."""
    mine, yours = (play.load(package, random()) for package in BOTH)
    return twins.Twins(mine, yours, where)


def _steps(env: twins.Twins, *fields: str, between: Callable[[int], None] | None = None) -> int:
    """Plays steps across the ends of episodes; returns their number."""
    env.reset()
    for number, action in enumerate(itertools.islice(env.actions("mixed", _SEED), _STEPS)):
        if between is not None:
            between(number)
        env.step(action)
        env.assert_same_physics(*fields)
    return _STEPS


def _continuations(task: Task, part: int) -> Tally:
    """Pickles, copies and snapshots of environments and batches that have begun."""
    tally = Tally()
    play = Play(task, _SEED, _STEPS)
    env = _pair(play, f"{play.where}, continued", lambda: _SEED)

    def between(number: int) -> None:
        env.ours = _continued(number, env.ours, lambda: play.load(ours, 0))

    tally.add(_steps(env, between=between))
    expected = play.of_dm_control(range(_FEW))
    for turn, mode in enumerate(_MODES):
        found = play.of_batch(_FEW, 1 + turn % 2, mode, _continue_batch(play, 2 - turn % 2, mode))
        tally.add_rows(found, expected, f"{play.where}, {mode.value}, continued")
    return tally


def _continue_batch(play: Play, threads: int, mode: AutoresetMode) -> Between:
    """Replaces the environment, at times by one with another number of threads."""

    def another() -> gym.VectorEnv:
        made = play.make(_FEW, threads, mode)
        made.reset(seed=0)
        return made

    def between(number: int, envs: gym.VectorEnv) -> gym.VectorEnv:
        if number % 50 != 40:
            return _continued(number, envs, another)
        # Steps that are taken back; and a row by itself, through another row.
        batch = envs.batches[0]
        before = batch.snapshot()
        batch.step(np.zeros(batch.action_spec().shape))
        batch.copy_row(1, 3)
        batch.restore(before)
        return envs

    return between


def _continued(number: int, env: Any, another: Callable[[], Any]) -> Any:
    """Every ten steps another environment that continues this one."""
    if number % 50 == 10:
        return pickle.loads(pickle.dumps(env))
    if number % 50 == 20:
        return copy.deepcopy(env)
    if number % 50 != 30:
        return env
    made = another()
    parts = [(env, made)]
    if isinstance(env, gym.VectorEnv):
        parts = list(zip(env.batches, made.batches, strict=True))
    else:
        made.reset()
    for old, new in parts:
        new.restore(pickle.loads(pickle.dumps(old.snapshot())))
    return made


def _randomisation(task: Task, part: int) -> Tally:
    """Sizes and masses drawn for each episode, in batches and in dm_control's model."""
    tally = Tally()
    plain = Play(task, _SEED, _STEPS)
    play = dataclasses.replace(plain, environment_kwargs={"randomize": _RANDOMIZE})
    drawing: dict[int, Any] = {}

    def give(env: Any, row: int) -> None:
        if row not in drawing:
            drawing[row] = play.load(ours, _SEED + row)
        drawing[row].reset()
        for name, values in drawing[row].randomization.items():
            getattr(env.physics.model, name)[:] = values
        mujoco.mj_setConst(env.physics.model.ptr, env.physics.data.ptr)

    singles = play.of_singles(range(_FEW))
    if _has_the_same_fields(plain):
        expected = plain.of_dm_control(range(_FEW), before_episode=give)
        tally.add_rows(singles, expected, f"{play.where}, randomised")
    for turn, mode in enumerate(_MODES):
        found = play.of_batch(_FEW, 1 + turn % 2, mode)
        tally.add_rows(found, singles, f"{play.where}, randomised, {mode.value}")
    return tally


def _has_the_same_fields(play: Play) -> bool:
    """Whether drawn values fit into dm_control's model; its dog has other geoms."""
    models = [play.load(package, 0).physics.model for package in BOTH]
    return all(len({getattr(one, name).shape for one in models}) == 1 for name in _RANDOMIZE)


# A row's step costs half of an environment's.
_ROWS = sum(_SIZES) * len(_THREADS) * len(_MODES) // 2 + max(_SIZES)

KINDS = {
    "episodes": Kind(_episodes, SEEDS, 2 * len(twins.ACTIONS) * _EPISODES * _EPISODE_STEPS),
    "batches": Kind(_batches, 1, _ROWS * _STEPS),
    "arguments": Kind(_arguments, 1, 80 * _STEPS),
    "continuations": Kind(_continuations, 1, 50 * _STEPS),
    "randomisation": Kind(_randomisation, 1, 25 * _STEPS),
}


def self_check() -> dict[str, str]:
    """The differences that are found where the least change is planted into Limberjack's side.

    One coordinate of a task changes by one unit in the last place: of an environment in step 51 of
    an episode, and of one row of a batch.

    Raises:
      RuntimeError: a planted difference was not found.
    """
    task = ("humanoid", "walk")
    play = Play(task, steps=100)
    expected = play.of_dm_control(range(_FEW))

    def in_row(number: int, envs: gym.VectorEnv) -> gym.VectorEnv:
        if number == 50:
            _change(envs.batches[0].physics.data.qpos[2])
        return envs

    def in_episode(env: twins.Twins) -> None:
        if env.step_count == 50:
            _change(env.ours.physics.data.qpos)

    found = {"batches": first_difference(play.of_batch(_FEW, 2, between=in_row), expected)}
    try:
        _episodes(task, 0, in_episode)
    except AssertionError as error:
        found["episodes"] = str(error)
    for kind, where in {"batches": "row 2, step 51", "episodes": "step 51"}.items():
        if where not in found.get(kind, ""):
            raise RuntimeError(f"a difference planted into {kind} was not found: {found}")
    return found


def _change(positions: np.ndarray) -> None:
    positions[-1] = np.nextafter(positions[-1], np.inf)
