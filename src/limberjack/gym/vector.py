"""`VectorEnv`: a batch of simulations as a `gymnasium.vector.VectorEnv`.

    envs = gym.load_vector("humanoid", "walk", num_envs=256, flat=True, dtype="float32")
    observations, info = envs.reset(seed=0)
    observations, rewards, terminated, truncated, info = envs.step(actions)    # (256, 21)

Row i is `Env` with seed `seed + i`, bit for bit. The time limit truncates; only the task and
divergence terminate. `autoreset_mode` decides what a step returns for a row whose episode has
ended; docs/batches.md explains it with a picture.

With `pipelined=True` the rows are two halves, which are stepped in turn, on a thread each, while
the policy computes the actions of the other half:

    observations, info = envs.reset(seed=0)
    for half, rows in enumerate(envs.halves):
        envs.send(policy(observations[rows]), half)
    for step in range(1000):
        for half in (0, 1):
            observations, rewards, terminated, truncated, info = envs.recv()  # the oldest half
            envs.send(policy(observations), half)
"""

import collections
import math
import os
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from copy import copy as copy_of
from typing import Any, Generic, SupportsIndex, TypeVar, cast

import numpy as np
import numpy.typing as npt
from gymnasium import error
from gymnasium import vector as gymnasium_vector
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from limberjack.gym import arguments, attributes
from limberjack.gym.observations import (
    AnyObservation,
    Info,
    Part,
    action_space,
    observations_of,
    specs_of_one_row,
)
from limberjack.gym.states import states_of_rows
from limberjack.gym.transitions import Step, Transitions
from limberjack.rl.batch_contract import Batch
from limberjack.rl.represented import represented

__all__ = ["VectorEnv", "Workers", "joined"]

_T = TypeVar("_T")  # arrays, or dicts of them
_R = TypeVar("_R")  # the result of a job


class Workers(Generic[_R]):
    """A thread for each half; results are received in the order in which jobs are sent."""

    def __init__(self, count: int) -> None:
        """Make `count` workers, without starting their threads."""
        self._count = count
        self._forget()

    def _forget(self) -> None:
        self._process = os.getpid()
        self._threads: dict[int, ThreadPoolExecutor] = {}
        self._sent: collections.deque[tuple[int, Future[_R]]] = collections.deque()
        self._turn = threading.Lock()

    @property
    def busy(self) -> list[int]:
        """The halves that were sent and not yet received, in that order."""
        if self._process != os.getpid():  # forked: threads stay in the parent
            self._forget()
        return [half for half, _ in self._sent]

    def check_idle(self) -> None:
        """Raise RuntimeError if a half was sent and not yet received."""
        if self.busy:
            raise RuntimeError(f"halves {self.busy} were sent: receive them with recv() first")

    def send(self, half: int, job: Callable[..., _R], *given: object) -> None:
        """Have a half's thread call `job(*given)`; it is not busy."""
        if half not in self._threads:
            self._threads[half] = ThreadPoolExecutor(1, f"limberjack-half-{half}")
        future = self._threads[half].submit(_in_turn, self._turn, job, given)
        self._sent.append((half, future))

    def receive(self) -> tuple[int, _R]:
        """The half that was sent first, and the result of its job, whose error it raises.

        Ctrl-C while it waits loses nothing: the next call waits for the same half.

        Raises:
          RuntimeError: no half was sent in this process.
        """
        if not self.busy:
            raise RuntimeError("nothing was sent in this process: call send() before recv()")
        half, future = self._sent[0]
        future.exception()  # waits
        self._sent.popleft()
        return half, future.result()

    def close(self) -> None:
        """Wait for running jobs and end the threads."""
        if self._process == os.getpid():
            for thread in self._threads.values():
                thread.shutdown()
        self._forget()

    def __getstate__(self) -> dict[str, int]:
        return {"count": self._count}

    def __setstate__(self, state: dict[str, int]) -> None:
        self.__init__(state["count"])


def _in_turn(turn: threading.Lock, job: Callable[..., _R], given: Iterable[object]) -> _R:
    with turn:
        return job(*given)


def joined(parts: Sequence[_T | None], sizes: Sequence[int]) -> _T:
    """Arrays, or equally named dicts of them, one after the other along the first axis.

    Args:
      parts: one for each half; None for a half without one, whose rows are zeros, or None in an
        array of objects.
      sizes: rows of each half.
    """
    given = next(part for part in parts if part is not None)
    if isinstance(given, dict):
        dicts = [part if isinstance(part, dict) else {} for part in parts]
        names = dict.fromkeys(name for part in dicts for name in part)
        named = {name: joined([part.get(name) for part in dicts], sizes) for name in names}
        return cast(_T, named)
    like = cast(np.ndarray, given)
    filled = [
        _nothing(like, size) if part is None else cast(np.ndarray, part)
        for part, size in zip(parts, sizes, strict=True)
    ]
    return cast(_T, np.concatenate(filled))


