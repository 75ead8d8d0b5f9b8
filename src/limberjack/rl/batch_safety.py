"""`check_batch_safe`: verifies that a task works in a batch as in a single simulation.

    check_batch_safe(task, replicas, spec, n_sub_steps, saved_fields, randomizer)

A few rows begin from different starts and take random actions for some steps, in lockstep with
single simulations in the same states. Observation, reward, its terms, success, termination and
state of each row are compared with the single simulation's, value by value, and the single
simulation's model is checked for changes. The results of the physics' methods are compared too,
because a sparse reward is 0 for a wrong distance as well. Everything runs on copies of the task and
the physics. The task's random stream is reset to the same position before each evaluation on either
side.

A hook or a start must not change the task, its physics or their classes, and a hook must not draw
from a random stream: all rows would share the change, while each single environment has its own.
Attributes declared in EPISODE_ATTRIBUTES are kept for each row, and may change.

The rows are compared once more a few steps later, after one row has begun another episode and
another row has not been stepped. The suite's own tasks skip the check, which a test makes for all
of them. A change that a task makes only in later steps is found by `BatchEnvironment` as it
happens, if at all.

It is one idea, and long: each look at the rows needs the task, the simulations and their starts.
"""

import contextlib
import copy
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NoReturn

import numpy as np
from dm_env import specs

from limberjack.mujoco import model_values
from limberjack.mujoco.fields import fields_of_rows
from limberjack.mujoco.replicas import Replicas
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batch_errors import ADVICE, Finding, NotVectorised, explained
from limberjack.rl.contract import (
    Physics,
    PhysicsError,
    SimulatedPhysics,
    Task,
    check_ending,
)
from limberjack.rl.copies import difference
from limberjack.rl.episode_attributes import KEEP_IT, EpisodeAttributes, advice
from limberjack.rl.episode_values import declared, keep_own, values_of
from limberjack.rl.late_changes import LateChanges
from limberjack.rl.memory import is_of_the_suite
from limberjack.rl.randomize import Randomizer, stream_beside
from limberjack.rl.references import ATOMS, attributes_of, is_live, reachable, reaches
from limberjack.rl.reward_terms import reward_and_terms, success_of
from limberjack.rl.shared_streams import fingerprint, put_back_after
from limberjack.rl.streams import set_stream_fields
from limberjack.rl.watch import MEASUREMENT, Watch, measurements_of
from limberjack.utils import arrays
from limberjack.utils.suggest import did_you_mean

__all__ = ["check_apart", "check_batch_safe", "check_episode_fields", "check_plain", "is_proved"]

_MAX_ROWS = 4  # number of starts that covers the kinds of starts of most tasks
_MIN_ROWS = 2  # with one row, wrong slices and norms cannot be distinguished from correct ones
_STEPS = 3  # control steps; a touch sensor reports the first step only in the second
_MORE_STEPS = 4  # before the last comparison
_LOOKS = 1 + _STEPS + 1  # comparisons: at the start, after each step, and once more later
_BEGINS_AGAIN, _LEFT_OUT = 1, 2  # rows, in the steps before the last comparison
_SECOND_START = 100  # seed of the second episode of the row that begins again
_LARGE = 1_000_000  # bytes; larger fields are compared once, not after each start

# State components that a task sets, or that depend on those; the controls first, since they cause
# changes in the others.
_STATE = (
    "ctrl",
    "mocap_pos",
    "mocap_quat",
    "qfrc_applied",
    "xfrc_applied",
    "qpos",
    "qvel",
    "act",
)

_Record = dict[str, np.ndarray]  # quantities of a simulation or batch after a step, by name


def check_plain(env: object) -> None:
    """Checks that an environment has no methods or attributes of its own.

    Raises:
      NotVectorised: it does, or it is not a `control.Environment` at all.
    """
    why = difference(env)
    if why is not None:
        raise NotVectorised(
            f"this {type(env).__name__} is not a plain control.Environment: {why}, which a "
            "vectorised batch would ignore: put it into the task, whose hooks see all rows"
        )


