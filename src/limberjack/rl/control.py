"""`Environment`: a `dm_env.Environment` composed of a physics and a task.

The `Physics` simulates and measures, the `Task` defines starts, actions, observations and rewards,
and the `Environment` runs episodes:

    env = Environment(physics, task, time_limit=10, control_timestep=0.01)
    time_step = env.reset()
    while not time_step.last():
        time_step = env.step(policy(time_step.observation))

An episode ends at the time limit (with discount 1) or when the task terminates it (with the task's
discount). A step after the last one begins the next episode, as dm_env specifies. If a step or a
reset is interrupted by divergence, Ctrl-C or an error in the task, the next step begins an episode.

It is one idea, and long: an environment begins, steps, saves and restores one episode.

This module does not depend on MuJoCo; the suite uses `limberjack.mujoco.Physics`.
"""

import contextlib
import copy
import dataclasses
import math
import numbers
import operator
from collections.abc import Mapping
from threading import get_ident
from typing import Any, Self, cast

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.rl import action_specs
from limberjack.rl.contract import (
    Nested,
    Physics,
    PhysicsError,
    SimulatedPhysics,
    Task,
    check_ending,
)
from limberjack.rl.copies import (
    check_copies,
    copied,
    difference,
    exact_copies,
    set_plain,
)
from limberjack.rl.episode_values import NAME as EPISODE_ATTRIBUTES
from limberjack.rl.episode_values import keep_own, values_of
from limberjack.rl.given_state import checked_state, state_sizes
from limberjack.rl.guards import OneUser, at_least_one
from limberjack.rl.memory import is_of_the_suite, put_back, remembered, stand_in
from limberjack.rl.observations import (
    FLAT_OBSERVATION_KEY,
    flat_order,
    flatten_observation,
    specs_of,
)
from limberjack.rl.overridable import overridable
from limberjack.rl.pixels import Frames, PixelOptions, Pixels, saved_pictures
from limberjack.rl.randomize import Draw, Randomizer, stream_beside
from limberjack.rl.references import attributes_of, reaches
from limberjack.rl.represented import Description, represented
from limberjack.rl.reward_terms import reward_and_terms, success_of
from limberjack.rl.snapshot import Snapshot, as_snapshot, origin_of
from limberjack.rl.streams import check_not_randomized, set_stream_fields, stream_of
from limberjack.utils.arrays import Quantity
from limberjack.worlds import World
from limberjack.worlds.appearance import Appearance, AppearanceOptions, Looks
from limberjack.worlds.faults import FaultMemory, Faults, Perturber

__all__ = [
    "FLAT_OBSERVATION_KEY",
    "Environment",
    "Physics",
    "PhysicsError",
    "Task",
    "compute_n_steps",
    "flatten_observation",
    "set_action_repeat",
    "shown_by",
]

_NO_REWARD = np.float64(0.0)  # to which rewards of less precision are added, as in a batch
_MID, _LAST = dm_env.StepType.MID, dm_env.StepType.LAST  # read faster than from the enum


@dataclasses.dataclass(eq=False)
class _Additions:
    """Attributes that dm_control's environment does not have.

    Attributes:
      use: of the environment, by one thread at a time.
      registration: the suite's record of the domain, which makes unpickling import its module.
      name: such as 'humanoid:walk'; empty unless `suite.load` made the environment.
      seeded: a stream of the task, and its seed if known.
      frames: None without pixel observations.
      faults: None without faults.
      looks: None for pictures that look as the model.
      randomizer: None without randomisation.
      draws: the task's stream, and the stream derived from it that model fields are drawn from.
      first: the task's EPISODE_ATTRIBUTES before the first episode; None until that begins.
      first_fields: its EPISODE_FIELDS before that, by name.
      reward_terms: of the last step, by name.
      last_terms: of the last control step.
      reward_so_far: of a step's control steps, also of one that diverges.
      randomization: drawn for this episode, by field.
    """

    use: OneUser = dataclasses.field(default_factory=lambda: OneUser("environment"))
    is_closed: bool = False
    registration: object = None
    name: str = ""
    seeded: tuple[object, object] = (None, None)
    action_repeat: int = 1
    frames: Frames | None = None
    faults: FaultMemory | None = None
    looks: Looks | None = None
    randomizer: Randomizer | None = None
    draws: tuple[np.random.RandomState, np.random.RandomState] | None = None
    first: Mapping[str, object] | None = None
    first_fields: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    reward_terms: dict[str, Quantity] = dataclasses.field(default_factory=dict)
    last_terms: Mapping[str, Quantity] = dataclasses.field(default_factory=dict)
    reward_so_far: Quantity = 0.0
    randomization: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)


