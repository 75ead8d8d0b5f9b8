"""`Single`: an environment of any class with the interface that Gymnasium's environments need.

    single = Single(environment)        # takes it over
    single = Single(build)              # build(seed) makes a dm_env.Environment
    single.reseed(3)
    single.reset()                      # the first episode of seed 3
    time_step = single.step(action)     # its observation is a mapping
    single.timed_out, single.reward_terms, single.success

It is a `limberjack.rl.rows.RowsEnvironment` of one row, except that a plain `control.Environment`
is played itself: it is seeded in place, what its task remembers is put back, and a model that the
task itself has edited is made again. Any other environment is made again for each seed, from
`build`, or as a copy of the environment that was given.

It does not render, and it does not stop an environment that has no time limit.
"""

import math
from collections.abc import Callable, Mapping
from typing import TypeVar

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.rl import action_specs
from limberjack.rl.builds import Build, Make, Seeded, numbers_of, physics_of
from limberjack.rl.control import Environment, shown_by
from limberjack.rl.pixels import Pixels
from limberjack.rl.represented import Description
from limberjack.rl.row_step import RowStep
from limberjack.rl.row_trial import Form
from limberjack.rl.rows import RowsEnvironment
from limberjack.rl.snapshot import Snapshot
from limberjack.rl.threads import RowErrors
from limberjack.rl.watch import QuickWatch
from limberjack.utils.arrays import Quantity

__all__ = ["Single"]

_WATCHED_STEPS = 3  # first steps, in which edits of the model are noticed, as by a batch
_ANY_SEED = 2**31  # below this lies the seed of an environment that is made without one

_FIRST, _LAST = int(dm_env.StepType.FIRST), int(dm_env.StepType.LAST)
_T = TypeVar("_T")


