"""`BatchEnvironment`: many episodes of one task, stepped in lockstep.

    env = BatchEnvironment.from_environment(single, num_envs=256, seed=0)
    time_step = env.reset()
    while True:
        time_step = env.step(policy(time_step.observation))   # actions (256, nu)

Everything has a leading axis of `num_envs` rows. Row i equals the single environment with seed
`seed + i`, bit for bit, regardless of the number of rows and threads and of the other rows. A row
whose episode has ended begins its next one at the next step, which ignores its action.

It is one idea, and long: every method acts on the state, the streams and the counters of the same
rows, and each of these is a class with a module of its own.

In the batched `dm_env.TimeStep`, `step_type`, `reward` and `discount` are arrays of (num_envs,); a
row whose episode has just begun has reward 0 and discount 1.
"""

import copy
import functools
from collections.abc import Iterable, Mapping, MutableMapping, Sequence
from typing import Any, NamedTuple, Self

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.mujoco.replicas import Replicas
from limberjack.mujoco.simulation import STATE
from limberjack.rl import control, guards, observations
from limberjack.rl.action_specs import bounded_spec
from limberjack.rl.batch_contract import Batch, RowNumbers
from limberjack.rl.batch_errors import NotVectorised
from limberjack.rl.batch_safety import (
    check_apart,
    check_batch_safe,
    check_episode_fields,
    check_plain,
    is_proved,
)
from limberjack.rl.contract import Task
from limberjack.rl.copies import check_copies
from limberjack.rl.endings import Counter, Repeated
from limberjack.rl.episode_attributes import EpisodeAttributes, check_declared
from limberjack.rl.given_state import state_sizes
from limberjack.rl.late_changes import LateChanges
from limberjack.rl.memory import Memory, remembered
from limberjack.rl.pixels import Frames, Pixels, saved_pictures
from limberjack.rl.randomize import show_drawn, stream_beside
from limberjack.rl.reward_terms import reward_and_terms, success_of
from limberjack.rl.snapshot import Snapshot, as_snapshot, origin_of
from limberjack.rl.streams import Streams, check_limit, set_stream_fields
from limberjack.rl.threads import threads_for
from limberjack.utils import arrays
from limberjack.utils.arrays import Quantity
from limberjack.worlds.appearance import Looks

__all__ = ["BatchEnvironment"]

_LAST = int(dm_env.StepType.LAST)


class _Apart(NamedTuple):
    """Rows, their states (n, ...), and their own model fields by name."""

    rows: np.ndarray
    state: np.ndarray
    own: dict[str, np.ndarray]


