"""`RowsEnvironment`: complete single environments as the rows of a batch.

    batch = RowsEnvironment(build, num_envs=16, seed=0)     # build(seed) -> dm_env.Environment
    time_step = batch.reset()
    time_step = batch.step(actions)                         # (16, ...)
    batch.environments[3]                                   # the environment of row 3

It has the interface of `BatchEnvironment` for environments that cannot be vectorised: subclasses
and wrappers, tasks that remember something between steps or draw in them. Row i equals the single
environment with seed `seed + i`, bit for bit, whatever its class does, except through what all
environments share: global random streams, class attributes, modules' globals and files. If an
environment draws from a global stream, the rows are stepped on one thread, in order.

A few threads step the rows. In plain environments they advance the simulation only, and the
caller's thread runs the hooks (`limberjack.rl.row_step`). A row whose episode has ended is
stepped once more, which begins its next one, as dm_env specifies. A row that diverges ends with
reward 0 and discount 0, and shows its last observation again. Any other error of a row is raised
with the row's number once all threads have returned; every row then begins an episode with the next
step.

It is one idea, and long: every method does to each row's environment what `BatchEnvironment` does
to the row of a batch.
"""

import collections
import copy
import functools
import math
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from typing import Any, Self

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.mujoco.simulation import STATE
from limberjack.rl import guards
from limberjack.rl.action_specs import in_shape
from limberjack.rl.batch_contract import Batch, RowNumbers
from limberjack.rl.builds import (
    Build,
    Make,
    Seeded,
    holder_of,
    is_stable,
    physics_of,
    settable,
    task_name,
)
from limberjack.rl.contract import PhysicsError
from limberjack.rl.control import Environment, set_action_repeat, shown_by
from limberjack.rl.copies import check_copies, control_of, copied, difference, exact_copies
from limberjack.rl.given_state import state_sizes
from limberjack.rl.pixels import Pixels
from limberjack.rl.randomize import show_drawn
from limberjack.rl.row_step import RowStep, as_mapping, step_in_phases
from limberjack.rl.row_trial import Form, Trial, model_of, noted
from limberjack.rl.snapshot import Snapshot, as_snapshot
from limberjack.rl.streams import check_limit
from limberjack.rl.threads import RowErrors, RowThreads, interrupts, run, threads_for
from limberjack.utils import arrays
from limberjack.utils.arrays import Quantity
from limberjack.utils.cores import usable_cores
from limberjack.utils.log import log
from limberjack.utils.seeds import checked_seed

__all__ = ["RowsEnvironment"]

_FIRST, _MID, _LAST = (int(kind) for kind in dm_env.StepType)