def check_apart(task: Task, physics: SimulatedPhysics, env: object) -> None:
    """Checks that neither a task nor a user's attribute of its physics keeps the simulation.

    Raises:
      NotVectorised: one does: a batch would read that one in the place of the rows'.
    """
    if physics.replaced:
        raise NotVectorised(
            f"physics {type(physics).__name__} replaces {', '.join(physics.replaced)}, which the "
            "rows of a batch do not call"
        )
    own = [env, physics, physics.data, physics.model, *vars(physics).values()]
    targets = {id(one) for one in own if not isinstance(one, ATOMS) and type(one) is not tuple}
    for name, value in attributes_of(physics).items():
        if any(is_live(part) for _, part in reachable(value)):
            raise NotVectorised(
                f"physics {type(physics).__name__} keeps a view of its simulation in self.{name}, "
                "and the rows of a batch have others: read self.data or self.named in a method"
            )
    for name, value in attributes_of(task).items():
        is_view = any(is_live(part) for _, part in reachable(value))
        if is_view or reaches(value, targets):
            raise NotVectorised(
                f"task {type(task).__name__} keeps the simulation of its environment in "
                f"self.{name}, and the rows of a batch have others: use the physics that each hook "
                "gets"
            )


def is_proved(task: Task, physics: SimulatedPhysics, randomizer: Randomizer | None) -> bool:
    """Whether task, physics and model are the suite's own, whose rows a law compares."""
    has_own_model = physics.model._shared is not None
    return has_own_model and randomizer is None and is_of_the_suite(task, physics)


def check_episode_fields(task: Task) -> None:
    """Checks the model fields that a task declares in EPISODE_FIELDS.

    Raises:
      TypeError: it is not a tuple or list of names.
      ValueError: there is no such field, or it cannot differ per row in a batch.
    """
    fields = getattr(task, "EPISODE_FIELDS", ())
    name = type(task).__name__
    if isinstance(fields, str) or not all(isinstance(field, str) for field in fields):
        raise TypeError(
            f"EPISODE_FIELDS of task {name} is {fields!r}; expected a tuple of field names, "
            "such as ('body_pos',)"
        )
    for field in fields:
        if field not in fields_of_rows():
            known = sorted(fields_of_rows())
            raise NotVectorised(
                f"task {name} declares {field!r} in EPISODE_FIELDS, which cannot differ per row of "
                f"a batch.{did_you_mean(field, known)} Rows can differ only in the fields of "
                "mujoco.batch.MODEL_FIELDS and in floating-point fields"
            )


def check_batch_safe(
    task: Task,
    replicas: Replicas,
    spec: specs.BoundedArray,
    n_sub_steps: int,
    saved_fields: Sequence[str],
    randomizer: Randomizer | None,
) -> None:
    """Compares a task's quantities in a few rows with those in single simulations.

    Args:
      task: the task; neither it nor its random stream is changed.
      replicas: the simulations of the batch, which are not changed.
      spec: the action spec of one simulation.
      n_sub_steps: physics steps per action.
      saved_fields: per-row model fields.
      randomizer: draws model fields for each episode; None for no randomisation.

    Raises:
      NotVectorised: a row differs or raises, the task sets model fields that it does not declare,
        remembers something, or draws from a stream in a step; or it cannot be copied.
    """
    num_rows = min(max(replicas.num_envs, _MIN_ROWS), _MAX_ROWS)
    with put_back_after():
        trial = _Trial(task, replicas, num_rows, saved_fields)
        low, high = bounds_to_try(spec)
        shape = (_STEPS, num_rows, *spec.shape)
        actions = np.random.RandomState(0).uniform(low, high, shape).astype(spec.dtype)
        alone = [
            list(trial.play_alone(row, actions[:, row], n_sub_steps, randomizer))
            for row in range(num_rows)
        ]
        trial.check_large_fields()
        looks_again = all(len(records) == _LOOKS for records in alone)
        together = trial.play_together(actions, n_sub_steps, alone[0], looks_again)
        # Not within the generator: the context would last as long as an error that holds it.
        with arrays.rows_of_a_batch(num_rows):
            for look, found in enumerate(together):
                for row, records in enumerate(alone):
                    # A row that diverges is not compared any further.
                    if look < len(records) and not (look > _STEPS and row == _LEFT_OUT):
                        steps = look if look <= _STEPS else _STEPS + _MORE_STEPS
                        trial.compare(found, records[look], row, steps)
        trial.check_constants()
        trial.check_starts(randomizer)


class _TouchedError(BaseException):
    """Raised by `_Untouched`; no hook takes it for an attribute that is missing."""