class BatchEnvironment(Batch):
    """Episodes of a task on a batch of simulations; see the module's docstring.

    Attributes:
      world: the settings by which the rows' worlds differ from the task's own; None if they do not.
    """

    # Shape and dtype of each observation, by name, once they are known.
    _forms: dict[str, tuple[tuple[int, ...], np.dtype]]
    # Each row's last observation, and whether it is known. A row that is not stepped shows it
    # again, since a task that remembers may answer differently when it is asked again.
    _observed: MutableMapping[str, np.ndarray]
    _has_observed: np.ndarray

    def __init__(
        self,
        env: control.Environment,
        num_envs: int,
        num_threads: int | None = None,
        seed: int | None = None,
        on_divergence: str = "end",
        stagger: bool = False,
        action_repeat: int | None = None,
    ) -> None:
        """Creates a batch; see `from_environment`."""
        check_plain(env)
        num_envs = guards.at_least_one("num_envs", num_envs)
        self._randomizer = env._ours.randomizer
        self._saved_fields, self.world = env._saved_fields(), control.Environment.world.of(env)
        check_episode_fields(env.task)
        check_declared(env.task)
        saved = env.physics.simulation.save(None, self._saved_fields)
        guards.check_memory(num_envs, saved.values())
        repeat = env._ours.action_repeat if action_repeat is None else action_repeat
        super().__init__(num_envs, seed, on_divergence, repeat, stagger)
        proved = is_proved(env.task, env.physics, env._ours.randomizer)
        self._task = task = _task_of(env, proved)
        self.name = env._ours.name or type(task).__name__
        self.registration = env._ours.registration
        self._n_sub_steps, self._flat_observation = env._n_sub_steps, env._flat_observation
        self._make_replicas(env, num_threads)
        self._randomization: dict[str, np.ndarray] = {}
        self._streams = Streams(self._seeds[0], num_envs)
        self._seeds = self._streams.seeds
        self._counter = Counter(num_envs, env._step_limit, type(task).__name__)
        self._steps = self._counter.steps
        self._reward_terms: dict[str, Quantity] = {}
        self._last_terms: Mapping[str, Quantity] = {}  # of each row's last control step
        if stagger:
            self.step_limit = env._step_limit
        self._all_begin = self._begins.copy()
        spec = bounded_spec(task, self._replicas.single)
        self._action_spec = guards.batched_spec(spec, num_envs)
        self._is_proved = proved
        if not proved:
            self._check_task(spec)
        self._memory = EpisodeAttributes(task, num_envs, proved)
        self._late = self._new_late_changes()
        self._forms, self._observed = {}, {}
        self._has_observed = np.zeros(num_envs, bool)
        self._begin_streams(range(num_envs))

    def _make_replicas(self, env: control.Environment, num_threads: int | None) -> None:
        """Makes the rows' simulations, and what is drawn and measured in each of them."""
        threads, ours = threads_for(num_threads, self.num_envs, env), env._ours
        # Any: of the domain's own physics.
        replicas: Replicas[Any] = env.physics.replicate(self.num_envs, threads, self._saved_fields)
        self._replicas = replicas
        self._frames = Frames.of(control.Environment.pixels.of(env), replicas)
        self._faults = None if ours.faults is None else ours.faults.of_rows(self.num_envs)
        self._looks = replicas.looks = Looks.of_rows(ours.looks, self.num_envs)
        self._first_fields = env._first_fields()

    @classmethod
    def from_environment(
        cls,
        env: control.Environment,
        num_envs: int,
        num_threads: int | None = None,
        seed: int | None = None,
        on_divergence: str = "end",
        stagger: bool = False,
        action_repeat: int | None = None,
    ) -> Self:
        """A batch of environments like `env`, which is not changed.

        Its first `step` or `reset` begins an episode in every row.

        Args:
          env: a single environment, of the suite or with your own batch-safe task.
          num_envs: number of rows.
          num_threads: number of threads; by default as many cores as a step can occupy.
          seed: row i draws its episodes from `RandomState(seed + i)`; None for an arbitrary seed.
          on_divergence: 'end' ends the episodes of rows that diverge, with reward and discount 0;
            'raise' raises `PhysicsError`.
          stagger: end the first episode of each row after a random number of steps; see
            `limberjack.rl.streams`.
          action_repeat: control steps per action; None for that of `env`.

        Raises:
          ValueError: the environment has methods of its own, or its task cannot be vectorised; or a
            number is out of range. `limberjack.rl.batch_of` takes such environments too.
          MemoryError: this many rows do not fit into memory.
        """
        how = num_envs, num_threads, seed, on_divergence, stagger, action_repeat
        try:
            return cls(env, *how)
        except NotVectorised as reason:
            reason.advice = ". limberjack.rl.batch_of makes a batch of complete environments"
            raise

    def reset(
        self, ids: RowNumbers = None, seeds: Sequence[int | None] | None = None
    ) -> dm_env.TimeStep:
        """See `Batch`."""
        rows = self._numbers(ids)
        of_rows = guards.seeds_of_rows(seeds, len(rows))
        with self._use, arrays.rows_of_a_batch(self.num_envs):
            self._replicas.check()
            self._begins[rows] = True  # until complete: after an interrupt, rows begin again
            for row, seed in zip(rows.tolist(), of_rows, strict=True):
                if seed is not None:
                    self._streams.replace(row, np.random.RandomState(seed), seed)
                    self._memory.begin_again([row])
                    if self._faults is not None:
                        self._faults.begin_again([row])
                    self._begin_streams([row])
            self._begin(rows)
            observation = self._observe(self._mask(rows), is_step=False)
            self._begins[rows] = self.diverged[rows] = False
        return self._counter.shown(observation)

    def step(self, actions: npt.ArrayLike) -> dm_env.TimeStep:
        """See `Batch`."""
        with self._use, arrays.rows_of_a_batch(self.num_envs):
            begins = self._begins
            self._replicas.check()
            checked = guards.check_actions(actions, self.num_envs, begins, self.first_row)
            stepped = ~begins if self._remembers else None
            self._late.begin_step()
            self._before_step(checked, stepped)
            # Until the step is complete: after an interrupt, all rows begin again.
            self._begins = self._all_begin.copy()
            if self._action_repeat != 1:
                return self._step_repeatedly(checked, begins)
            return self._step(begins)

    def _step(self, begins: np.ndarray) -> dm_env.TimeStep:
        are_some = arrays.any_of(begins)
        stepped = self._simulate(~begins if are_some else None)
        seen = None if stepped is None else stepped | begins
        if are_some:  # only now, since `after_step` must not change a start
            self._begin(np.flatnonzero(begins))
        reward, self._reward_terms = self._reward(stepped)
        observation = self._observe(seen)
        termination = self._termination(stepped)
        time_step, self._begins = self._counter.count(
            begins if are_some else None, self.diverged, reward, termination, observation
        )
        return time_step

    def _step_repeatedly(self, actions: np.ndarray, begins: np.ndarray) -> dm_env.TimeStep:
        """Makes several control steps with the actions, which the task has just received.

        Rows whose episode ends wait unchanged. Those that begin one do so at the end, so that no
        hook of a step changes their start.
        """
        replicas, counter = self._replicas, self._counter
        simulation = replicas.simulation
        total = Repeated(self.num_envs)
        active, diverged = ~begins, np.zeros(self.num_envs, bool)
        waiting: list[tuple[np.ndarray, Mapping[str, np.ndarray]]] = []
        for number in range(self._action_repeat):
            is_final = number == self._action_repeat - 1 or not arrays.any_of(active)
            if number and arrays.any_of(active):
                self._before_step(actions, active)
            stepped = self._simulate(active)
            diverged |= self.diverged
            if is_final and arrays.any_of(begins):
                self._begin(np.flatnonzero(begins))
            reward, terms = self._reward(stepped)
            state = self._state(stepped | begins if is_final and stepped is not None else stepped)
            termination = self._termination(stepped)
            steps = counter.steps.copy()
            time_step, last = counter.count(~active, self.diverged, reward, termination, state)
            counter.steps[~active] = steps[~active]
            shown = active | begins if is_final else active
            total.add(time_step, terms, shown, active, self.diverged)
            ended = np.flatnonzero(last & ~self.diverged)
            if is_final:
                break
            if ended.size:
                waiting.append((ended, simulation.save(ended, self._saved_fields)))
            active = active & ~last
        for rows, saved in waiting:
            simulation.load(saved, rows)
            self._late.computed(rows)
        self.diverged = diverged
        self._reward_terms, self._last_terms = total.terms, total.last_terms
        if self._memory.names:
            self._observed = {n: v.copy() for n, v in total.observation.items()}
            self._has_observed[:] = True
        if self._frames is not None:
            total.observation = self._frames.observe(replicas, total.observation)
        self._begins = (total.step_type == _LAST) | diverged
        return total.time_step()

    @property
    def _remembers(self) -> bool:
        """Whether calls may count for some rows only: of a user's task, or of faults."""
        return self._faults is not None or not self._is_proved

    def _apart(self, rows: np.ndarray | None) -> "_Apart | None":
        """The simulations of the rows for which a hook does not count, and must change nothing."""
        others = None if rows is None or self._is_proved else np.flatnonzero(~rows)
        if others is None or not others.size:
            return None
        simulation = self._replicas.simulation
        own = {name: field[others] for name, field in simulation.own_fields.items()}
        return _Apart(others, simulation.state[others], own)

    def _put_back(self, apart: "_Apart | None") -> None:
        if apart is not None:
            simulation = self._replicas.simulation
            simulation.state[apart.rows] = apart.state
            for name, values in apart.own.items():
                simulation.own_fields[name][apart.rows] = values

    def _before_step(self, actions: np.ndarray, rows: np.ndarray | None) -> None:
        """Hands the actions to the task, which remembers them in a mask of rows only."""
        physics, faults = self._replicas.physics, self._faults
        if faults is not None:
            actions = faults.act(actions)
        apart = self._apart(rows)
        with self._memory.during("before_step", physics, rows):
            self._task.before_step(actions, physics)
        self._put_back(apart)
        if faults is not None:
            faults.accept(rows)

    def _simulate(self, active: np.ndarray | None) -> np.ndarray | None:
        """Steps the simulations of a mask of rows, None for all, and calls `after_step`.

        Returns:
          A mask of the rows that did not diverge, (num_envs,); None if nothing is remembered.
        """
        running = None if active is None else np.flatnonzero(active)
        doubts = self._late.doubts(running)
        self.diverged = self._replicas.step(running, self._n_sub_steps)
        self._late.check(doubts, self._n_sub_steps, self.diverged)
        self._late.computed()
        if arrays.any_of(self.diverged):
            self._report_divergence()
        stepped = None
        if self._remembers:
            stepped = ~self.diverged if active is None else active & ~self.diverged
        if running is None or running.size:
            physics = self._replicas.physics
            apart = self._apart(stepped)
            with self._memory.during("after_step", physics, stepped):
                self._task.after_step(physics)
            self._put_back(apart)
            self._late.take_forward()  # before rows begin, which are computed by themselves
        return stepped

    def _reward(self, rows: np.ndarray | None) -> tuple[Quantity, dict[str, Quantity]]:
        """The rewards and their terms; the task remembers the call in a mask of rows only."""
        physics = self._replicas.physics
        apart = self._apart(rows)
        with self._memory.during("get_reward", physics, rows):
            reward, terms = reward_and_terms(self._task, physics)
        self._put_back(apart)
        if self._faults is not None:
            reward = self._faults.reward(reward, rows)
        return reward, terms

    def _termination(self, rows: np.ndarray | None) -> Quantity | None:
        """The task's termination; it remembers the call in masked rows before the limit only."""
        physics = self._replicas.physics
        going_on = None if rows is None else rows & ~self._counter.reach_limit
        apart = self._apart(going_on)
        with self._memory.during("get_termination", physics, going_on):
            ending = self._task.get_termination(physics)
        self._put_back(apart)
        self._late.after_hooks()
        return ending

    def snapshot(self, rows: RowNumbers = None) -> Snapshot:
        """See `Batch`."""
        rows = self._numbers(rows)
        with self._use:
            return Snapshot(
                self._origin,
                self._replicas.simulation.save(rows, self._saved_fields),
                self._counter.steps[rows],
                self._begins[rows],
                self._streams.save(rows, with_beside=self._randomizer is not None),
                saved_pictures(self._frames, self._looks, rows),
                self.registration,
                self.name,
                self._remembered(rows),
                limits=self._limits(rows),
                faults={} if self._faults is None else self._faults.save(rows),
            )

    def restore(self, snapshot: Snapshot, rows: RowNumbers = None) -> None:
        """See `Batch`."""
        rows = self._numbers(rows)
        as_snapshot(snapshot).check_all(self.snapshot([0]), len(rows), self.step_limit)
        memory = [one.get("task", {}) for one in snapshot.memory]
        self._memory.check(memory)
        with self._use:
            self._replicas.check()
            self._begins[rows] = True  # until it is complete
            self._replicas.simulation.load(snapshot.physics, rows)
            self._streams.load(rows, snapshot.streams)
            if self._randomizer is not None:
                fields = self._randomizer.fields
                saved = {name: snapshot.physics[name] for name in fields}
                show_drawn(self._randomization, saved, rows, self.num_envs)
            if self._frames is not None:
                self._frames.load(snapshot.frames, rows)
            if self._faults is not None:
                self._faults.load(snapshot.faults, rows)
                show_drawn(self._randomization, self._faults.drawn(rows), rows, self.num_envs)
            if self._looks is not None:
                streams = [self._streams.own[row] for row in rows.tolist()]
                self._looks.load(snapshot.frames, rows, streams)
            self._counter.steps[rows] = snapshot.step_count
            self._set_limits(rows, snapshot.limits)
            if memory:
                self._memory.load(rows, memory)
            self._late.forget()
            self._has_observed[rows] = False
            self._begins[rows], self.diverged[rows] = snapshot.begins, False

    def integration_states(self) -> np.ndarray:
        """See `Batch`."""
        return self._replicas.simulation.get_state(STATE)

    def episode_fields(self) -> dict[str, np.ndarray]:
        """See `Batch`."""
        saved = self._replicas.simulation.save(None, self._saved_fields)
        return {name: saved[name] for name in self._saved_fields}

    def _set_checked(self, states: Mapping[str, np.ndarray], rows: np.ndarray) -> dm_env.TimeStep:
        with arrays.rows_of_a_batch(self.num_envs):
            for name, values in states.items():
                getattr(self._replicas.physics.data, name)[rows] = values
            self._start(rows)
            if self._frames is not None:
                self._frames.forget(rows)
            if self._faults is not None:
                self._faults.forget(rows)
            observation = self._observe(self._mask(rows), is_step=False)
        return self._counter.shown(observation)

    def state_sizes(self) -> dict[str, int]:
        """See `Batch`."""
        self._use.check()
        return state_sizes(self._replicas.single)

    def _free(self) -> None:
        self._replicas.free()

    def check_task(self) -> None:
        """Checks again that the task, whose settings have changed, is batch-safe.

        Raises:
          ValueError, TypeError: it is not; see `limberjack.rl.batch_safety`.
        """
        single = self._replicas.single
        with self._memory.of_row(0, single, "check_task"):
            self._check_task(bounded_spec(self._task, single))

    def _new_late_changes(self) -> LateChanges:
        name, is_idle = type(self._task).__name__, self._memory.is_idle
        return LateChanges(self._replicas, name, self._saved_fields, is_idle)

    def _check_task(self, spec: specs.BoundedArray) -> None:
        how = self._n_sub_steps, self._saved_fields, self._randomizer
        check_batch_safe(self._task, self._replicas, spec, *how)

    def keep_as_first(self, name: str) -> None:
        """Makes a reset with a seed put back the present values of a declared attribute."""
        self._memory.keep_as_first(name)

    def __getstate__(self) -> dict[str, object]:
        """State for an equal batch: for pickling, deep copies and spawned processes."""
        unlike = ("_replicas", "_use", "_frames", "_late")  # each batch has its own
        kept = {name: value for name, value in vars(self).items() if name not in unlike}
        making = self._replicas.textured, self.num_envs, self._replicas.num_threads
        drawing = None if self._frames is None else (self._frames.pixels, self._frames.schedule)
        return {**kept, "making": making, "drawing": drawing, "snapshot": self.snapshot()}

    def __setstate__(self, state: dict[str, object]) -> None:
        snapshot, making = as_snapshot(state.pop("snapshot")), state.pop("making")
        drawing = state.pop("drawing")
        assert isinstance(making, tuple)
        assert isinstance(drawing, tuple | None)
        single, num_envs, num_threads = making
        vars(self).update(state)
        self._use = guards.OneUser("batch")
        self._replicas = single.replicate(num_envs, num_threads, self._saved_fields)
        self._late = self._new_late_changes()
        self._frames = None
        if drawing is not None:
            pixels, schedule = drawing
            self._frames = Frames(pixels, self._replicas)
            self._frames.schedule = schedule
        self._replicas.looks = self._looks
        diverged, has_observed = self.diverged.copy(), self._has_observed.copy()
        seeds = list(self._seeds)
        self.restore(snapshot)
        self.diverged, self._has_observed, self._seeds[:] = diverged, has_observed, seeds

    @functools.cached_property
    def _origin(self) -> dict[str, object]:
        pixels = {} if self._frames is None else self._frames.origin()
        parts = self._task, self._replicas.physics, self._saved_fields
        return origin_of(*parts, pixels, self.world)

    def single_action_spec(self) -> specs.BoundedArray:
        """See `Batch`."""
        return self._task.action_spec(self._replicas.single)

    def observation_spec(self) -> Mapping[str, specs.Array]:
        """See `Batch`."""
        with arrays.rows_of_a_batch(self.num_envs):
            spec = observations.specs_of(self._state(self._mask([])))
        return spec if self._frames is None else self._frames.spec_with(spec)

    @property
    def step_limit(self) -> float:
        """See `Batch`."""
        return self._counter.step_limit

    @step_limit.setter
    def step_limit(self, limit: float) -> None:
        if self._stagger is not None:
            self._counter.limits = np.full(self.num_envs, check_limit(limit))
        self._counter.step_limit = limit

    def draw_every(self, steps: int) -> None:
        """See `Batch`."""
        if self._frames is not None:
            self._frames.interval = guards.at_least_one("steps", steps)

    @property
    def timed_out(self) -> np.ndarray:
        """See `Batch`."""
        return self._begins & self._counter.at_limit & ~self.diverged

    @property
    def success(self) -> np.ndarray | None:
        """See `Batch`."""
        terms = self._reward_terms if self._action_repeat == 1 else self._last_terms
        success = success_of(self._task, terms)
        return None if success is None else np.asarray(success)

    @property
    def reward_terms(self) -> dict[str, Quantity]:
        """See `Batch`."""
        return self._reward_terms

    @property
    def randomization(self) -> dict[str, np.ndarray]:
        """See `Batch`."""
        return self._randomization

    @property
    def pixels(self) -> Pixels | None:
        """See `Batch`."""
        return None if self._frames is None else self._frames.pixels

    def control_timestep(self) -> float:
        """See `Batch`."""
        self._use.check()
        return self._replicas.single.timestep() * self._n_sub_steps

    def _draw(self, rows: np.ndarray, **kwargs: object) -> np.ndarray:
        return self._replicas.render_rows(rows, **kwargs)

    @property
    def physics(self) -> Any:  # of the domain's own class
        """The batched physics."""
        return self._replicas.physics

    @property
    def single(self) -> Any:  # of the domain's own class
        """A separate single simulation of the same model, for specs and constants; not a row."""
        return self._replicas.single

    @property
    def task(self) -> Any:  # of the domain's own class
        """The task."""
        return self._task

    def _begin(self, rows: np.ndarray) -> None:
        """Begins an episode in each of the rows."""
        replicas, task = self._replicas, self._task
        for row in rows.tolist():
            task._random = self._streams.own[row]
            if self._faults is not None:
                replicas.simulation.set_fields(self._faults.begin(row, task._random), row)
                show_drawn(self._randomization, self._faults.drawn(row), row, self.num_envs)
            if self._looks is not None:
                self._looks.begin(row, self._streams.own[row])
            if self._randomizer is not None:
                drawn = self._randomizer.draw(self._streams.beside[row])
                show_drawn(self._randomization, drawn, row, self.num_envs)
                replicas.simulation.set_fields(drawn, row)
            with replicas.episode(row) as one, self._memory.of_row(row, one):
                task.initialize_episode(one)
        self._start(rows)
        if self._frames is not None:
            self._frames.forget(rows)
        self._counter.steps[rows] = 0
        if self._stagger is not None and self._counter.limits is not None:
            for row in rows.tolist():
                limit = self._stagger.limit_of_next(row, self._counter.step_limit)
                self._counter.limits[row] = limit

    def _start(self, rows: np.ndarray) -> None:
        """Computes all quantities of rows from the states in which they start."""
        self._replicas.start(rows)
        self._late.computed(rows)

    def _begin_streams(self, rows: Iterable[int]) -> None:
        """Draws from the rows' new streams: the length of a first episode, and model fields.

        Fields that only some starts set have the values from before the first episode.
        """
        simulation, streams = self._replicas.simulation, self._streams
        for row in rows:
            own = streams.own[row]
            if self._stagger is not None:  # before the task draws from the stream
                self._stagger.draw(row, own)
            if self._first_fields:
                simulation.set_fields(self._first_fields, row)
            if set_stream_fields(self._task, own, simulation, row):
                streams.beside[row] = stream_beside(own)

    def _limits(self, rows: np.ndarray) -> np.ndarray | None:
        """The limits of rows as a snapshot holds them."""
        if self._stagger is None or self._counter.limits is None:
            return None
        return self._stagger.with_limits(self._counter.limits, rows)

    def _set_limits(self, rows: np.ndarray, saved: np.ndarray | None) -> None:
        if self._stagger is None or self._counter.limits is None:
            return
        full = self._counter.step_limit
        self._counter.limits[rows] = full if saved is None else np.minimum(saved[:, 0], full)
        self._stagger.shares[rows] = 1.0 if saved is None else saved[:, 1]

    def _observe(
        self, rows: np.ndarray | None, is_step: bool = True
    ) -> MutableMapping[str, np.ndarray]:
        """Current observations in fresh arrays; a step renders every row.

        Args:
          rows: mask of rows that observe, (num_envs,); None for all.
          is_step: whether this is a step instead of a start.
        """
        state, frames = self._state(rows), self._frames
        if self._memory.names and rows is not None:
            waiting = self._has_observed & ~rows
            for name, values in self._observed.items():
                state[name][waiting] = values[waiting]
            self._observed = {name: values.copy() for name, values in state.items()}
            self._has_observed |= rows
        return state if frames is None else frames.observe(self._replicas, state, is_step)

    def _state(self, rows: np.ndarray | None) -> MutableMapping[str, np.ndarray]:
        """The observations, without pictures; the task remembers them in a mask of rows only."""
        physics = self._replicas.physics
        apart = self._apart(rows)
        with self._memory.during("get_observation", physics, rows):
            observation = self._task.get_observation(physics)
        self._put_back(apart)
        self._check_forms(observation)
        if self._faults is not None:
            observation = self._faults.observe(observation, rows)
        return observations.of_rows(observation, self.num_envs, self._flat_observation)

    def _mask(self, rows: np.ndarray | Sequence[int]) -> np.ndarray:
        """A mask of rows from their numbers, (num_envs,)."""
        mask = np.zeros(self.num_envs, bool)
        mask[rows] = True
        return mask

    def _remembered(self, rows: np.ndarray) -> list[Memory]:
        """Memory of rows, in the form of a single environment's snapshot."""
        common = {} if self._memory.is_idle else remembered(self._task, self._replicas.single)
        if not common:  # of the suite's own task
            return []
        own = self._memory.of_rows(rows)
        return [{**common, "task": {**common["task"], **values}} for values in own]

    def _check_forms(self, observation: object) -> None:
        """Raises unless an observation has the names, shapes and dtypes of the first one."""
        task = type(self._task).__name__
        if not isinstance(observation, Mapping):
            raise TypeError(
                f"get_observation of task {task} returned {observation!r}; expected a mapping from "
                "names to arrays"
            )
        forms = self._forms
        if not forms:
            for name, value in observation.items():
                if not isinstance(value, np.ndarray) or value.shape[:1] != (self.num_envs,):
                    raise ValueError(
                        f"observation {name!r} of task {task} is {value!r}; expected an array of "
                        f"{self.num_envs} rows"
                    )
                forms[name] = value.shape, value.dtype
            return
        for name, value in observation.items():
            form = forms.get(name)
            if form is None or getattr(value, "shape", None) != form[0] or value.dtype != form[1]:
                shape, dtype = getattr(value, "shape", value), getattr(value, "dtype", None)
                raise ValueError(
                    f"observation {name!r} of task {task} has shape {shape} and dtype {dtype}; "
                    f"expected {form or 'no observation of that name'}, as in the first step"
                )
        if len(observation) != len(forms):
            missing = [name for name in forms if name not in observation]
            raise ValueError(f"get_observation of task {task} lacks {missing}, unlike before")


def _task_of(env: control.Environment, proved: bool) -> Task:
    """The task of all rows, as before its first episode; a copy without a copy of the physics.

    Raises:
      NotVectorised: it cannot be copied, or keeps the simulation.
    """
    memo: dict[int, object] = {id(env): env, id(env.physics): env.physics}
    if not proved:
        check_apart(env.task, env.physics, env)
        try:
            check_copies(env, is_vectorised=True)
        except TypeError as error:
            raise NotVectorised(str(error)) from error
    task = copy.copy(env.task) if proved else copy.deepcopy(env.task, memo)
    for name, value in env._first_values().items():
        setattr(task, name, value)
    if getattr(task, "visualize_reward", False):
        # The rows share the colours of materials. (Only `base.Task` has the attribute.)
        task.visualize_reward = False
    return task