class RowsEnvironment(Batch):
    """Complete single environments in lockstep; see the module's docstring."""

    _draw_interval = 1  # see `draw_every`
    _own_limit: float | None = None  # set by `step_limit`; None for the environments' own

    def __init__(
        self,
        build: dm_env.Environment | Make | Build,
        num_envs: int,
        num_threads: int | None = None,
        seed: int | None = None,
        on_divergence: str = "end",
        contexts: Sequence[Mapping[str, object]] | None = None,
        action_repeat: int | None = None,
        stagger: bool = False,
        why_rows: str = "rows were asked for",
    ) -> None:
        """Makes the environments, whose first `step` or `reset` begins an episode in every row.

        Args:
          build: a function `build(seed)` that makes a `dm_env.Environment`, or an environment to
            copy, which is not changed.
          num_envs: number of rows.
          num_threads: number of threads; by default as many as there are cores.
          seed: row i begins with the first episode of `seed + i`; None for an arbitrary seed.
          on_divergence: 'end' ends the episodes of rows that diverge, with reward and discount 0;
            'raise' raises `PhysicsError`.
          contexts: keywords for `build`, for each row.
          action_repeat: calls of `step` per action, stopped at the end of an episode, with the sum
            of their rewards; None for the environments' own.
          stagger: end the first episode of each row after a random number of steps; see
            `limberjack.rl.streams`.
          why_rows: the reason why the task is not vectorised.

        Raises:
          ValueError: a number is out of range, or rows differ in their specs or control step.
          TypeError: copies of the environment would share state, or `build` makes something else.
          MemoryError: this many rows do not fit into memory.
        """
        num_envs = guards.at_least_one("num_envs", num_envs)
        first = guards.first_seed(seed, num_envs)
        self.why_rows = why_rows
        self._build = Build.of(build)
        contexts = _checked_contexts(contexts, num_envs, self._build)
        # It checks the memory, before any is taken.
        trial = Trial(self._build, first, contexts[0] if contexts else {}, num_envs)
        repeat = trial.form.action_repeat if action_repeat is None else action_repeat
        super().__init__(num_envs, first, on_divergence, repeat, stagger)
        of_rows = contexts or [{}] * self.num_envs
        self.draws_globally: str | None = trial.draws_globally
        self._set_form(trial.form, self._threads_for(num_threads))
        # With contexts, each row is made again for another seed, since models may depend on both.
        stable = not any(of_rows) and is_stable(self._build, first)
        self._make_rows(trial, of_rows, first, stable)
        self._num_physics_threads = self._threads_of_physics()
        self._set_counters()
        if stagger:
            check_limit(self.step_limit)
        models = [] if stable else [model_of(one) for one in self.environments]
        self._edits_models = trial.edits_model or any(one != models[0] for one in models)

    @classmethod
    def of_one(cls, row: Seeded, form: Form, action_repeat: int) -> Self:
        """A batch of one row, whose environment is taken over; its PhysicsErrors are raised."""
        new = cls.__new__(cls)
        Batch.__init__(new, 1, None, "raise", action_repeat, stagger=False)
        new._set_form(form, num_threads=1)
        new._rows.append(row)
        new._seeds[0], new._edits_models = None, False
        new._set_counters()
        new._begins[:] = new._has_ended  # it may be running
        new._set_up(0)
        return new

    def _set_form(self, form: Form, num_threads: int) -> None:
        self._form = form
        self._action_spec = guards.batched_spec(form.action_spec, self.num_envs)
        self._threads = RowThreads(self.num_envs, num_threads)
        self._limits = np.full(self.num_envs, math.inf)  # of the rows' present episodes
        self._rows: list[Seeded] = []

    def _threads_for(self, num_threads: int | None) -> int:
        """The user's number of threads, or as many as there are cores, at most the rows.

        One for environments that draw from a stream that they share.
        """
        given = usable_cores() if num_threads is None else num_threads
        threads = min(guards.at_least_one("num_threads", given), self.num_envs)
        if self.draws_globally is None:
            return threads
        log.info(
            "%s draws from %s, which all rows share: they are stepped on one thread, in order",
            self._build.name,
            self.draws_globally,
        )
        return 1

    def _threads_of_physics(self) -> int:
        """The number of threads that advance the simulations of rows that are stepped in parts."""
        env = _in_parts(self._rows[0])
        if self._threads.num_threads == 1 or env is None:
            return self._threads.num_threads
        return min(self._threads.num_threads, threads_for(None, self.num_envs, env))

    def _make_rows(
        self, trial: Trial, contexts: Sequence[Mapping[str, object]], first: int, stable: bool
    ) -> None:
        """Makes the environments of the seeds from the first one on, and compares them."""
        for row, context in enumerate(contexts):
            with noted(row, context):
                self._rows.append(self._build.seeded(first + row, context, stable))
            trial.compare(self._rows[row].environment, row, context)
            self._set_up(row)
            if self._stagger is not None:
                self._stagger.draw(row, np.random.RandomState(first + row))
        trial.close()

    def _set_counters(self) -> None:
        """Sets the counters of rows that have not begun an episode."""
        env = self.environments[0]
        self.registration = shown_by(control_of(env), "registration")
        self.name = task_name(env)
        self._full_limits = [self._limit_of(row.environment) for row in self._rows]
        self._steps = np.zeros(self.num_envs, int)
        # Reward terms of rows whose `step` is called repeatedly.
        self._summed_terms: dict[int, Mapping[str, float]] = {}
        # Stepping these begins their next episode; others must be reset.
        inside = map(control_of, self.environments)
        self._has_ended = np.array([not shown_by(one, "is_running", False) for one in inside])
        self._timed_out = np.zeros(self.num_envs, bool)
        self._observation = self._empty()

    @property
    def environments(self) -> tuple[dm_env.Environment, ...]:
        """The environment of each row; a reset with a seed may replace it."""
        return tuple(row.environment for row in self._rows)

    def reset(
        self, ids: RowNumbers = None, seeds: Sequence[int | None] | None = None
    ) -> dm_env.TimeStep:
        """See `Batch`."""
        rows = self._numbers(ids)
        by_row = dict(zip(rows.tolist(), guards.seeds_of_rows(seeds, len(rows)), strict=True))
        with self._use:
            self._begins[rows] = True  # until complete: after an interrupt, rows begin again
            self._has_ended[rows] = False

            def begin(row: int) -> dm_env.TimeStep:
                seed = by_row[row]
                if seed is not None:
                    self._seed(row, seed)
                self._set_limit_of_next(row)
                return self._rows[row].environment.reset()

            self._take_starts(begin, rows)
            self._steps[rows] = 0
            self._begins[rows] = False
            self._timed_out[rows] = False
            self.diverged[rows] = False
        return self._present()

    def _take_starts(self, start: Callable[[int], dm_env.TimeStep], rows: np.ndarray) -> None:
        """Takes the observations of the first time steps that `start(row)` returns."""
        found = RowStep(self.num_envs, self._empty(), self._observation)

        def take(row: int) -> None:
            found.take(row, start(row), self._rows[row].plain)

        self._raise(self._each(take, rows.tolist()))
        for name, values in found.observation.items():
            self._observation[name][rows] = values[rows]

    def _present(self) -> dm_env.TimeStep:
        """The time step of a reset: FIRST for rows that have begun, MID for others."""
        step_type = np.where(self._steps == 0, _FIRST, _MID)
        observation = self._shown({n: v.copy() for n, v in self._observation.items()})
        ones = np.ones(self.num_envs)
        return dm_env.TimeStep(step_type, np.zeros(self.num_envs), ones, observation)

    def restart(self) -> None:
        """See `Batch`."""
        super().restart()
        self._has_ended[:] = False

    def step(self, actions: npt.ArrayLike) -> dm_env.TimeStep:
        """See `Batch`."""
        with self._use:
            given = self._checked(actions, self._begins)
            begins, has_ended = self._begins.tolist(), self._has_ended.tolist()
            # Until the step is complete: after an interrupt, all rows begin again.
            self.restart()
            found = RowStep(self.num_envs, self._empty(), self._observation)

            def step(row: int) -> None:
                if begins[row]:
                    env = self._rows[row].environment
                    self._set_limit_of_next(row)
                    time_step = env.step(given[row]) if has_ended[row] else env.reset()
                    found.take(row, time_step, self._rows[row].plain)
                    return
                self._step_row(row, given[row], found)

            rows = range(self.num_envs)
            in_parts = {
                row: env
                for row, env in self._in_parts(rows).items()
                if Environment.is_running.of(env) and not begins[row]
            }
            errors = self._each(step, [row for row in rows if row not in in_parts])
            if in_parts and not interrupts(errors):
                threads = functools.partial(
                    self._threads.share, num_threads=self._num_physics_threads
                )
                errors += step_in_phases(in_parts, given, found, threads)
            self._raise(errors)
            return self._counted(found)

    def _in_parts(self, rows: Sequence[int]) -> dict[int, Environment]:
        """The environments that are stepped in parts, by row; none on one thread.

        One thread steps row by row, because rows may share streams, whose draws have an order.
        """
        if self._threads.num_threads == 1:
            return {}
        found = {row: _in_parts(self._rows[row]) for row in rows}
        return {row: env for row, env in found.items() if env is not None}

    def _each(self, job: Callable[[int], object], rows: Sequence[int]) -> RowErrors:
        """Calls `job(row)` for rows; returns the errors.

        Rows that are stepped in parts run in the caller's thread, others in the row's own.
        """
        here = self._in_parts(rows)
        errors = self._threads.each(job, [row for row in rows if row not in here])
        return errors if interrupts(errors) else errors + run(job, list(here))

    def _counted(self, found: RowStep) -> dm_env.TimeStep:
        """Counts a step that all rows have made; returns its time step."""
        self.diverged = found.diverged
        if arrays.any_of(found.diverged):
            self._report_divergence(found.error)
        last = found.step_type == _LAST
        self._steps += found.steps
        self._steps[found.step_type == _FIRST] = 0
        self._timed_out = found.timed_out & ~found.diverged
        for name, values in found.observation.items():
            np.copyto(self._observation[name], values)
        self._begins, self._has_ended = last, last & ~found.diverged & ~found.cut_off
        observation = self._shown(found.observation)
        return dm_env.TimeStep(found.step_type, found.reward, found.discount, observation)

    def _step_row(self, row: int, action: np.ndarray, found: RowStep) -> None:
        """Steps a row in mid-episode, as often as an action is repeated."""
        env, plain = self._rows[row].environment, self._rows[row].plain
        repeat = self._action_repeat if plain is None else 1  # which it repeats by itself
        inner = plain or control_of(env)
        before: int = getattr(inner, "_step_count", 0)
        terms: collections.Counter[str] = collections.Counter()
        if repeat > 1:
            self._summed_terms[row] = terms
        for number in range(1, repeat + 1):
            try:
                time_step = env.step(action)
            except PhysicsError as error:
                found.error = error
                if plain is None:
                    found.diverge(row)
                else:
                    found.end_diverged(row, plain, before)
                return
            found.take(row, time_step, plain)
            if repeat > 1:
                terms.update(shown_by(env, "reward_terms", {}))
            if isinstance(inner, Environment):
                found.steps[row] = inner._step_count - before
            else:
                found.steps[row] = number
                if self._steps[row] + number >= self._limits[row]:
                    found.cut(row)
            if found.step_type[row] == _LAST:
                return

    def snapshot(self, rows: RowNumbers = None) -> Snapshot:
        """See `Batch`."""
        # Plain environments as `control.Environment.snapshot` does; others, and any that edit their
        # models, as copies.
        numbers = self._numbers(rows)
        chosen = numbers.tolist() or [0]
        with self._use:
            as_copies = self._edits_models or not all(self._rows[row].is_plain for row in chosen)
            saved = [self._saved(row, as_copies) for row in chosen]
            if any(one.origin != saved[0].origin for one in saved):
                as_copies = True
                saved = [self._saved(row, as_copies) for row in chosen]
            first, saved = saved[0], saved[: len(numbers)]
            seen = self._observation if as_copies and saved else {}
            return Snapshot(
                first.origin,
                _stacked([one.physics for one in saved], first.physics),
                self._steps[numbers],
                self._begins[numbers],
                [one.streams[0] for one in saved],
                _stacked([one.frames for one in saved], first.frames),
                self.registration,
                self.name,
                [one.memory[0] for one in saved] if first.memory else [],
                [one.copies[0] for one in saved] if as_copies else [],
                {name: values[numbers] for name, values in seen.items()},
                self._begins[numbers] & ~self._has_ended[numbers],
                self._stagger and self._stagger.with_limits(self._limits, numbers),
                _stacked([one.faults for one in saved], first.faults),
            )

    def restore(self, snapshot: Snapshot, rows: RowNumbers = None) -> None:
        """See `Batch`."""
        numbers = self._numbers(rows)
        chosen = [self._rows[row] for row in numbers.tolist() or [0]]
        odd = [row for row in chosen if difference(row.environment) is not None]
        if as_snapshot(snapshot).copies or odd:
            own = Snapshot.of_copy((odd or chosen)[0].environment)
        else:
            own = self._saved(numbers[0] if numbers.size else 0, as_copy=False)
        snapshot.check_all(own, len(numbers), self.step_limit)
        with self._use:
            for index, row in enumerate(numbers.tolist()):
                self._begins[row], self._has_ended[row] = True, False  # until it is complete
                self._restore(row, snapshot.part(index))

    def integration_states(self) -> np.ndarray:
        """See `Batch`."""
        return np.stack([_inside(env).physics.get_state(STATE) for env in self.environments])

    def episode_fields(self) -> dict[str, np.ndarray]:
        """See `Batch`."""
        found: dict[str, np.ndarray] = {}
        for row, inner in enumerate(map(_inside, self.environments)):
            names = inner._saved_fields()
            saved = inner.physics.simulation.save(None, names)
            show_drawn(found, {name: saved[name][0] for name in names}, row, self.num_envs)
        return found

    def _set_checked(self, states: Mapping[str, np.ndarray], rows: np.ndarray) -> dm_env.TimeStep:
        index = {row: i for i, row in enumerate(rows.tolist())}

        def start(row: int) -> dm_env.TimeStep:
            state = {name: values[index[row]] for name, values in states.items()}
            return settable(self._rows[row].environment).set_state(state)

        self._take_starts(start, rows)
        return self._present()

    def state_sizes(self) -> dict[str, int]:
        """See `Batch`."""
        self._use.check()
        sizes = [state_sizes(settable(env).physics) for env in self.environments]
        return sizes[0]

    def _free(self) -> None:
        self._threads.close()
        for row in self._rows:
            row.environment.close()

    def __repr__(self) -> str:
        return f"{super().__repr__()[:-1]}, not vectorised: {self.why_rows}>"

    def __deepcopy__(self, memo: dict[int, object]) -> "RowsEnvironment":
        for env in self.environments:
            exact_copies(env, memo)
        new = type(self).__new__(type(self))
        memo[id(self)] = new
        vars(new).update(copy.deepcopy(vars(self), memo))
        return new

    def single_action_spec(self) -> specs.BoundedArray:
        """See `Batch`."""
        return self._form.action_spec

    def observation_spec(self) -> Mapping[str, specs.Array]:
        """See `Batch`."""
        of_one = self._form.observation_spec.items()
        return collections.OrderedDict((n, _batched(spec, self.num_envs)) for n, spec in of_one)

    @property
    def step_limit(self) -> float:
        """See `Batch`."""
        return self._full_limits[0] if self._own_limit is None else self._own_limit

    @step_limit.setter
    def step_limit(self, limit: float) -> None:
        if self._stagger is not None:
            check_limit(limit)
        self._own_limit = limit
        for row in range(self.num_envs):
            self._set_limit(row, limit)

    def draw_every(self, steps: int) -> None:
        """See `Batch`."""
        self._draw_interval = guards.at_least_one("steps", steps)
        for row in range(self.num_envs):
            self._set_up(row)

    @property
    def timed_out(self) -> np.ndarray:
        """See `Batch`."""
        # A plain environment reports it; the last step of any other is one if its discount is 1.
        return self._timed_out & self._begins

    @property
    def reward_terms(self) -> dict[str, Quantity]:
        """See `Batch`."""
        of_rows: list[Mapping[str, Quantity]] = [
            self._summed_terms[row]
            if row in self._summed_terms
            else shown_by(env, "reward_terms", {})
            for row, env in enumerate(self.environments)
        ]
        without = (self._steps == 0) | self.diverged  # may have none
        names = next((list(terms) for terms in of_rows if terms), [])
        if any(list(terms) != names for terms, no in zip(of_rows, without, strict=True) if not no):
            return {}
        return {
            name: np.array([float(terms.get(name, 0.0)) for terms in of_rows]) for name in names
        }

    @property
    def success(self) -> np.ndarray | None:
        """See `Batch`."""
        of_rows = [shown_by(env, "success") for env in self.environments]
        if all(one is None for one in of_rows):
            return None
        return np.array([bool(one) for one in of_rows])

    @property
    def randomization(self) -> dict[str, np.ndarray]:
        """See `Batch`."""
        shown: dict[str, np.ndarray] = {}
        for row, env in enumerate(self.environments):
            show_drawn(shown, shown_by(env, "randomization", {}), row, self.num_envs)
        return shown

    @property
    def pixels(self) -> Pixels | None:
        """See `Batch`."""
        return shown_by(self.environments[0], "pixels")

    def control_timestep(self) -> float:
        """See `Batch`."""
        self._use.check()
        return self._form.control_timestep

    def _draw(self, rows: np.ndarray, **kwargs: object) -> np.ndarray:
        physics = [physics_of(self.environments[row]) for row in rows.tolist()]
        if not physics:
            shape, dtype = physics_of(self.environments[0]).picture_spec(**kwargs)
            return np.empty((0, *shape), dtype)
        return np.stack([one.render(**kwargs) for one in physics])

    def get_attr(self, name: str) -> list[object]:
        """An attribute of each row's environment, or of its task if only that has it.

        Raises:
          AttributeError: neither has such an attribute in some row.
        """
        return [getattr(holder_of(env, name), name) for env in self.environments]

    def set_attr(self, name: str, values: Sequence[object]) -> None:
        """Sets an attribute of each row's environment, and of those made for a row's later seeds.

        A name that only the task has is set there.

        Args:
          name: of the attribute.
          values: one for each row.

        Raises:
          ValueError: there are not as many values as rows.
        """
        if len(values) != self.num_envs:
            raise ValueError(
                f"there are {len(values)} values of {name!r}; expected {self.num_envs}, one for "
                "each row"
            )
        with self._use:
            for row, value in enumerate(values):
                self._rows[row].set_attribute(name, value)
                self._set_up(row)

    def call(self, name: str, *args: object, **kwargs: object) -> list[object]:
        """The results of a method, or the values of an attribute, of each row's environment."""
        with self._use:
            # Any: of the rows' own classes.
            found: list[Any] = self.get_attr(name)
            return [one(*args, **kwargs) if callable(one) else one for one in found]

    def _checked(self, actions: npt.ArrayLike, begins: np.ndarray) -> np.ndarray:
        """A copy of the actions, since environments may keep theirs."""
        given = np.array(guards.check_actions(actions, self.num_envs, begins, self.first_row))
        given = in_shape(given, self._action_spec.shape, self.num_envs)
        if arrays.any_of(begins) and given.dtype.kind == "f":
            # Rows that begin ignore their action, which a wrapper may check nevertheless.
            bad = begins & ~np.isfinite(given.reshape(self.num_envs, -1)).all(axis=-1)
            given[bad] = 0.0
        return given

    def _seed(self, row: int, seed: int, keeps_model: bool = False) -> None:
        seed = checked_seed(seed)
        self._set_limit(row, self._full_limits[row])
        self._rows[row].begin(seed, keeps_model)
        self._set_up(row)
        self._full_limits[row] = self._limit_of(self._rows[row].environment)
        self._seeds[row] = seed
        if self._stagger is not None:
            self._stagger.draw(row, np.random.RandomState(seed))

    def _set_up(self, row: int) -> None:
        """Makes a plain environment repeat actions by itself; of others `step` is repeated."""
        inner = control_of(self._rows[row].environment)
        if isinstance(inner, Environment):
            set_action_repeat(inner, self._action_repeat if self._rows[row].is_plain else 1)
            inner.draw_every(self._draw_interval)

    @staticmethod
    def _limit_of(env: dm_env.Environment) -> float:
        return getattr(control_of(env), "_step_limit", math.inf)

    def _set_limit_of_next(self, row: int) -> None:
        """Sets the limit of the episode that begins."""
        limit = self._full_limits[row] if self._own_limit is None else self._own_limit
        if self._stagger is not None:
            limit = self._stagger.limit_of_next(row, limit)
        self._set_limit(row, limit)

    def _set_limit(self, row: int, limit: float) -> None:
        """Sets the limit of a row's episode; an environment that counts its steps ends by it."""
        self._limits[row] = limit
        inner = control_of(self._rows[row].environment)
        if isinstance(inner, Environment) and inner._step_limit != limit:
            inner._step_limit = limit

    def _saved(self, row: int, as_copy: bool) -> Snapshot:
        env, plain = self._rows[row].environment, self._rows[row].plain
        if plain is not None and not as_copy:
            return plain.snapshot()
        check_copies(env, are_seeded=False)
        return Snapshot.of_copy(copied(env), self.registration, self.name)

    def _restore(self, row: int, part: Snapshot) -> None:
        """Continues a row from a snapshot of one environment."""
        seeded = self._rows[row]
        limit = self._full_limits[row] if self._own_limit is None else self._own_limit
        if self._stagger is not None:
            of_part, share = (limit, 1.0) if part.limits is None else part.limits[0]
            limit, self._stagger.shares[row] = min(of_part, limit), share
        # Before too: an environment refuses an episode that is longer than its own limit.
        self._set_limit(row, limit)
        inner = control_of(seeded.environment)
        if isinstance(inner, Environment) and inner is seeded.environment:  # it stays the same
            inner.restore(part)
        else:
            seeded.replace(copied(part.copies[0]))
        observation = part.observations
        if not observation:
            inner = control_of(seeded.environment)
            if isinstance(inner, Environment) and not part.begins[0]:
                present = as_mapping(inner.present_observation())
                observation = {name: np.asarray(value)[None] for name, value in present.items()}
        for name, values in observation.items():
            if name in self._observation and self._observation[name][row].shape == values.shape[1:]:
                self._observation[name][row] = values[0]
        self._set_up(row)
        self._set_limit(row, limit)
        self._steps[row] = part.step_count[0]
        self._begins[row] = part.begins[0]
        self._has_ended[row] = part.begins[0] and not part.resets.any()
        self._seeds[row] = None
        self._timed_out[row] = self.diverged[row] = False

    def _raise(self, errors: RowErrors) -> None:
        """Raises the first error of a row, if there is one, with the row's number."""
        errors = sorted(errors, key=lambda one: (isinstance(one[1], Exception), one[0]))
        if not errors:
            return
        row, error = errors[0]
        self.restart()
        note = (
            f"raised by the environment of row {row + self.first_row}; every row begins an episode "
            "with the next step"
        )
        if note not in getattr(error, "__notes__", ()):  # one object may be raised repeatedly
            error.add_note(note)
        raise error

    def _empty(self) -> dict[str, np.ndarray]:
        return {
            name: np.zeros((self.num_envs, *spec.shape), spec.dtype)
            for name, spec in self._form.observation_spec.items()
        }

    def _shown(self, observation: dict[str, np.ndarray]) -> MutableMapping[str, np.ndarray]:
        return collections.OrderedDict(observation)


