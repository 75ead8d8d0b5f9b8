"""`Single`: an environment of any class with the interface that Gymnasium's environments need.

    single = Single(environment)        # takes it over
    single = Single(build)              # build(seed) makes a dm_env.Environment
    single.reseed(3)
    single.reset()                      # the first episode of seed 3
    time_step = single.step(action)     # its observation is a mapping
    single.timed_out, single.reward_terms, single.success

It equals one row of a `limberjack.rl.rows.RowsEnvironment`, bit for bit. A plain
`control.Environment` is seeded in place: what its task remembers is put back, and a model that the
task itself has edited is made again. Any other environment is made again for each seed, from
`build`, or as a copy of the environment that was given.

It does not render, and it does not stop an environment that has no time limit.
"""

import collections
import copy
import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TypeVar

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.rl import actions
from limberjack.rl.action_specs import spec_of
from limberjack.rl.builds import (
    Build,
    Make,
    Seeded,
    numbers_of,
    physics_of,
    settable,
    task_name,
)
from limberjack.rl.control import Environment
from limberjack.rl.copies import check_copies, control_of, copied, exact_copies
from limberjack.rl.given_state import state_sizes
from limberjack.rl.guards import at_least_one
from limberjack.rl.pixels import Pixels
from limberjack.rl.represented import Description
from limberjack.rl.row_step import RowStep, as_mapping
from limberjack.rl.row_trial import control_timestep_of, observation_specs
from limberjack.rl.snapshot import Snapshot, as_snapshot
from limberjack.rl.watch import QuickWatch
from limberjack.utils.arrays import Quantity

__all__ = ["Single"]

_WATCHED_STEPS = 3  # first steps, in which edits of the model are noticed, as by a batch
_ANY_SEED = 2**31  # below this lies the seed of an environment that is made without one

_FIRST, _LAST = int(dm_env.StepType.FIRST), int(dm_env.StepType.LAST)
_T = TypeVar("_T")