def _nothing(like: np.ndarray, size: int) -> np.ndarray:
    shape = (size, *like.shape[1:])
    return np.full(shape, None) if like.dtype == object else np.zeros(shape, like.dtype)


# Observation, reward, terminated, truncated, info.
_AnyStep = tuple[AnyObservation, np.ndarray, np.ndarray, np.ndarray, Info]


class VectorEnv(gymnasium_vector.VectorEnv):
    """A batch, or two halves of one; see the module's docstring.

    `layout` gives the position of each observation in the flat array, as `Part`s of name, slice
    and shape. `batches` has the batch or the halves, for snapshots and physics; `halves` the rows
    of each. The info of a step has `reward_terms`, (num_envs,) by name, and `success`, booleans,
    where the task defines them, and `diverged`. Where episodes begin, in a reset or a step, it has
    `randomization`, the fields of the model that were drawn, if any are. Beside each entry is a
    mask of the rows that it is valid for, `_success` and so on, as in Gymnasium.
    """

    metadata = {"render_modes": arguments.RENDER_MODES}  # noqa: RUF012 (as Gymnasium has it)
    _spec: EnvSpec | None = None
    closed = True  # until it is made: Gymnasium closes an open one, even if making it failed

    @arguments.suggests_names
    def __init__(
        self,
        *batches: Batch,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        flat: bool = False,
        dtype: npt.DTypeLike = "float64",
        copy: bool = True,
        render_mode: str | None = None,
        render_kwargs: Mapping[str, object] | None = None,
        width: int | None = None,
        height: int | None = None,
        camera_id: int | Sequence[int | str] | None = None,
        camera_name: str | Sequence[str] | None = None,
    ) -> None:
        """Take over a batch, or two for pipelining.

        Args:
          batches: of the suite or your own task; they must not be used elsewhere at the same time.
          autoreset_mode: the time at which a row whose episode has ended begins the next one.
          flat, dtype, render_mode, render_kwargs, width, height, camera_id, camera_name: see `Env`.
          copy: observations are new arrays each time; with False the next step or reset may
            overwrite them.

        Raises:
          ValueError: there are not one or two batches, they do not fit together, or a mode or dtype
            is unknown.
          TypeError: an argument is unknown, or given twice, or something is not a batch.
        """
        _check_halves(batches)
        mode = arguments.autoreset_mode(autoreset_mode)
        self.render_mode = arguments.render_mode(render_mode)
        self._render_kwargs = arguments.picture_arguments(
            render_kwargs, width, height, camera_id, camera_name
        )
        # Any: a batch of either kind, which has its `physics` or its `environments` as well.
        self.batches: tuple[Any, ...] = batches
        sizes = [batch.num_envs for batch in batches]
        self.num_envs = sum(sizes)
        self.halves = tuple(slice(sum(sizes[:i]), sum(sizes[: i + 1])) for i in range(len(batches)))
        for batch, rows in zip(batches, self.halves, strict=True):
            batch.first_row = rows.start
        self._set_spaces(flat, dtype)
        self._parts = [Transitions(batch, mode, self._observations, copy) for batch in batches]
        self._workers: Workers[Step] = Workers(len(batches))
        self._was_reset = False
        self.metadata = {**self.metadata, "autoreset_mode": mode}
        if not math.isnan(self.dt):
            self.metadata["render_fps"] = round(1 / self.dt)
        self.closed = False

    # A plain attribute in Gymnasium, which `make_vec` sets.
    @property
    def spec(self) -> EnvSpec | None:
        """The spec of the id, with the length of episodes here as its `max_episode_steps`."""
        return self._spec

    @spec.setter
    def spec(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, spec: EnvSpec | None
    ) -> None:
        self._spec = copy_of(spec)
        if self._spec is not None:
            limit = self.batches[0].step_limit / self.batches[0].action_repeat
            self._spec.max_episode_steps = math.ceil(limit) if math.isfinite(limit) else None

    @property
    def autoreset_mode(self) -> AutoresetMode:
        """The mode that it was made with, as Gymnasium's own vector environments have it."""
        return self.metadata["autoreset_mode"]

    def _set_spaces(self, flat: bool, dtype: npt.DTypeLike) -> None:
        batch: Batch = self.batches[0]
        of_one = specs_of_one_row(batch.observation_spec())
        if flat and batch.flat_names is not None:
            of_one = {name: of_one[name] for name in batch.flat_names}
        self._observations = observations_of(of_one, flat, dtype, batch.pixels)
        self.layout: tuple[Part, ...] = self._observations.layout
        self.single_action_space = action_space(batch.single_action_spec())
        self.single_observation_space = self._observations.space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    # Gymnasium's own vector environments take sequences of seeds as well.
    def reset(
        self,
        *,
        seed: SupportsIndex | Sequence[SupportsIndex | None] | None = None,
        options: Mapping[str, object] | None = None,
    ) -> tuple[AnyObservation, Info]:
        """Begin an episode in every row, or in some; return the observations and info.

        Args:
          seed: row i begins the first episode of `RandomState(seed + i)`; a sequence has a seed for
            each row. Where it is None the row's stream continues.
          options: `reset_mask`, (num_envs,) booleans, resets some rows only and leaves the others
            alone. `state` sets the state after the start is drawn: a mapping of some of 'qpos'
            (num_envs, nq), 'qvel' (num_envs, nv) and 'act' (num_envs, na); or a `Snapshot` of
            num_envs environments, which is restored with its step counts; or a list with a mapping
            of one row's arrays, a snapshot of one environment, or None, for each row. States of
            rows that the mask leaves alone are ignored. The mapping is not changed.

        Raises:
          ValueError, TypeError: a seed or an option is invalid; nothing was reset.
        """
        self._check_idle()
        seeds = arguments.row_seeds(seed, self.num_envs)
        mask = arguments.reset_mask(options, self.num_envs, arguments.STATE)
        begun = np.ones(self.num_envs, bool) if mask is None else mask
        if not (self._is_begun or begun.all()):
            raise ValueError(
                f"reset_mask leaves out rows {np.flatnonzero(~begun).tolist()}, which have begun "
                "no episode yet: reset all rows first; nothing was reset"
            )
        masks = [begun[rows] for rows in self.halves]
        states = states_of_rows((options or {}).get(arguments.STATE), self.batches, masks)
        if isinstance(seed, int | np.integer):
            super().reset(seed=seeds[0])
        results = [
            part.reset(seeds[rows], rows_begun, of_rows)
            for part, rows, rows_begun, of_rows in zip(
                self._parts, self.halves, masks, states, strict=True
            )
        ]
        self._was_reset = True
        observations, infos = [seen for seen, _ in results], [info for _, info in results]
        return self._joined(observations), self._joined(infos)

    def step(self, actions: npt.ArrayLike) -> _AnyStep:
        """Step every row; return observations, rewards, terminated, truncated and info.

        Raises:
          ResetNeeded: no episode was begun or restored, or `autoreset_mode` is DISABLED and an
            episode has ended.
          ValueError, TypeError: the actions are not finite numbers, one row for each environment;
            nothing was stepped.
          PhysicsError: a row diverged and `on_divergence` is 'raise'.
        """
        self._check_idle()
        self._check_begun()
        if len(self._parts) == 1:
            self._parts[0].check_begun()
            return self._parts[0].step(actions)
        if np.shape(actions) != self.action_space.shape:
            raise ValueError(
                f"actions have shape {np.shape(actions)}; expected {self.action_space.shape}: one "
                "row for each environment"
            )
        # All actions are checked before any row is stepped.
        halves = zip(self._parts, self.halves, strict=True)
        checked = [part.checked(np.asarray(actions)[rows]) for part, rows in halves]
        steps: list[Step] = []
        try:
            for part, given in zip(self._parts, checked, strict=True):
                steps.append(part.step(given))
        except BaseException:  # the other half's step is lost
            for part in self._parts:
                part.batch.restart()
            raise
        observation, *masks, info = map(self._joined, zip(*steps, strict=True))
        reward, terminated, truncated = masks
        return observation, reward, terminated, truncated, info

    def send(self, actions: npt.ArrayLike, half: int) -> None:
        """Begin to step a half, and return at once; `recv` returns the result.

        Args:
          actions: one row for each row of the half; they are copied.
          half: 0 or 1.

        Raises:
          RuntimeError: the environment is not pipelined, or the half was not received yet.
          ValueError: the half is neither 0 nor 1.
          ResetNeeded, ValueError, TypeError: as `step`; nothing was stepped.
        """
        self._check_begun()
        if len(self._parts) != 2:
            raise RuntimeError("this environment has no halves: make it with pipelined=True")
        if isinstance(half, bool) or half not in (0, 1) or not isinstance(half, SupportsIndex):
            raise ValueError(f"half is {half!r}; expected 0 or 1")
        if half in self._workers.busy:
            raise RuntimeError(f"half {half} was sent already: receive it with recv() first")
        part = self._parts[half]
        self._workers.send(half, part.step, part.checked(actions))

    def recv(self) -> _AnyStep:
        """Wait for the half that was sent first; return the result of `step` for its rows.

        `info["env_id"]` has the numbers of the rows.

        Raises:
          RuntimeError: no half was sent.
          PhysicsError: as `step`.
        """
        self._check_open()
        half, step = self._workers.receive()
        rows = self.halves[half]
        return *step[:4], {**step[4], "env_id": np.arange(rows.start, rows.stop)}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each row's present state, (height, width, 3) uint8; None without a mode.

        The pictures of a list of cameras are side by side, (height, cameras * width, 3).
        """
        self._check_idle()
        if self.render_mode is None:
            return None
        pictures = (batch.render(None, **self._render_kwargs) for batch in self.batches)
        return tuple(picture for of_batch in pictures for picture in of_batch)

    @property
    def dt(self) -> float:
        """Time between two actions, seconds; NaN for environments that do not report it."""
        batch = self.batches[0]
        return batch.control_timestep() * batch.action_repeat

    # Any: results of any type.
    def call(self, name: str, *args: object, **kwargs: object) -> tuple[Any, ...]:
        """The results of a method of each row, or the values of an attribute, as in Gymnasium.

        Raises:
          AttributeError: rows have no such method; the message suggests the nearest name.
        """
        self._check_idle()
        return tuple(attributes.call(self, name, args, kwargs, range(self.num_envs)))

    # Any: attributes of any type.
    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of each row: one of `Env`, such as `dt`, or a setting of the task.

        Raises:
          AttributeError: rows have no such attribute; the message suggests the nearest name.
        """
        self._check_idle()
        return tuple(attributes.get(self, name))

    def set_attr(self, name: str, values: object) -> None:
        """Set a setting of the task in each row; see `limberjack.gym.attributes`.

        Args:
          name: such as '_move_speed'.
          values: a list or tuple with a value for each row, or one value for all. The rows of a
            vectorised batch share their task, so that the values must be equal, unless the task
            declares the name in EPISODE_ATTRIBUTES.

        Raises:
          AttributeError: rows have no such setting, or it cannot be changed.
          ValueError, TypeError: the values do not fit; nothing was set.
        """
        self._check_idle()
        attributes.set_values(self, name, values)

    def close_extras(self, **kwargs: object) -> None:
        """Wait for running steps and free the batch; `close` calls it, once."""
        self._workers.close()
        for batch in self.batches:
            batch.close()

    def __repr__(self) -> str:
        return represented(self, *(batch.description() for batch in self.batches))

    def __getstate__(self) -> dict[str, object]:
        self._workers.check_idle()
        return vars(self)

    def _joined(self, parts: Sequence[_T]) -> _T:
        return parts[0] if len(parts) == 1 else joined(parts, [b.num_envs for b in self.batches])

    def _check_open(self) -> None:
        if self.closed:
            raise error.ClosedEnvironmentError("this environment is closed: make a new one")

    def _check_idle(self) -> None:
        """Raise unless this is open, and no half is being stepped."""
        self._check_open()
        self._workers.check_idle()

    @property
    def _is_begun(self) -> bool:
        """Whether rows were reset, or restored from a snapshot."""
        return self._was_reset or not all(batch.begins.all() for batch in self.batches)

    def _check_begun(self) -> None:
        self._check_open()
        if not self._is_begun:
            raise error.ResetNeeded("no episode is running: call reset() before step()")


def _check_halves(batches: Sequence[Batch]) -> None:
    if len(batches) not in (1, 2):
        raise ValueError(f"there are {len(batches)} batches; expected one, or two halves")
    for batch in batches:
        if not arguments.is_batch(batch):
            raise TypeError(
                f"got {type(batch).__name__}; expected a batch, from suite.load_batch or "
                "rl.batch.BatchEnvironment.from_environment"
            )
    if batches[0] is batches[-1] and len(batches) == 2:
        raise ValueError("both halves are the same batch; load another one for the second half")
    first, last = map(_described, (batches[0], batches[-1]))
    for what, value in first.items():
        if last[what] != value:
            raise ValueError(
                f"the halves differ in their {what}: {value} and {last[what]}; load both for the "
                "same task with the same arguments"
            )


def _described(batch: Batch) -> dict[str, object]:
    """Properties that halves must have in common."""
    shapes = specs_of_one_row(batch.observation_spec())
    return {
        "task": batch.name,
        "control timestep": str(batch.control_timestep()),  # NaN equals NaN
        "action_repeat": batch.action_repeat,
        "actions": batch.action_spec().shape[1:],
        "observations": {name: (spec.shape, str(spec.dtype)) for name, spec in shapes.items()},
    }