def _in_parts(seeded: Seeded) -> Environment | None:
    """The environment of a row, if it is plain and its control step can be taken in parts."""
    plain = seeded.plain
    return plain if plain is not None and plain._steps_in_parts else None


def _batched(spec: specs.Array, num_envs: int) -> specs.Array:
    if isinstance(spec, specs.BoundedArray):
        return guards.batched_spec(spec, num_envs)
    return specs.Array((num_envs, *spec.shape), spec.dtype, name=spec.name)


def _inside(env: dm_env.Environment) -> Environment:
    """The `control.Environment` within an environment of any class."""
    inner = control_of(env)
    if isinstance(inner, Environment):
        return inner
    raise TypeError(
        f"a {type(env).__name__} has no limberjack.rl.control.Environment inside, whose state "
        "could be kept"
    )


def _checked_contexts(
    contexts: Sequence[Mapping[str, object]] | None, num_envs: int, build: Build
) -> list[Mapping[str, object]]:
    """The contexts of the rows as a list; empty if there are none."""
    if contexts is None:
        return []
    if build.copies:
        raise TypeError(
            "contexts are keywords for a function build(seed, **context), but an environment was "
            "given: pass the function that makes it"
        )
    if isinstance(contexts, str) or not isinstance(contexts, Sequence):
        raise TypeError(f"contexts is {contexts!r}; expected a sequence of mappings, one a row")
    if len(contexts) != num_envs:
        raise ValueError(f"there are {len(contexts)} contexts; expected {num_envs}, one a row")
    for row, context in enumerate(contexts):
        if not isinstance(context, Mapping):
            raise TypeError(f"the context of row {row} is {context!r}; expected a mapping")
    return list(contexts)


def _stacked(
    parts: Sequence[Mapping[str, np.ndarray]], like: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    none = {name: values[:0] for name, values in like.items()}
    return {n: np.concatenate([none[n], *(one[n] for one in parts)]) for n in like}