class Environment(dm_env.Environment):
    """Episodes of a task on a physics; see the module's docstring."""

    # The attributes of a plain environment: dm_control's, and `_ours`. A subclass or its user may
    # add attributes of any other name, also those of the properties below.
    _task: Task
    _physics: Physics
    _flat_observation: bool
    _n_sub_steps: int
    _step_limit: float
    _step_count: int
    _reset_next_step: bool

    @overridable
    def _ours(self) -> _Additions:
        # On first use, because programs subclass this class without calling `__init__`. From then
        # on it is an attribute of the instance.
        new = vars(self)["_ours"] = _Additions()
        return new

    def __init__(
        self,
        physics: Physics,
        task: Task,
        time_limit: float = float("inf"),
        control_timestep: float | None = None,
        n_sub_steps: int | None = None,
        flat_observation: bool = False,
        legacy_step: bool = True,
        randomize: Mapping[str, Draw] | None = None,
        pixels: PixelOptions | Pixels | None = None,
        action_repeat: int = 1,
        faults: str | Mapping[str, object] | Faults | None = None,
        appearance: AppearanceOptions | str | Appearance | None = None,
    ) -> None:
        """Creates an environment whose first `step` or `reset` begins an episode.

        Args:
          physics: a `Physics`.
          task: a `Task`.
          time_limit: length of an episode, seconds; infinite by default.
          control_timestep: time between two actions, seconds, a multiple of the physics' time
            step.
          n_sub_steps: instead of `control_timestep`, the number of physics steps per action; 1
            if neither is given.
          flat_observation: join the observation into one array, under 'observations'.
          legacy_step: see `Physics.legacy_step`.
          randomize: model fields to draw for each episode, by name; see
            `limberjack.rl.randomize`.
          pixels: pictures to observe in addition, under 'pixels', or instead, such as
            {'camera': 0, 'frame_stack': 3}; see `limberjack.rl.pixels`.
          action_repeat: control steps per action; see `step`.
          faults: of the real world, such as 'easy' or {'delay': {'actions': 3}}; see
            `limberjack.worlds.faults`.
          appearance: other colours, cameras and backgrounds for all pictures, such as
            {'background': 'noise', 'colors': 'hard'}, or a preset such as 'color_hard'; see
            `limberjack.worlds.appearance`.

        Raises:
          ValueError: both `control_timestep` and `n_sub_steps` are given, or one of the numbers
            is NaN, zero, negative or not a multiple; or there is no such camera; or `randomize`
            names a field that the task draws itself for each seed; or there are no such faults or
            no such appearance.
          TypeError: `pixels`, `faults` or `appearance` have an unknown option.
        """
        ours = self._ours
        if n_sub_steps is not None and control_timestep is not None:
            raise ValueError(
                f"Both n_sub_steps ({n_sub_steps}) and control_timestep ({control_timestep}) were "
                "supplied: give one; tasks of the suite set control_timestep themselves."
            )
        if not isinstance(time_limit, numbers.Real) or not time_limit > 0:  # also NaN
            raise ValueError(f"time_limit is {time_limit!r}; expected a positive number of seconds")
        self._task, self._physics = task, physics
        self._flat_observation = flat_observation
        if n_sub_steps is not None:
            self._n_sub_steps = at_least_one("n_sub_steps", n_sub_steps)
        elif control_timestep is not None:
            self._n_sub_steps = compute_n_steps(control_timestep, physics.timestep())
        else:
            self._n_sub_steps = 1
        self._step_limit = math.inf
        if time_limit != float("inf"):
            self._step_limit = time_limit / (physics.timestep() * self._n_sub_steps)
        physics.legacy_step = legacy_step
        set_action_repeat(self, action_repeat)
        self._step_count = 0
        self._reset_next_step = True
        if randomize:
            ours.randomizer = Randomizer(randomize, self.__simulated)
            check_not_randomized(task, ours.randomizer.fields)
            self.__simulated.recompute_constants_of(ours.randomizer.fields)
        ours.frames = Frames.of(pixels, self.__simulated)
        if faults is not None:
            ours.faults = self.__with_faults(Faults.of(faults))
        if appearance is not None:
            ours.looks = Looks.for_physics(appearance, physics, 1, self.control_timestep())

    def __with_faults(self, settings: Faults) -> FaultMemory:
        # An observation is computed only for its form: the task must not remember it.
        ours = self._ours
        with stand_in(self._task, self._physics):
            observation = self._task.get_observation(self._physics)
        perturber = None
        if settings.perturbation is not None:
            parameters = getattr(self._task, "PERTURBATIONS", {})
            task, recompiler = type(self._task).__name__, self.__simulated.recompiler
            perturber = Perturber.of(settings.perturbation, parameters, task, recompiler)
            resolved = None if perturber is None else perturber.perturbation
            settings = dataclasses.replace(settings, perturbation=resolved)
        faults = FaultMemory(settings, self.action_spec(), observation, perturber=perturber)
        if ours.randomizer is not None:
            twice = sorted({*faults.fields} & {*ours.randomizer.fields})
            if twice:
                raise ValueError(f"randomize and the perturbation both set {', '.join(twice)}")
        return faults

    def reset(self) -> dm_env.TimeStep:
        """Begins an episode and returns its first `TimeStep`."""
        with self._ours.use:
            return self.__begin()

    def __begin(self) -> dm_env.TimeStep:
        ours = self._ours
        self.__check_open()
        # True until the start is complete: an interrupted start must not be stepped.
        self._reset_next_step = True
        self.__keep_first()
        if ours.randomizer is not None:
            ours.randomization = ours.randomizer.draw(self.__draw_stream())
            self.__simulated.simulation.set_fields(ours.randomization)
        if ours.faults is not None:
            self.__simulated.simulation.set_fields(ours.faults.begin(0, stream_of(self._task)))
            ours.randomization = {**ours.randomization, **ours.faults.drawn(0)}
        if ours.looks is not None:
            ours.looks.begin(0, stream_of(self._task))
            self.__put_on()
        with self._physics.reset_context():
            self._task.initialize_episode(self._physics)
            self.__keep_own()
            if ours.randomizer is not None:  # the start may have set fields too
                self.__simulated.simulation.set_constants()
        if ours.frames is not None:
            ours.frames.forget()
        observation = self.__observe()
        self.__keep_own()
        self._step_count = 0
        self._reset_next_step = False
        return dm_env.TimeStep(dm_env.StepType.FIRST, None, None, observation)

    def step(self, action: Nested) -> dm_env.TimeStep:
        """Applies the action for one control step and returns the resulting `TimeStep`.

        Before the first step and after the last step of an episode, it ignores the action and
        begins the next episode.

        With an `action_repeat` of k it makes k control steps with the action, or fewer if the
        episode ends, calling every hook of the task at each. It returns the sum of their rewards,
        and the rest of the last one; `reward_terms` are summed too. Pictures are taken once.

        Raises:
          ValueError, TypeError: the action is not made of finite numbers, or the task rejects it,
            as `base.Task` does for another shape than (nu,); nothing was stepped.
          PhysicsError: the simulation diverged; the next step begins a new episode.
        """
        use, thread = self._ours.use, get_ident()
        if use.enter(thread) != thread:  # inlined `with use`, which takes 1 % of the step
            use.refuse(thread)
        try:
            if self._reset_next_step:
                return self.reset()  # a subclass may define another one, as in dm_control
            action = self.__checked(action)
            number = 0
            while True:
                self._begin_control_step(action, number)
                self._physics.step(self._n_sub_steps)
                time_step = self._end_control_step(number)
                if time_step is not None:
                    return time_step
                number += 1
        finally:
            use.leave()

    # A control step in parts, between which the physics is stepped; see `limberjack.rl.row_step`.

    @property
    def _steps_in_parts(self) -> bool:
        """Whether `step` may be replaced by its parts, and that of the physics by its own."""
        if self._ours.frames is not None or "step" in vars(self):
            return False
        return getattr(self._physics, "can_step_in_parts", False)

    def _begin_control_step(self, action: object, number: int) -> None:
        """Begins a control step of an action, by its number: 0, or more if actions are repeated."""
        ours = self._ours
        task, faults = self._task, ours.faults
        if faults is not None:
            action = faults.act(getattr(action, "continuous_actions", action))
        task.before_step(action, self._physics)
        if faults is not None:
            faults.accept()
        if getattr(task, EPISODE_ATTRIBUTES, None):
            self.__keep_own()
        if ours.action_repeat != 1 and number == 0:  # the action was not refused
            ours.reward_so_far, ours.reward_terms = _NO_REWARD, {}
        self._reset_next_step = True  # until the step is complete

    def _end_control_step(self, number: int) -> dm_env.TimeStep | None:
        """Ends a control step; returns the action's time step after its last one, else None.

        Rewards and their terms are summed over the steps of a repeated action.
        """
        ours = self._ours
        physics, task = self._physics, self._task
        task.after_step(physics)
        reward, terms = reward_and_terms(task, physics)
        if type(reward) is np.ndarray:  # such as `qvel[..., 0]`, a view of live memory
            reward = reward.copy()
        if ours.faults is not None:
            reward = ours.faults.reward(reward)
        ours.last_terms = terms
        if ours.action_repeat == 1:
            ours.reward_terms = terms
        else:
            reward = ours.reward_so_far = ours.reward_so_far + reward
            sums = ours.reward_terms
            ours.reward_terms = {name: sums.get(name, 0.0) + value for name, value in terms.items()}
        observation = task.get_observation(physics)
        if ours.faults is not None:
            observation = ours.faults.observe(observation)
        self._step_count += 1
        at_limit = self._step_count >= self._step_limit
        ending = 1.0 if at_limit else task.get_termination(physics)
        if getattr(task, EPISODE_ATTRIBUTES, None):
            self.__keep_own()
        # None or NaN: the episode continues.
        is_last = ending is not None and not np.all(ending != ending)
        if not is_last and number + 1 < ours.action_repeat:
            return None
        if self._flat_observation or ours.frames is not None:
            observation = self.__in_form(observation)
        if is_last:
            check_ending(task, ending)
            return dm_env.TimeStep(_LAST, reward, ending, observation)
        self._reset_next_step = False
        return dm_env.TimeStep(_MID, reward, 1.0, observation)

    def action_spec(self) -> Nested:
        """Spec of valid actions."""
        return self._task.action_spec(self._physics)

    def step_spec(self) -> object:
        """Spec of the result of `step`, if the task defines one."""
        return self._task.step_spec(self._physics)

    def observation_spec(self) -> Nested:
        """The task's observation spec, or else one derived from a current observation."""
        ours = self._ours
        try:
            spec = self._task.observation_spec(self._physics)
            if ours.faults is not None:
                spec = ours.faults.specs_with(spec)
        except NotImplementedError:
            # An observation is computed only for its form: the task must not remember it.
            with stand_in(self._task, self._physics):
                spec = specs_of(self.__seen())
        return spec if ours.frames is None else ours.frames.spec_with(spec)

    @property
    def physics(self) -> Any:  # of the domain's own class
        """The environment's physics."""
        return self._physics

    @property
    def task(self) -> Any:  # of the domain's own class
        """The environment's task."""
        return self._task

    @overridable
    def reward_terms(self) -> dict[str, Quantity]:
        """Terms of the last step's reward, by name."""
        return self._ours.reward_terms

    @overridable
    def randomization(self) -> dict[str, np.ndarray]:
        """Values drawn for this episode, by field."""
        return self._ours.randomization

    @overridable
    def registration(self) -> object:
        """The suite's record of the domain; None unless `suite.load` made the environment."""
        return self._ours.registration

    @overridable
    def pixels(self) -> Pixels | None:
        """Options of the pixel observations; None without them."""
        ours = self._ours
        return None if ours.frames is None else ours.frames.pixels

    @overridable
    def world(self) -> World | None:
        """The settings by which the world differs from the task's own; None if it does not.

        They are values of JSON, and accepted as keywords of an environment again.
        """
        ours = self._ours
        world: dict[str, object] = {}
        if ours.faults is not None:
            world["faults"] = ours.faults.settings.as_json()
        if ours.looks is not None:
            world["appearance"] = ours.looks.as_json()
        return world or None

    def draw_every(self, steps: int) -> None:
        """Takes a picture at a start and at each `steps`-th step; others repeat the last picture.

        It is for a loop that repeats an action by itself and wants one stacked picture per action.
        Snapshots do not contain the interval.
        """
        ours = self._ours
        if ours.frames is not None:
            ours.frames.interval = at_least_one("steps", steps)

    def control_timestep(self) -> float:
        """Time between two actions, seconds."""
        return self._physics.timestep() * self._n_sub_steps

    @property
    def action_repeat(self) -> int:
        """Control steps per action, at least 1; or what a subclass has assigned to this name."""
        return vars(self).get("action_repeat", self._ours.action_repeat)

    @action_repeat.setter
    def action_repeat(self, repeat: int) -> None:
        if type(self) is Environment:
            set_action_repeat(self, repeat)
        else:  # a subclass for dm_control, which may repeat actions by itself
            vars(self)["action_repeat"] = repeat

    @overridable
    def is_running(self) -> bool:
        """Whether the next step continues an episode; otherwise it begins one."""
        return not self._reset_next_step

    @overridable
    def timed_out(self) -> bool:
        """Whether the last step reached the time limit."""
        return self._reset_next_step and self._step_count >= self._step_limit

    @overridable
    def success(self) -> bool | None:
        """Whether the last step reached the goal; None for a task without a goal."""
        success = success_of(self._task, self._ours.last_terms)
        return None if success is None else bool(success)

    @overridable
    def step_limit(self) -> int | None:
        """Steps per episode; None without a limit."""
        return math.ceil(self._step_limit) if math.isfinite(self._step_limit) else None

    def reseed(self, seed: int) -> None:
        """Makes the next episode the first one of an environment with `random=seed`.

        The task's EPISODE_ATTRIBUTES and EPISODE_FIELDS get the values from before the first
        episode.
        """
        ours = self._ours
        for name, value in self._first_values().items():
            setattr(self._task, name, value)
        if ours.first_fields:
            self.__simulated.simulation.set_fields(ours.first_fields)
        if ours.faults is not None:
            ours.faults.begin_again(0)
        stream = np.random.RandomState(seed)
        set_stream_fields(self._task, stream, self.__simulated.simulation)
        before = getattr(self._task, "_random", None)
        if isinstance(before, np.random.RandomState) and _is_kept_elsewhere(self._task, before):
            before.set_state(stream.get_state(legacy=False))  # so that its other users go on
            stream = before
        self._task._random, ours.seeded = stream, (stream, seed)

    def keep_as_first(self, name: str) -> None:
        """Makes `reseed` put back the present value of one of the task's EPISODE_ATTRIBUTES."""
        ours = self._ours
        if ours.first is not None and name in ours.first:
            ours.first = {**ours.first, name: copy.deepcopy(getattr(self._task, name))}

    def __keep_own(self) -> None:
        keep_own(self._task, getattr(self._task, EPISODE_ATTRIBUTES, ()), self._ours.first or {})

    def __keep_first(self) -> None:
        ours = self._ours
        if ours.first is None:
            ours.first, ours.first_fields = self._first_values(), self._first_fields()

    def _first_fields(self) -> Mapping[str, np.ndarray]:
        """Copies of the task's EPISODE_FIELDS from before the first episode.

        None of the suite's own tasks: each of their starts sets all that they declare.
        """
        ours = self._ours
        if ours.first is not None or is_of_the_suite(self._task, self._physics):
            return ours.first_fields
        found = {}
        for name in getattr(self._task, "EPISODE_FIELDS", ()):
            with contextlib.suppress(AttributeError):  # an unknown one: see `check_episode_fields`
                found[name] = np.array(operator.attrgetter(name)(self.__simulated.model))
        return found

    def _first_values(self) -> dict[str, object]:
        """Copies of the task's EPISODE_ATTRIBUTES from before the first episode."""
        ours = self._ours
        return copy.deepcopy(values_of(self._task) if ours.first is None else dict(ours.first))

    def snapshot(self) -> Snapshot:
        """Everything that the environment's future depends on; see `limberjack.rl.snapshot`.

        Raises:
          TypeError: the task, or an environment with methods or attributes of its own, keeps
            something that cannot be copied.
        """
        ours = self._ours
        self.__check_open()
        if difference(self) is not None:
            check_copies(self, are_seeded=False)
            return Snapshot.of_copy(copied(self), ours.registration, ours.name)
        with ours.use:
            streams = [stream_of(self._task).get_state()]
            if ours.randomizer is not None:
                streams.append(self.__draw_stream().get_state())
            memory = remembered(self._task, self._physics)
            return Snapshot(
                self._origin(),
                self.__simulated.simulation.save(None, self._saved_fields()),
                np.array([self._step_count]),
                np.array([self._reset_next_step]),
                [tuple(streams)],
                saved_pictures(ours.frames, ours.looks, None),
                ours.registration,
                ours.name,
                [memory] if memory else [],
                faults={} if ours.faults is None else ours.faults.save(None),
            )

    def restore(self, snapshot: Snapshot) -> None:
        """Continues from a snapshot, bit for bit.

        An environment with methods or attributes of its own becomes the saved one, with another
        `physics` and `task`.

        Raises:
          ValueError, TypeError: it is not a snapshot of one environment of this task, model and
            version, is damaged, or is at or beyond the time limit; nothing was restored.
          PhysicsError: its state has diverged; the next step begins an episode.
        """
        ours = self._ours
        self.__check_open()
        self.__keep_first()
        is_copy = bool(as_snapshot(snapshot).copies) or difference(self) is not None
        own = Snapshot.of_copy(self) if is_copy else self.snapshot()
        snapshot.check_all(own, 1, math.inf if is_copy else self._step_limit)
        if is_copy:
            kept = copied(snapshot.copies[0])
            with ours.use:
                vars(self).clear()
                vars(self).update(vars(kept))
                if snapshot.resets.any():
                    self._reset_next_step = True
            return
        with ours.use:
            self._reset_next_step = True  # until it is complete
            self.__simulated.simulation.load(snapshot.physics)
            stream_of(self._task).set_state(snapshot.streams[0][0])
            ours.seeded = (None, None)
            if ours.randomizer is not None:
                self.__draw_stream().set_state(snapshot.streams[0][1])
                saved = snapshot.physics
                ours.randomization = {name: saved[name][0] for name in ours.randomizer.fields}
            if ours.frames is not None:
                ours.frames.load(snapshot.frames, None)
            if ours.looks is not None:
                ours.looks.load(snapshot.frames, None, [stream_of(self._task)])
                self.__put_on()
            if snapshot.memory:
                put_back(snapshot.memory[0], self._task, self._physics)
            if ours.faults is not None:
                ours.faults.load(snapshot.faults, None)
                ours.randomization = {**ours.randomization, **ours.faults.drawn(0)}
            self._step_count = int(snapshot.step_count[0])
            self._reset_next_step = bool(snapshot.begins[0])

    def set_state(self, state: Mapping[str, npt.ArrayLike] | Snapshot) -> dm_env.TimeStep:
        """Continues the episode that `reset` has just begun from a given state.

        Everything else that was drawn for the start, such as targets, remains. All quantities are
        recomputed with actuation disabled, as at any start, and the task observes once more. A
        subclass that changes the observations of `reset` must change those of this method too.

        Args:
          state: some of 'qpos' (nq,), 'qvel' (nv,) and 'act' (na,); or a snapshot, which is
            restored with its step count, see `restore`.

        Returns:
          The first `TimeStep` of the episode; for a snapshot of a later step a middle one, with
          reward 0.

        Raises:
          ValueError, TypeError: the state is invalid, see `limberjack.rl.given_state`, or the
            snapshot does not fit; nothing was set.
          RuntimeError: a mapping is given, and `reset` was not the last call.
          PhysicsError: the state diverges at once; the next step begins an episode.
        """
        ours = self._ours
        if isinstance(state, Snapshot):
            self.restore(state)
            observation = self.present_observation()
            if self._step_count:
                return dm_env.TimeStep(dm_env.StepType.MID, 0.0, 1.0, observation)
            return dm_env.TimeStep(dm_env.StepType.FIRST, None, None, observation)
        self.__check_open()
        checked = checked_state(state, state_sizes(self._physics))
        with ours.use:
            if self._reset_next_step or self._step_count:
                raise RuntimeError("no episode has just begun: call reset() before set_state()")
            self._reset_next_step = True  # until it is complete
            for name, values in checked.items():
                getattr(self.__simulated.data, name)[...] = values
            self._physics.after_reset()
            if ours.frames is not None:
                ours.frames.forget()
            if ours.faults is not None:
                ours.faults.forget(0)
            observation = self.__observe()
            self.__keep_own()
            self._reset_next_step = False
        return dm_env.TimeStep(dm_env.StepType.FIRST, None, None, observation)

    def present_observation(self) -> Mapping[str, Quantity]:
        """The observation of the present state, computed again without a trace in the task.

        With faults, it is the last one that was received.
        """
        ours = self._ours
        with stand_in(self._task, self._physics):
            observation = self.__seen()
        if ours.frames is None:
            return observation
        return ours.frames.observe(self.__simulated, observation, is_step=False)

    def description(self) -> Description:
        """The parts of the `repr`, also of an environment that is only half made."""
        ours = self._ours
        task = getattr(self, "_task", None)
        stream, seed = ours.seeded
        is_first = stream is not None and stream is getattr(task, "random", None)
        step = getattr(self, "_step_count", 0)
        begun = step or not getattr(self, "_reset_next_step", True)
        name, limit = ours.name or type(task).__name__, getattr(self, "_step_limit", math.inf)
        return Description(name, None, [seed if is_first else None], [step] if begun else [], limit)

    def __repr__(self) -> str:
        return represented(self, self.description())

    def __copy__(self) -> Self:
        """Another environment of the same physics and task, as in dm_control."""
        new = type(self).__new__(type(self))
        vars(new).update(vars(self))
        vars(new)["_ours"] = dataclasses.replace(self._ours, use=OneUser("environment"))
        return new

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        exact_copies(self, memo)
        new = type(self).__new__(type(self))
        memo[id(self)] = new
        vars(new).update(copy.deepcopy(vars(self), memo))
        new.__put_on()
        return new

    def __getstate__(self) -> dict[str, object]:
        """State for an equal environment with the same current quantities."""
        kept = dict(vars(self))
        if self._ours.is_closed or not hasattr(kept.get("_physics"), "become"):
            return kept
        # Unlike dm_control's copy of a physics, this keeps the solver's warm start. Any: `become`
        # says that it has a state, which `Physics` does not declare.
        physics = cast(Any, kept.pop("_physics"))
        return {**kept, "exact": (type(physics), physics.__getstate__())}

    def __setstate__(self, state: dict[str, object]) -> None:
        exact = state.pop("exact", None)
        vars(self).update(state)
        if isinstance(exact, tuple):
            kind, described = exact
            physics = kind.__new__(kind)
            physics.become(described)
            self._physics = physics
        self.__put_on()

    def _origin(self) -> dict[str, object]:
        ours = self._ours
        pixels = {} if ours.frames is None else ours.frames.origin()
        return origin_of(
            self._task, self.__simulated, self._saved_fields(), pixels, Environment.world.of(self)
        )

    def __put_on(self) -> None:
        """Shows the look of the present episode in all pictures of the physics."""
        ours = self._ours
        if ours.looks is not None and not ours.is_closed:
            self.__simulated.simulation.look = ours.looks.of(0)

    @property
    def __simulated(self) -> SimulatedPhysics:
        """The physics, typed with the larger interface that snapshots and randomisation need."""
        return cast(SimulatedPhysics, self._physics)

    def _saved_fields(self) -> tuple[str, ...]:
        """Model fields set per episode."""
        ours = self._ours
        randomized = ours.randomizer.fields if ours.randomizer is not None else ()
        perturbed = ours.faults.fields if ours.faults is not None else ()
        own = getattr(self._task, "EPISODE_FIELDS", ())
        return (*own, *randomized, *(name for name in perturbed if name not in own))

    def __draw_stream(self) -> np.random.RandomState:
        """The stream from which model fields are drawn; replaced when the task's stream is."""
        ours = self._ours
        random = stream_of(self._task)
        if ours.draws is None or ours.draws[0] is not random:
            ours.draws = random, stream_beside(random)
        return ours.draws[1]

    def close(self) -> None:
        """Frees the environment, which then raises if stepped; may be called repeatedly."""
        ours = self._ours
        if not ours.is_closed:
            ours.is_closed = True
            self._reset_next_step = True
            getattr(self._physics, "free", lambda: None)()

    def __check_open(self) -> None:
        if self._ours.is_closed:
            raise RuntimeError("this environment is closed: load or construct a new one")

    def __observe(self) -> Mapping[str, Quantity]:
        """The current observation, with a new picture if pixels are observed."""
        ours = self._ours
        observation = self._task.get_observation(self._physics)
        if ours.faults is not None:
            observation = ours.faults.observe(observation)
        return self.__in_form(observation)

    def __in_form(self, state: Mapping[str, Quantity]) -> Mapping[str, Quantity]:
        """The task's observation, flat if wanted, and with a new picture."""
        ours = self._ours
        observation = flatten_observation(state) if self._flat_observation else state
        if ours.frames is None:
            return observation
        return ours.frames.observe(self.__simulated, observation)

    def _flat_layout(self) -> list[tuple[str, tuple[int, ...]]]:
        """Names and shapes of the parts of a flat observation, in its order."""
        with stand_in(self._task, self._physics):
            observation = self.__named()
        return [(name, np.shape(observation[name])) for name in flat_order(observation)]

    def __seen(self) -> Mapping[str, Quantity]:
        """The task's observation, flat if wanted, without pictures."""
        observation = self.__named()
        return flatten_observation(observation) if self._flat_observation else observation

    def __named(self) -> Mapping[str, Quantity]:
        """The task's observation by name, without pictures."""
        observation = self._task.get_observation(self._physics)
        return observation if (faults := self._ours.faults) is None else faults.shown(observation)

    def __checked(self, action: object) -> object:
        """The action, as an array if it is a list; raises unless it is made of finite numbers.

        The task checks its shape, and everything if the spec is a nested structure.
        """
        # Not a wider type, whose finite values may be infinite as controls.
        if type(action) is np.ndarray and action.dtype.char in "df":
            # Runs at every step; searching the bytes is the fastest check.
            if b"\0" in np.isfinite(action).tobytes():
                action_specs.check_finite(action)
            return action
        try:
            given = action_specs.as_numbers(getattr(action, "continuous_actions", action))
        except (TypeError, ValueError):
            if isinstance(self._task.action_spec(self._physics), specs.Array):
                raise
            return action
        action_specs.check_finite(given)
        is_list = type(action) in (list, tuple)
        if is_list and isinstance(self._task.action_spec(self._physics), specs.Array):
            return given
        return action