class _Untouched:
    """Stands for a physics, and raises an error if anything is read of it."""

    def __getattr__(self, name: str) -> NoReturn:
        raise _TouchedError(name)


class _Trial:
    """A few rows of a batch, stepped individually and together."""

    def __init__(
        self, task: Task, replicas: Replicas, num_rows: int, saved_fields: Sequence[str]
    ) -> None:
        self._rows = replicas.single.replicate(num_rows, 1, saved_fields)
        self._num_rows = num_rows
        self._fields = tuple(saved_fields)
        self._name = type(task).__name__
        self._task: Task = _copied(task)
        self._declared = declared(task)
        self._first = values_of(self._task)
        # The values of EPISODE_ATTRIBUTES at each row's start, and at the second start of a row.
        self._starts: list[dict[str, object]] = [{} for _ in range(num_rows)]
        # The states and fields before and after those.
        self._started: list[tuple[dict[str, np.ndarray], dict[str, np.ndarray]]] = []
        self._measured = [measurements_of(each) for each in (self._rows.single, self._rows.physics)]
        self._stream = np.random.RandomState(0)
        self._stream_state = self._stream.get_state()
        self._unused = fingerprint(self._stream)
        self._global = fingerprint(np.random)
        self._second_start: Mapping[str, np.ndarray] = {}  # of the row that begins again
        # Of quantities that were one number for all rows: the functions that compute them.
        self._of_all_rows: dict[str, Callable[[Physics], object]] = {}
        whole = model_values.checksums(self._rows.single.model._official)
        model = self._rows.single.model._official
        candidates = whole.keys() - set(saved_fields)
        self._large = {n for n in candidates if getattr(model, n, np.empty(0)).nbytes > _LARGE}
        self._large_before = {name: whole[name] for name in self._large}

    def play_alone(
        self, row: int, actions: np.ndarray, n_sub_steps: int, randomizer: Randomizer | None
    ) -> Iterator[_Record]:
        """Begins a row's episode, and yields its quantities in a single simulation.

        Args:
          row: the row's number.
          actions: (steps, ...).
          n_sub_steps: physics steps per action.
          randomizer: draws model fields; None for no randomisation.
        """
        rows = self._rows
        alone = _copied(self._task)
        _forget_cached(rows.single)
        before = rows.start_of(row)
        one, values = self._begin(alone, row, row, randomizer)
        self._starts[row] = values_of(alone)
        self._started.append((before, rows.start_of(row)))
        try:
            with Watch(alone, one, self._declared) as watch:
                one.after_reset()
                yield _copies(self._seen(alone, one, is_step=False, watch=watch))
                for action in actions:
                    self._step(alone, one, action, n_sub_steps, watch)
                    yield _copies(self._seen(alone, one, is_step=True, watch=watch))
            self._check_model(one, values, "during a step")
            if row == _BEGINS_AGAIN:
                start = rows.start_of(row)
                one, _ = self._begin(alone, row, _SECOND_START, randomizer)
                self._starts_again = values_of(alone)
                self._second_start = rows.start_of(row)
                rows.set_start(row, start)
                one.after_reset()
            for step in range(_MORE_STEPS):
                self._step(alone, one, actions[step % _STEPS], n_sub_steps)
            yield _copies(self._seen(alone, one, is_step=True))
        except PhysicsError:
            return

    def check_starts(self, randomizer: Randomizer | None) -> None:
        """Raises NotVectorised if rows start otherwise where one task begins all, as in a batch."""
        rows, shared = self._rows, _copied(self._task)
        for row, (before, expected) in enumerate(self._started):
            for name, value in copy.deepcopy(self._first).items():
                setattr(shared, name, value)
            rows.set_start(row, before)
            self._begin(shared, row, row, randomizer)
            found = rows.start_of(row)
            for name, values in expected.items():
                if not np.array_equal(values, found[name], equal_nan=True):
                    raise NotVectorised(
                        f"task {self._name} starts a row with another {name} once it has begun "
                        "other rows, so it remembers something between starts, such as a cached "
                        f"property or an iterator: {KEEP_IT}"
                    )

    def _begin(
        self, task: Task, row: int, seed: int, randomizer: Randomizer | None
    ) -> tuple[SimulatedPhysics, dict[str, int]]:
        """Begins an episode of a seed; returns its simulation, and checksums of its model."""
        rows = self._rows
        stream = np.random.RandomState(seed)
        task._random = stream
        with Watch(task, rows.single, self._declared) as watch:
            set_stream_fields(task, stream, rows.simulation, row)
            self._check_memory(watch, "begin_stream")
        if randomizer is not None:
            rows.simulation.set_fields(randomizer.draw(stream_beside(stream)), row)
        with rows.episode(row) as one:
            values = self._values(one)
            with Watch(task, one, self._declared) as watch:
                task.initialize_episode(one)
                self._check_memory(watch, "initialize_episode")
            keep_own(task, self._declared, self._first)
            self._check_global_stream("initialize_episode")
            self._check_model(one, values, "as an episode begins")
        if randomizer is not None:
            one.simulation.set_constants()
            values = self._values(one)
        return one, values

    def _step(
        self,
        task: Task,
        physics: SimulatedPhysics,
        action: np.ndarray,
        n_sub_steps: int,
        watch: Watch | None = None,
        running: np.ndarray | None = None,
    ) -> None:
        """Makes a control step, in a single simulation or in some rows, None for all."""
        read: Physics = physics  # pyright: ignore[reportAssignmentType] (implements both)
        steps = None if running is None else np.isin(np.arange(self._num_rows), running)
        is_batch = task is self._task
        if is_batch:
            self._late.begin_step()
        with self._hook("before_step", task, watch, steps):
            task.before_step(action.copy(), read)
        if is_batch:
            doubts = self._late.doubts(running)
            diverged = self._rows.step(running, n_sub_steps)
            self._late.check(doubts, n_sub_steps, diverged)
            self._late.computed()
        else:
            keep_own(task, self._declared, self._first)
            physics.step(n_sub_steps)
        with self._hook("after_step", task, watch, steps):
            task.after_step(read)

    def play_together(
        self, actions: np.ndarray, n_sub_steps: int, expected: list[_Record], looks_again: bool
    ) -> Iterator[_Record]:
        """Yields the quantities of all rows, after their start, after each step, and later.

        To be read within `arrays.rows_of_a_batch`.

        Args:
          actions: (steps, num_rows, ...).
          n_sub_steps: physics steps per action.
          expected: quantities of the first row's single simulation.
          looks_again: whether to play on after the steps.
        """
        task, rows = self._task, self._rows
        batch = rows.physics
        self._memory = EpisodeAttributes(task, self._num_rows)
        self._late = LateChanges(rows, self._name, self._fields)
        self._memory.load(np.arange(self._num_rows), self._starts)
        rows.start(np.arange(self._num_rows))
        yield self._seen(task, batch, is_step=False, expected=expected[0])
        for action in actions:
            self._step(task, batch, action, n_sub_steps)
            yield self._seen(task, batch, is_step=True, expected=expected[0])
        if not looks_again:
            return
        self._memory.load(np.array([_BEGINS_AGAIN]), [self._starts_again])
        rows.set_start(_BEGINS_AGAIN, self._second_start)
        rows.start(np.array([_BEGINS_AGAIN]))
        running = np.array([row for row in range(self._num_rows) if row != _LEFT_OUT])
        for step in range(_MORE_STEPS):
            self._step(task, batch, actions[step % _STEPS], n_sub_steps, running=running)
        yield self._seen(task, batch, is_step=True, expected=expected[0])

    def _seen(
        self,
        task: Task,
        physics: SimulatedPhysics,
        is_step: bool,
        expected: Mapping[str, np.ndarray] | None = None,
        watch: Watch | None = None,
    ) -> _Record:
        """The state, and then the task's quantities in the order of a step.

        At a start only the observation is computed, as in an environment.

        Args:
          task: a copy, whose stream is reset before each call.
          physics: the simulation or batch.
          is_step: whether this follows a step instead of a start.
          expected: for a batch, the quantities of a single simulation.
          watch: of the task and physics; None if they are not watched.
        """
        read: Physics = physics  # pyright: ignore[reportAssignmentType] (implements both)
        is_batch = expected is not None
        measured = self._measured[is_batch]
        measured.clear()
        seen = self._state(physics, is_batch)
        if is_step:
            # After an underflow the reward would be computed, and its methods called, once more.
            with self._hook("get_reward", task, watch), np.errstate(under="ignore"):
                reward, terms = reward_and_terms(task, read)
            seen["the reward"] = reward
            if is_batch and all(np.shape(one) == () for one in (reward, *terms.values())):
                self._of_all_rows["the reward"] = functools.partial(reward_and_terms, task)
            seen |= {f"reward term {name!r}": value for name, value in terms.items()}
            with explained("is_success", self._name, self._num_rows, is_batch):
                success = success_of(task, terms)
            if success is not None:
                seen["is_success"] = success
        with self._hook("get_observation", task, watch, expected=list(expected or ())):
            observation = task.get_observation(read)
            if not isinstance(observation, Mapping):
                raise TypeError(
                    f"get_observation of task {self._name} returned {observation!r}; expected a "
                    "mapping from names to arrays"
                )
        seen |= {f"observation {name!r}": value for name, value in observation.items()}
        if is_step:
            with self._hook("get_termination", task, watch):
                ending = task.get_termination(read)
            check_ending(task, ending)
            seen["get_termination"] = np.nan if ending is None else ending
            if is_batch:
                self._late.after_hooks()
                if ending is not None and np.shape(ending) == ():
                    self._of_all_rows["get_termination"] = task.get_termination
        if not is_batch:
            keep_own(task, self._declared, self._first)
            _check_returned(self._name, seen)
        seen = measured | seen  # first, as the cause of differences in the others
        return {name: np.asarray(value) for name, value in seen.items()}

    def check_constants(self) -> None:
        """Raises NotVectorised if one number for all rows depends on the simulation.

        It may be the same in a single simulation for as long as the check looks: a reward for a
        goal that is seldom reached.
        """
        untouched: Physics = _Untouched()  # pyright: ignore[reportAssignmentType] (in its place)
        no_row = np.zeros(self._num_rows, bool)
        for what, compute in self._of_all_rows.items():
            self._rewind(self._task)
            try:
                with self._memory.during("check_constants", self._rows.physics, no_row):
                    compute(untouched)
            except (_TouchedError, Exception) as error:
                raise NotVectorised(
                    f"{what} of task {self._name} is one number for all rows, and is computed from "
                    f"the simulation: {ADVICE}"
                ) from error

    @contextlib.contextmanager
    def _hook(
        self,
        hook: str,
        task: Task,
        watch: Watch | None = None,
        rows: np.ndarray | None = None,
        expected: Sequence[str] = (),
    ) -> Iterator[None]:
        """A context for a hook, which begins with the random stream in the same state.

        In a batch errors are explained; in a single simulation they are the user's own, and the
        hook must not draw or remember anything.

        Args:
          hook: its name.
          task: the batch's, or a copy for a single simulation.
          watch: of a single simulation; None if it is not watched.
          rows: mask of rows for which it counts; None for all.
          expected: labels of a single simulation's quantities, in order.
        """
        self._rewind(task)
        if task is not self._task:
            yield
            self._check_hook(watch, hook)
            return
        what = "the reward" if hook == "get_reward" else hook
        with (
            self._memory.during(hook, self._rows.physics, rows),
            explained(what, self._name, self._num_rows, expected=expected),
        ):
            yield

    def _state(self, physics: SimulatedPhysics, is_batch: bool) -> dict[str, object]:
        """The state and the per-row model fields."""
        seen: dict[str, object] = {f"data.{name}": getattr(physics.data, name) for name in _STATE}
        if self._fields:
            saved = physics.simulation.save(None, self._fields)
            index = slice(None) if is_batch else 0
            seen |= {f"model.{name}": saved[name][index] for name in self._fields}
        return seen

    def compare(self, found: _Record, expected: _Record, row: int, step: int) -> None:
        """Raises ValueError if a row differs from its single simulation."""
        for label in [*expected, *(name for name in found if name not in expected)]:
            finding = Finding(label, self._name, row, step, self._num_rows)
            if label in found and label in expected:
                is_measured = label.startswith(MEASUREMENT)
                check = finding.check_measurement if is_measured else finding.check
                check(found[label], expected[label])
            elif not label.startswith(MEASUREMENT):
                raise finding.surplus() if label in found else finding.missing(sorted(found))

    def check_large_fields(self) -> None:
        """Raises ValueError if a large model field was set, such as the pixels of textures."""
        small = model_values.checksums(self._rows.single.model._official).items()
        after = {name: value for name, value in small if name in self._large}
        self._refuse(model_values.changed_fields(self._large_before, after), "in an episode")

    def _values(self, one: SimulatedPhysics) -> dict[str, int]:
        """Checksums of the model's fields, except for large ones and per-row ones."""
        return model_values.checksums(one.model._official, {*self._large, *self._fields})

    def _check_model(self, one: SimulatedPhysics, before: dict[str, int], when: str) -> None:
        self._refuse(model_values.changed_fields(before, self._values(one)), when)

    def _refuse(self, changed: Sequence[str], when: str) -> None:
        """Raises ValueError if shared model fields were changed."""
        if not changed:
            return
        shared = [name for name in changed if name not in fields_of_rows()]
        task, named = self._name, ", ".join(changed)
        if shared:
            raise NotVectorised(
                f"task {task} sets {named} of the model {when}, but the rows of a batch share "
                f"{', '.join(shared)}: step single environments, or set it once, before creating "
                "the batch"
            )
        declared = tuple(sorted({*getattr(self._task, "EPISODE_FIELDS", ()), *changed}))
        raise NotVectorised(
            f"task {task} sets {named} of the model {when}; declare EPISODE_FIELDS = {declared}, "
            "so that each row has its own"
        )

    def _check_hook(self, watch: Watch | None, hook: str) -> None:
        """Raises NotVectorised if a hook of a step has drawn or remembered something."""
        if watch is None:
            return
        self._check_memory(watch, hook)
        if fingerprint(self._stream) != self._unused:
            raise NotVectorised(
                f"task {self._name} draws from the task's random stream in {hook}, and all rows of "
                "a vectorised batch would get one draw: draw in initialize_episode"
            )
        self._check_global_stream(hook)

    def _check_global_stream(self, hook: str) -> None:
        """Raises NotVectorised if a hook has drawn from NumPy's global stream."""
        if fingerprint(np.random) != self._global:
            raise NotVectorised(
                f"task {self._name} draws from NumPy's global random stream in {hook}, which all "
                "rows share: draw from self.random in initialize_episode"
            )

    def _check_memory(self, watch: Watch, hook: str) -> None:
        changed = watch.changed()
        if not changed:
            return
        named = ", ".join(changed)
        of_task = [name.removeprefix("self.") for name in changed if name.startswith("self.")]
        way_out = "keep what belongs to an episode in attributes of the task"
        if len(of_task) == len(changed):
            way_out = advice(self._task, of_task)
        raise NotVectorised(
            f"task {self._name} sets {named} in {hook}, which all rows of a vectorised batch would "
            f"share: {way_out}"
        )

    def _rewind(self, task: Task) -> None:
        """Resets the task's random stream to the same state."""
        if fingerprint(self._stream) != self._unused:
            self._stream.set_state(self._stream_state)
        task._random = self._stream