class _Row(RowsEnvironment):
    """The one row, whose errors are raised as its environment raises them."""

    def step_one(self, action: np.ndarray) -> dm_env.TimeStep:
        """Steps the running environment, without the costs of many rows and threads."""
        with self._use:
            self._begins[0], self._has_ended[0] = True, False  # until the step is complete
            found = RowStep(1, self._empty(), self._observation)
            self._step_row(0, action, found)
            if found.error is not None:
                raise found.error
            kind = int(found.step_type[0])
            self._steps[0] = 0 if kind == _FIRST else self._steps[0] + found.steps[0]
            self._timed_out[0], self._begins[0] = found.timed_out[0], kind == _LAST
            self._has_ended[0] = kind == _LAST and not found.cut_off[0]
            for name, values in found.observation.items():
                self._observation[name][0] = values[0]
        observation = {name: values[0] for name, values in found.observation.items()}
        reward, discount = float(found.reward[0]), float(found.discount[0])
        return dm_env.TimeStep(dm_env.StepType(kind), reward, discount, observation)

    def reseed(self, seed: int, keeps_model: bool) -> None:
        """Makes the next episode the first one of a seed; see `Seeded.begin`."""
        try:
            self._seed(0, seed, keeps_model)
        finally:
            self.set_up()

    def set_up(self) -> None:
        """Gives the environment the limit, and makes a plain one repeat actions by itself."""
        self._set_up(0)
        if self._own_limit is not None:
            self._set_limit(0, self._own_limit)

    def _raise(self, errors: RowErrors) -> None:
        for _, error in errors:
            raise error


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
        seeded = _seeded(given)
        env = seeded.environment
        self._form = form = Form.of(env, type(env).__name__)
        repeat = form.action_repeat if action_repeat is None else action_repeat
        self._row, self._seeded = _Row.of_one(seeded, form, repeat), seeded
        # An environment that was given and has begun no episode is seeded in place.
        self._is_new = isinstance(given, dm_env.Environment) and seeded.is_plain
        # Whether the task edits the model, which a seed undoes; a caller's edits stay.
        self._edits_model = False
        self._to_watch = _WATCHED_STEPS
        self._seed: int | None = None
        self._watched_task: object = None
        self._task_watch: QuickWatch | None = None
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
            self._row._action_repeat = self.action_repeat
            self._row.reseed(seed, keeps_model=not self._edits_model)
        self._seed = seed

    def reset(self) -> dm_env.TimeStep:
        """Begins an episode; returns its first time step."""
        self._keep_what_was_set()
        self._is_new = False
        plain = self._plain
        if plain is not None:
            return self._watched(plain, plain.reset)
        return _of_one(self._row.reset())

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
            # A copy, since environments may keep theirs.
            numbers = np.array(action_specs.as_numbers(action))
            given = action_specs.in_shape(numbers, self.action_spec().shape)
            action_specs.check_finite(given)
            return self._row.step_one(given)
        self._keep_what_was_set()
        if not self._to_watch:
            try:
                return plain.step(action)
            finally:
                self._look()
        self._to_watch -= 1
        return self._watched(plain, lambda: plain.step(action))

    def set_state(self, state: Mapping[str, npt.ArrayLike] | Snapshot) -> dm_env.TimeStep:
        """Continues the episode that `reset` has just begun; see `control.Environment.set_state`.

        Raises:
          ValueError, TypeError: the state does not fit, or this class has none; nothing was set.
        """
        plain = self._plain
        if plain is not None:
            self._row._action_repeat = plain.action_repeat
            time_step = plain.set_state(state)
            self._row.set_up()
            self._look()
            return time_step
        if isinstance(state, Snapshot):
            return _of_one(self._row.set_states(state))
        one_row = {name: np.asarray(value)[None] for name, value in state.items()}
        return _of_one(self._row.set_states(one_row))

    def state_sizes(self) -> dict[str, int]:
        """Numbers in each field of the state, such as 'qpos', without empty fields.

        Raises:
          TypeError: it is not a `control.Environment` on a simulation of MuJoCo.
        """
        return self._row.state_sizes()

    def snapshot(self) -> Snapshot:
        """Everything that the environment's future depends on.

        Plain environments are saved as `control.Environment.snapshot` does; other environments, and
        any whose task edits the model, as copies.

        Raises:
          TypeError: the environment keeps something that cannot be copied.
        """
        if self._plain is None:
            return self._row.snapshot()
        return self._row._saved(0, as_copy=self._edits_model)

    def restore(self, snapshot: Snapshot) -> None:
        """Continues from a snapshot, bit for bit, of this class or of a row of it.

        Raises:
          ValueError, TypeError: it is not a snapshot, has another task, model, version or size, is
            damaged, or contains an episode at or beyond the step limit; nothing was restored.
        """
        self._is_new = False
        plain = self._plain
        if plain is None:
            self._row.restore(snapshot)
            return
        self._row._action_repeat = plain.action_repeat
        plain.restore(snapshot)
        self._row.set_up()
        self._look()

    def set_attribute(self, name: str, value: object) -> None:
        """Sets an attribute of the environment or its task, and of those made for later seeds."""
        self._row._action_repeat = self.action_repeat
        self._row.set_attr(name, [value])

    def action_spec(self) -> specs.BoundedArray:
        """The spec of an action."""
        return self._row.single_action_spec()

    def observation_spec(self) -> Mapping[str, specs.Array]:
        """The specs of observations by name."""
        return self._form.observation_spec

    def control_timestep(self) -> float:
        """Time of a control step, seconds; NaN for an environment that does not report it."""
        return self._row.control_timestep()

    @property
    def action_repeat(self) -> int:
        """Control steps per action, which may be changed in a plain environment."""
        plain = self._plain
        return self._row.action_repeat if plain is None else plain.action_repeat

    @property
    def pixels(self) -> Pixels | None:
        """Options of the pixel observations; None without them."""
        return self._row.pixels

    @property
    def randomization(self) -> Mapping[str, np.ndarray]:
        """The values drawn for this episode, by field of the model."""
        return shown_by(self.environment, "randomization", {})

    @property
    def reward_terms(self) -> Mapping[str, Quantity]:
        """The terms of the last step's reward by name; empty without them."""
        terms: Mapping[str, Quantity] = shown_by(self.environment, "reward_terms", {})
        return terms if self._plain is not None else self._row._summed_terms.get(0, terms)

    @property
    def success(self) -> bool | None:
        """Whether the last step reached the goal; None without a goal."""
        success = shown_by(self.environment, "success")
        return None if success is None else bool(success)

    @property
    def is_running(self) -> bool:
        """Whether an episode has begun and not ended."""
        plain = self._plain
        return not self._row._begins[0] if plain is None else plain.is_running

    @property
    def timed_out(self) -> bool:
        """Whether the last step was truncated; see `limberjack.rl.rows`."""
        plain = self._plain
        return bool(self._row.timed_out[0]) if plain is None else plain.timed_out

    @property
    def _step_count(self) -> int:
        """Control steps since the episode began."""
        plain = self._plain
        return int(self._row._steps[0]) if plain is None else plain._step_count

    @property
    def _step_limit(self) -> float:
        """Control steps per episode."""
        return self._row.step_limit

    @_step_limit.setter
    def _step_limit(self, limit: float) -> None:
        self._row.step_limit = limit

    @property
    def step_limit(self) -> int | None:
        """Control steps per episode; None without a limit."""
        limit = self._step_limit
        return math.ceil(limit) if math.isfinite(limit) else None

    def close(self) -> None:
        """Closes the environment; may be called repeatedly."""
        self._row.close()

    def description(self) -> Description:
        """The parts of a `repr`."""
        steps = self._step_count
        begun = [steps] if self.is_running or steps else []
        return Description(self._row.name, None, [self._seed], begun, self._step_limit)

    @property
    def _plain(self) -> Environment | None:
        """The environment, if it is plain."""
        return self._seeded.plain

    def _watched(self, plain: Environment, call: Callable[[], _T]) -> _T:
        """The result of a call of a plain environment, whose task may edit the model."""
        before = numbers_of(plain)
        try:
            return call()
        finally:
            self._edits_model |= numbers_of(plain) != before
            self._look()

    def _look(self) -> None:
        """Records the attributes of a plain environment's task, after its hooks were called.

        What they did before they failed is memory, too.
        """
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


def _of_one(batched: dm_env.TimeStep) -> dm_env.TimeStep:
    """The time step of the only row of a batch, which has begun an episode or been restored."""
    observation = {name: values[0] for name, values in batched.observation.items()}
    step_type = dm_env.StepType(int(batched.step_type[0]))
    if step_type is dm_env.StepType.FIRST:
        return dm_env.TimeStep(step_type, None, None, observation)
    reward, discount = float(batched.reward[0]), float(batched.discount[0])
    return dm_env.TimeStep(step_type, reward, discount, observation)


def _seeded(given: dm_env.Environment | Make | Build) -> Seeded:
    if isinstance(given, dm_env.Environment):
        return Seeded(Build.of_instance(given), given, {}, is_stable=True)
    build = Build.of(given)
    env = build.original
    if env is None:
        env = build.make(np.random.RandomState().randint(_ANY_SEED))
    return Seeded(build, env, {}, is_stable=None)