class Single:
    """An environment of any class; see the module's docstring."""

    def __init__(
        self, given: dm_env.Environment | Make | Build, action_repeat: int | None = None
    ) -> None:
        """Takes over an environment, or makes one.

        Args:
          given: an environment, which must not be used elsewhere; or a function `build(seed)`.
          action_repeat: calls of `step` per action, stopped at the end of an episode, with the sum
            of their rewards; None for the environment's own.

        Raises:
          TypeError: it is neither, or its specs are of another kind than arrays.
          ValueError: see `action_specs.spec_of`.
        """
        self._seeded = _seeded(given)
        env = self.environment
        self._action_spec = spec_of(env)
        self._observation_spec = observation_specs(env, type(env).__name__)
        inner = control_of(env)
        self._repeat: int = getattr(inner, "action_repeat", 1)
        if action_repeat is not None:
            self._repeat = at_least_one("action_repeat", action_repeat)
        self._own_limit: float | None = None  # control steps; None for the environment's own
        # An environment that was given and has begun no episode is seeded in place.
        self._is_new = isinstance(given, dm_env.Environment) and self._seeded.is_plain
        # Whether the task edits the model, which a seed undoes; a caller's edits stay.
        self._edits_model = False
        self._to_watch = _WATCHED_STEPS
        self._seed: int | None = None
        # Of an environment that is not plain; a plain one reports these itself.
        self._is_running = isinstance(inner, Environment) and inner.is_running
        self._is_last = True
        self._timed_out = False
        self._steps = 0  # control steps
        self._summed_terms: Mapping[str, float] | None = None
        self._observation = self._empty()
        self._watched_task: object = None
        self._task_watch: QuickWatch | None = None
        self._set_up()
        self._look()

    @property
    def environment(self) -> dm_env.Environment:
        """The environment; a reset with a seed, or a snapshot, may replace it."""
        return self._seeded.environment

    @property
    def physics(self) -> object:
        """The simulation.

        Raises:
          AttributeError: the environment has none.
        """
        try:
            return physics_of(self.environment)
        except TypeError as error:
            raise AttributeError(str(error)) from None

    def reseed(self, seed: int) -> None:
        """Makes the next episode the first one of a seed.

        Raises:
          TypeError: the environment must be made again, and cannot be copied.
          Exception: any that `build` raises.
        """
        self._keep_what_was_set()
        plain = self._plain
        if self._is_new and plain is not None:
            plain.reseed(seed)
        else:
            self._repeat = self.action_repeat
            self._seeded.begin(seed, keeps_model=not self._edits_model)
            self._set_up()
        self._seed = seed

    def reset(self) -> dm_env.TimeStep:
        """Begins an episode; returns its first time step."""
        self._keep_what_was_set()
        self._is_new = False
        plain = self._plain
        if plain is not None:
            return self._watched(plain, plain.reset)
        self._is_running = self._is_last = False  # until it is complete
        found = self._taken(self.environment.reset())
        self._steps, self._timed_out = 0, False
        self._is_running = True
        return dm_env.TimeStep(dm_env.StepType.FIRST, None, None, self._shown(found))

    def step(self, action: npt.ArrayLike) -> dm_env.TimeStep:
        """Applies an action in the middle of an episode.

        Raises:
          ValueError, TypeError: the action is not made of finite numbers of the spec's shape;
            nothing was stepped.
          Exception: any that the environment raises, such as PhysicsError; `reset` begins another
            episode.
        """
        plain = self._plain
        if plain is None:
            return self._step(self._checked(action))
        self._keep_what_was_set()
        if not self._to_watch:
            time_step = plain.step(action)
            self._look()
            return time_step
        self._to_watch -= 1
        return self._watched(plain, lambda: plain.step(action))

    def set_state(self, state: Mapping[str, npt.ArrayLike] | Snapshot) -> dm_env.TimeStep:
        """Continues the episode that `reset` has just begun; see `control.Environment.set_state`.

        Raises:
          ValueError, TypeError: the state does not fit, or this class has none; nothing was set.
        """
        plain = self._plain
        if plain is not None:
            self._repeat = plain.action_repeat
            time_step = plain.set_state(state)
            if isinstance(state, Snapshot):
                self._set_up()
            return time_step
        if isinstance(state, Snapshot):
            self.restore(state)
            if self._steps:
                return dm_env.TimeStep(dm_env.StepType.MID, 0.0, 1.0, self._shown())
            return dm_env.TimeStep(dm_env.StepType.FIRST, None, None, self._shown())
        env = settable(self.environment)
        self._is_running = False  # until it is complete
        found = self._taken(env.set_state(state))
        self._is_running = True
        return dm_env.TimeStep(dm_env.StepType.FIRST, None, None, self._shown(found))

    def state_sizes(self) -> dict[str, int]:
        """Numbers in each field of the state, such as 'qpos', without empty fields.

        Raises:
          TypeError: it is not a `control.Environment` on a simulation of MuJoCo.
        """
        return state_sizes(settable(self.environment).physics)

    def snapshot(self) -> Snapshot:
        """Everything that the environment's future depends on.

        Plain environments are saved as `control.Environment.snapshot` does; other environments, and
        any whose task edits the model, as copies.

        Raises:
          TypeError: the environment keeps something that cannot be copied.
        """
        plain = self._plain
        if plain is not None and not self._edits_model:
            return plain.snapshot()
        env = self.environment
        check_copies(env, are_seeded=False)
        registration = getattr(control_of(env), "registration", None)
        saved = Snapshot.of_copy(copied(env), registration, self.name)
        if plain is not None:
            return saved
        return dataclasses.replace(
            saved,
            step_count=np.array([self._steps]),
            begins=np.array([not self._is_running]),
            observations={name: value[None] for name, value in self._observation.items()},
            resets=np.array([not self._is_running and not self._is_last]),
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Continues from a snapshot, bit for bit, of this class or of a row of it.

        Raises:
          ValueError, TypeError: it is not a snapshot, has another task, model, version or size, is
            damaged, or contains an episode at or beyond the step limit; nothing was restored.
        """
        self._is_new = False
        plain, env = self._plain, self.environment
        if plain is not None:
            self._repeat = plain.action_repeat
            plain.restore(snapshot)
            self._set_up()
            return
        as_snapshot(snapshot).check(Snapshot.origin_of_copy(env), 1)
        snapshot.check_copies(is_plain=False)
        snapshot.check_length(self._step_limit)
        self._is_running = False  # until it is complete
        if isinstance(env, Environment) and control_of(env) is env:  # it stays the same object
            env.restore(snapshot)
        else:
            self._seeded.replace(copied(snapshot.copies[0]))
        self._set_up()
        inner = control_of(self.environment)
        observations = {name: value[0] for name, value in snapshot.observations.items()}
        if not observations and isinstance(inner, Environment) and not snapshot.begins[0]:
            observations = as_mapping(inner.present_observation())
        for name, value in observations.items():
            given, own = np.asarray(value), self._observation.get(name)
            if own is not None and own.shape == given.shape:
                self._observation[name] = given.astype(own.dtype)
        self._steps = int(snapshot.step_count[0])
        self._is_running = not snapshot.begins[0]
        self._is_last, self._timed_out = not snapshot.resets.any(), False

    def set_attribute(self, name: str, value: object) -> None:
        """Sets an attribute of the environment or its task, and of those made for later seeds."""
        self._repeat = self.action_repeat
        self._seeded.set_attribute(name, value)
        self._set_up()

    def action_spec(self) -> specs.BoundedArray:
        """The spec of an action."""
        return self._action_spec

    def observation_spec(self) -> Mapping[str, specs.Array]:
        """The specs of observations by name."""
        return self._observation_spec

    def control_timestep(self) -> float:
        """Time of a control step, seconds; NaN for an environment that does not report it."""
        return control_timestep_of(self.environment)

    @property
    def name(self) -> str:
        """The task's name, such as 'humanoid:walk', or that of its class."""
        return task_name(self.environment)

    @property
    def action_repeat(self) -> int:
        """Control steps per action, which may be changed in a plain environment."""
        plain = self._plain
        return self._repeat if plain is None else plain.action_repeat

    @property
    def pixels(self) -> Pixels | None:
        """Options of the pixel observations; None without them."""
        return getattr(self.environment, "pixels", None)

    @property
    def randomization(self) -> Mapping[str, np.ndarray]:
        """The values drawn for this episode, by field of the model."""
        return getattr(self.environment, "randomization", {})

    @property
    def reward_terms(self) -> Mapping[str, Quantity]:
        """The terms of the last step's reward by name; empty without them."""
        if self._plain is None and self._summed_terms is not None:
            return self._summed_terms
        return getattr(self.environment, "reward_terms", {})

    @property
    def success(self) -> bool | None:
        """Whether the last step reached the goal; None without a goal."""
        success = getattr(self.environment, "success", None)
        return None if success is None else bool(success)

    @property
    def is_running(self) -> bool:
        """Whether an episode has begun and not ended."""
        plain = self._plain
        return self._is_running if plain is None else plain.is_running

    @property
    def timed_out(self) -> bool:
        """Whether the last step was truncated.

        A plain environment reports it; the last step of any other is a truncation if its discount
        is 1.
        """
        plain = self._plain
        return self._timed_out if plain is None else plain.timed_out

    @property
    def _step_count(self) -> int:
        """Control steps since the episode began."""
        plain = self._plain
        return self._steps if plain is None else plain._step_count

    @property
    def _step_limit(self) -> float:
        """Control steps per episode."""
        if self._own_limit is not None:
            return self._own_limit
        return getattr(control_of(self.environment), "_step_limit", math.inf)

    @_step_limit.setter
    def _step_limit(self, limit: float) -> None:
        self._own_limit = limit
        self._set_up()

    @property
    def step_limit(self) -> int | None:
        """Control steps per episode; None without a limit."""
        limit = self._step_limit
        return math.ceil(limit) if math.isfinite(limit) else None

    def close(self) -> None:
        """Closes the environment; may be called repeatedly."""
        self.environment.close()

    def description(self) -> Description:
        """The parts of a `repr`."""
        steps = self._step_count
        begun = self.is_running or steps
        return Description(
            self.name, None, [self._seed], [steps] if begun else [], self._step_limit
        )

    def __deepcopy__(self, memo: dict[int, object]) -> "Single":
        exact_copies(self.environment, memo)
        new = type(self).__new__(type(self))
        memo[id(self)] = new
        vars(new).update(copy.deepcopy(vars(self), memo))
        return new

    @property
    def _plain(self) -> Environment | None:
        """The environment, if it is plain."""
        return self._seeded.plain

    def _watched(self, plain: Environment, call: Callable[[], _T]) -> _T:
        """The result of a call of a plain environment, whose task may edit the model."""
        before = numbers_of(plain)
        result = call()
        self._edits_model |= numbers_of(plain) != before
        self._look()
        return result

    def _look(self) -> None:
        """Records the attributes of a plain environment's task, after its hooks were called."""
        plain = self._plain
        if plain is None:
            return
        if self._task_watch is None or self._watched_task is not plain.task:
            self._watched_task = plain.task
            self._task_watch = QuickWatch("self", plain.task)
        self._task_watch.look()

    def _keep_what_was_set(self) -> None:
        """Makes attributes of the task that the caller has set since settings for later seeds too.

        What hooks set is memory instead, which a seed puts back.
        """
        plain, watch = self._plain, self._task_watch
        if plain is None or watch is None or self._watched_task is not plain.task:
            return
        for label in watch.changed():
            name = label.removeprefix("self.")
            if hasattr(plain.task, name):
                self._seeded.set_attribute(name, getattr(plain.task, name))
        watch.look()

    def _set_up(self) -> None:
        """Sets the limit, and makes a plain environment repeat actions by itself."""
        inner = control_of(self.environment)
        if not isinstance(inner, Environment):
            return
        inner.action_repeat = self._repeat if self._plain is not None else 1
        if self._own_limit is not None and inner._step_limit != self._own_limit:
            inner._step_limit = self._own_limit

    def _step(self, action: np.ndarray) -> dm_env.TimeStep:
        env = self.environment
        inner = control_of(env)
        before = inner._step_count if isinstance(inner, Environment) else 0
        self._is_running = self._is_last = False  # until it is complete
        found = RowStep(self._batched(self._empty()), self._batched(self._observation))
        terms: collections.Counter[str] = collections.Counter()
        number = 0
        while number < self._repeat and found.step_type[0] != _LAST:
            number += 1
            found.take(0, env.step(action), None)
            if self._repeat > 1:
                terms.update(getattr(env, "reward_terms", {}))
        self._summed_terms = terms if self._repeat > 1 else None
        self._steps += inner._step_count - before if isinstance(inner, Environment) else number
        if found.step_type[0] == _FIRST:
            self._steps = 0
        self._is_last = bool(found.step_type[0] == _LAST)
        self._timed_out = bool(found.timed_out[0])
        self._is_running = not self._is_last
        step_type = dm_env.StepType(int(found.step_type[0]))
        reward, discount = float(found.reward[0]), float(found.discount[0])
        return dm_env.TimeStep(step_type, reward, discount, self._shown(found))

    def _taken(self, time_step: dm_env.TimeStep) -> RowStep:
        """A first time step, checked against the specs."""
        found = RowStep(self._batched(self._empty()), self._batched(self._observation))
        found.take(0, time_step, None)
        return found

    def _shown(self, found: RowStep | None = None) -> Mapping[str, np.ndarray]:
        """The observation of a step, which is kept; the last one without a step."""
        if found is not None:
            self._observation = {name: value[0] for name, value in found.observation.items()}
        return {name: value.copy() for name, value in self._observation.items()}

    def _empty(self) -> dict[str, np.ndarray]:
        of_names = self._observation_spec.items()
        return {name: np.zeros(spec.shape, spec.dtype) for name, spec in of_names}

    @staticmethod
    def _batched(observation: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: value[None] for name, value in observation.items()}

    def _checked(self, action: npt.ArrayLike) -> np.ndarray:
        """A copy of the action, since environments may keep theirs."""
        given = np.array(actions.as_numbers(action))
        shape = self._action_spec.shape
        if given.size == 1 and math.prod(shape) == 1:
            given = given.reshape(shape)  # one number for one actuator, in any shape
        if given.shape != shape:
            raise ValueError(
                f"action has shape {given.shape}; expected {shape}, that of the action spec; "
                "nothing was stepped"
            )
        actions.check_finite(given)
        return given


def _seeded(given: dm_env.Environment | Make | Build) -> Seeded:
    if isinstance(given, dm_env.Environment):
        return Seeded(Build.of_instance(given), given, {}, is_stable=True)
    build = Build.of(given)
    env = build.original
    if env is None:
        env = build.make(np.random.RandomState().randint(_ANY_SEED))
    return Seeded(build, env, {}, is_stable=None)