def _check_returned(task: str, seen: Mapping[str, object]) -> None:
    """Raises TypeError or ValueError unless the hooks of a single simulation return numbers."""
    for label, value in seen.items():
        is_observed = label.startswith("observation ")
        hooks = "the reward", "reward term", "is_success", "get_termination"
        if not is_observed and not label.startswith(hooks):
            continue
        name = "get_reward" if label == "the reward" else label
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise TypeError(
                f"{name} of task {task} returned {value!r}; expected "
                f"{'an array of numbers' if is_observed else 'a number'}"
            )
        if array.ndim and not is_observed:
            raise ValueError(
                f"{name} of task {task} returned an array of shape {array.shape} in a single "
                "simulation; expected one number"
            )


def _forget_cached(physics: object) -> None:
    """Removes what cached properties of a user's class of physics have kept."""
    for cls in type(physics).__mro__:
        if not cls.__module__.startswith("limberjack."):
            for name, value in vars(cls).items():
                if isinstance(value, functools.cached_property):
                    vars(physics).pop(name, None)


def _copied(task: Task) -> Task:
    try:
        return copy.deepcopy(task)
    except TypeError as error:
        raise NotVectorised(
            f"task {type(task).__name__} cannot be copied ({error}), but a batch tests copies of "
            "its task: store only attributes that copy.deepcopy supports"
        ) from error


def _copies(record: _Record) -> _Record:
    """Copies of the arrays, since quantities may be views of live memory."""
    return {name: value.copy() for name, value in record.items()}