def set_action_repeat(env: Environment, repeat: int) -> None:
    """Sets the control steps per action, of any subclass."""
    env._ours.action_repeat = at_least_one("action_repeat", repeat)


def shown_by(env: object, name: str, default: object = None) -> Any:  # of the property's type
    """The property `name` of an `Environment`, whatever a subclass or its user calls so.

    Of any other object, such as a wrapper, it is the attribute of that name, or else `default`.
    """
    if isinstance(env, Environment):
        return getattr(Environment, name).of(env)
    return getattr(env, name, default)


set_plain(Environment, frozenset(Environment.__annotations__) | {"_ours"})


def _is_kept_elsewhere(task: object, stream: np.random.RandomState) -> bool:
    """Whether a task keeps its random stream in another attribute as well, such as in a noise."""
    if type(task).__module__.startswith("limberjack.suite."):
        return False
    kept = ((name, one) for name, one in attributes_of(task).items() if name != "_random")
    return any(one is stream or reaches(one, {id(stream)}) for _, one in kept)


def compute_n_steps(
    control_timestep: float, physics_timestep: float, tolerance: float = 1e-8
) -> int:
    """Number of physics steps in one control step.

    Args:
      control_timestep: time between two actions, seconds.
      physics_timestep: the simulation's time step, seconds.
      tolerance: maximum deviation of their ratio from an integer.

    Raises:
      TypeError: the control step is no number.
      ValueError: the control step is shorter than the physics step, or not a multiple of it.
    """
    if not isinstance(control_timestep, numbers.Real):
        raise TypeError(f"control_timestep is {control_timestep!r}; expected a number of seconds")
    if not control_timestep >= physics_timestep:  # also NaN
        raise ValueError(
            f"Control timestep ({control_timestep}) cannot be smaller than physics timestep "
            f"({physics_timestep})."
        )
    ratio = control_timestep / physics_timestep
    if not math.isfinite(ratio) or abs(ratio - round(ratio)) > tolerance:
        raise ValueError(
            f"Control timestep ({control_timestep}) must be an integer multiple of physics "
            f"timestep ({physics_timestep})"
        )
    return round(ratio)
