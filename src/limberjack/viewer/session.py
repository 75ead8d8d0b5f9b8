"""`Session`: a viewed environment and the policies that may act, without the viewer that shows it.

    session = Session(environment, seed=0)
    while someone_watches():
        session.advance()  # takes the control steps that have become due
        show(session.status())

Steps, episodes and rewards are those of `environment.step` in a loop: pausing and speed decide when
a step is taken, not its result. Pushing applies forces to bodies of the simulation, and changes
nothing else. One thread uses a session; it opens no window and knows nothing of MuJoCo Studio.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import dm_env
import mujoco
import numpy as np
from dm_env import specs

from limberjack.policies import PolicyError
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.control import Environment, PhysicsError, shown_by
from limberjack.rl.memory import stand_in
from limberjack.suite.base import kind_of_start
from limberjack.utils.log import log
from limberjack.utils.seeds import SEEDS, checked_seed
from limberjack.viewer.shown import AUTO, Shown, Viewed

__all__ = [
    "NO_POLICY",
    "TERMINAL",
    "Act",
    "Actuator",
    "Begin",
    "Plan",
    "Session",
    "Status",
    "ViewerError",
    "idle",
]

NO_POLICY = "none"  # name of `idle`, whose action a person may set
TERMINAL = "terminal"  # the entry of a plan's terms that has no weight

Act = Callable[[dm_env.TimeStep], object]  # to an action, which the environment checks
# Begins an episode: takes the environment, which has been reset, and the episode's seed, or its
# number where the environment is not seeded.
Begin = Callable[[Environment, int], Act]

_LONGEST_DEBT = 0.1  # seconds; time lost beyond this, as in a slow policy, is not caught up
_LONGEST_CALL = 1 / 30  # seconds; after this long `advance` lets the viewer show what there is
_MOST_STARTS = 1000  # that are tried for one of a wanted kind; the rarest has a share of 5 %


class ViewerError(RuntimeError):
    """The viewer cannot start on this machine."""


class Plan(NamedTuple):
    """The best plan of a planning step, as the planner explains it."""

    stage: str  # name of the cost's stage; empty if it has none
    terms: Mapping[str, float]  # the weighted terms of the plan's cost
    weights: Mapping[str, float] = {}  # of the terms that have another weight than 1


class Actuator(NamedTuple):
    """An element of an action, as a person sets it."""

    name: str
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Status:
    """The running episode in numbers and words, for a viewer's panel."""

    episode: int  # the first is 1
    seed: int | None  # of the episode; None where the environment is not seeded
    start: str | None  # the kind of start, where the task has kinds
    step: int
    step_limit: int | None
    time: float  # seconds since the start
    reward: float | None  # of the last step; None at the start
    total: float  # the return so far
    terms: Mapping[str, float]  # of the reward, by name
    success: bool | None  # whether the goal is reached now, where the task has one
    paused: bool
    speed: float
    note: str  # an event that the person watching should know of, such as a diverged simulation
    policy: str = NO_POLICY  # the name of the one that acts
    action: tuple[float, ...] = ()  # that a person has set, where no policy acts
    plan: Plan | None = None  # the last one, where plans are shown
    quality: str = AUTO  # that was asked for


def idle(environment: Environment, seed: int) -> Act:
    """Acts with the middle of the actions' bounds; infinite ones are replaced, as for sliders.

    Raises:
      PolicyError: actions are not one bounded array.
    """
    spec = environment.action_spec()
    if not isinstance(spec, specs.BoundedArray):
        raise PolicyError(
            f"the policy {NO_POLICY!r} needs actions in one bounded array, and action_spec is "
            f"{spec!r}: give a policy"
        )
    low, high = bounds_to_try(spec)
    action = np.clip(0.5 * (low + high), spec.minimum, spec.maximum).astype(spec.dtype)
    return lambda time_step: action.copy()


class Session:
    """An environment with a clock and a policy; see the module's docstring."""

    def __init__(
        self,
        environment: Viewed,
        policies: Mapping[str, Begin] = MappingProxyType({NO_POLICY: idle}),
        seed: int | None = None,
        speed: float = 1.0,
        clock: Callable[[], float] = time.perf_counter,
        plan: Callable[[], Plan | None] = lambda: None,
        quality: str = AUTO,
    ) -> None:
        """Begins the first episode.

        Args:
          environment: a `control.Environment`, or a wrapper of one that has its attributes.
          policies: by name, what begins their episodes; the first acts until another one is chosen.
          seed: of the first episode; the next has seed + 1. None continues the environment's random
            stream from episode to episode.
          speed: simulated seconds per second.
          clock: returns the time in seconds.
          plan: returns the policy's last plan in this episode.
          quality: of what `shown` copies; see `Shown`.

        Raises:
          TypeError: the environment has no MuJoCo simulation to show.
          ValueError: the seed or the speed is out of range, the environment takes no seed, or the
            quality is unknown.
          TypeError: the seed is not a whole number.
        """
        self._environment = environment
        self._task = getattr(environment, "task", None)
        _ = self.data  # before anything happens
        if seed is not None:
            seed = checked_seed(seed)
        if seed is not None and not hasattr(environment, "reseed"):
            raise ValueError(
                f"{type(environment).__name__} has no method reseed; pass the seed to its "
                "constructor, and none here"
            )
        self._policies = dict(policies)
        self._policy = next(iter(self._policies))
        self._action: np.ndarray | None = None  # that a person has set
        self._seed = seed
        self._clock = clock
        self._plan = plan
        self._plan_before: Plan | None = None  # of a policy that acted before
        self._last_look = clock()
        self._due = 0.0  # simulated seconds that have not been stepped
        self._paused = False
        self._push = np.zeros((0, 6))
        self._pushed = np.zeros(0, bool)  # bodies that were pushed in the last step
        self.set_speed(speed)
        self._episodes = 0
        self._ending = ""  # why the episode ended early
        self.shown = Shown(environment, quality)  # what a viewer draws
        self._begin_episode()

    # Called for the person at the viewer.

    def advance(self) -> bool:
        """Takes the control steps that have become due; returns whether there was any.

        Raises:
          Exception: any error of the policy, the task or the environment, except that of a
            diverged simulation, which ends the episode.
        """
        now = self._clock()
        elapsed, self._last_look = now - self._last_look, now
        if self._paused:
            return False
        self._due += min(elapsed, _LONGEST_DEBT) * self._speed
        interval = self._interval
        stepped = False
        # A step that is early by a rounding error is due, too.
        while self._due >= interval * (1 - 1e-9):
            self._due -= interval
            self.step()
            stepped = True
            if self._clock() - now > _LONGEST_CALL:
                self._due = 0.0
        return stepped

    def step(self) -> None:
        """Takes an action's steps, paused or not; after an episode's last ones, begins the next."""
        if self._is_over:
            self._begin_episode()
            return
        action = self._chosen_action()
        self._apply_push()
        try:
            self._time_step = self._environment.step(action)
        except PhysicsError as error:
            log.warning("%s", error)
            self._ending = f"episode {self._episodes} ended early: {error}"
            self._is_over = True
            return
        self._steps += 1
        self._reward = float(self._time_step.reward or 0.0)
        self._total += self._reward
        self._is_over = self._time_step.last()

    def reset(self) -> None:
        """Begins the next episode now, with a new seed."""
        self._begin_episode()

    def begin(self, seed: int) -> None:
        """Begins the episode of a seed now; the next ones have those after it.

        Raises:
          ValueError: the seed is out of range, or this session has no seeds.
        """
        seed = checked_seed(seed)
        if self._seed is None:
            raise ValueError("the session continues a random stream; it has no seeds to choose")
        self._seed = seed - self._episodes
        self._begin_episode()

    def begin_kind(self, kind: str) -> None:
        """Begins the next episode now, with the next start of a kind.

        Raises:
          ValueError: the task has no such kind, or none was found; an episode has begun anyway.
        """
        if kind not in self.kinds:
            raise ValueError(f"no kind of start is {kind!r}; expected one of {self.kinds}")
        self._begin_start()
        for _ in range(_MOST_STARTS - 1):
            if self._start == kind:
                break
            self._episodes -= 1
            if self._seed is not None:
                self._seed += 1
            self._begin_start()
        self._complete_start()
        if self._start != kind:
            raise ValueError(f"none of {_MOST_STARTS} starts was of the kind {kind!r}")

    def choose(self, policy: str) -> None:
        """Lets another policy act from this state on, and begin the next episodes.

        The one before goes on if a policy cannot begin here; a PolicyError is in the status.

        Raises:
          ValueError: none of `policies` has that name.
          Exception: any error of the policy but a PolicyError.
        """
        if policy not in self._policies:
            raise ValueError(f"no policy is {policy!r}; expected one of {self.policies}")
        before, self._policy = self._policy, policy
        try:
            self._begin_policy()
            self._plan_before = self._plan()
        except Exception as error:
            self._policy = before
            if not isinstance(error, PolicyError):
                raise
            self._note = str(error)

    def set_action(self, action: np.ndarray) -> None:
        """Acts with this action, rounded where actions are whole, where no policy does.

        Raises:
          ValueError: it has another shape than the actions, or is not finite.
        """
        action = np.array(action, float)
        spec = self._environment.action_spec()
        if action.shape != spec.shape or not np.isfinite(action).all():
            raise ValueError(f"action is {action.tolist()}; expected finite numbers, {spec.shape}")
        is_whole = spec.dtype.kind in "iu"
        self._action = (np.rint(action) if is_whole else action).astype(spec.dtype)

    def pause(self, paused: bool = True) -> None:
        """Stops the clock, or continues it."""
        self._paused = bool(paused)
        self._due = 0.0

    def set_speed(self, speed: float) -> None:
        """Sets how many simulated seconds pass in a second.

        Raises:
          ValueError: it is not positive, or not finite.
        """
        if not (math.isfinite(speed) and speed > 0):
            raise ValueError(f"speed is {speed}; expected a positive number, such as 1 or 0.5")
        self._speed = float(speed)

    def push(self, forces: np.ndarray) -> None:
        """Pushes bodies from now on, until the next call.

        Args:
          forces: (nbody, 6), force and torque at each body's centre of mass, N and N m. Bodies
            with zeros are left alone.

        Raises:
          ValueError: it has another shape, or is not finite; nothing changes.
        """
        forces = np.array(forces, float)
        expected = self.data.xfrc_applied.shape
        if forces.shape != expected:
            raise ValueError(f"forces have shape {forces.shape}; expected {expected}, (nbody, 6)")
        if not np.isfinite(forces).all():
            raise ValueError("forces have infinities or NaN; expected finite numbers")
        self._push = forces

    # Shown by the viewer.

    @property
    def policies(self) -> tuple[str, ...]:
        """The names of all policies."""
        return tuple(self._policies)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of starts that the task distinguishes."""
        return tuple(getattr(self._task, "STARTS", ()))

    @property
    def is_seeded(self) -> bool:
        """Whether episodes have seeds."""
        return self._seed is not None

    def actuators(self) -> tuple[Actuator, ...]:
        """The elements of an action; empty where it is no vector."""
        spec = self._environment.action_spec()
        if not isinstance(spec, specs.BoundedArray) or len(spec.shape) != 1:
            return ()
        low, high = bounds_to_try(spec)
        model = self.model
        known = model.nactuator == model.nu == spec.shape[0]  # an actuator may have several
        names = [model.actuator(i).name if known else "" for i in range(spec.shape[0])]
        return tuple(
            Actuator(name or f"action {number}", float(low[number]), float(high[number]))
            for number, name in enumerate(names)
        )

    @property
    def paused(self) -> bool:
        """Whether the clock is stopped."""
        return self._paused

    @property
    def speed(self) -> float:
        """Simulated seconds per second."""
        return self._speed

    @property
    def model(self) -> mujoco.MjModel:
        """The simulation's `mujoco.MjModel`, read-only: other environments may share it."""
        return self._environment.physics.model._official

    @property
    def data(self) -> mujoco.MjData:
        """The `mujoco.MjData` of the simulation.

        Raises:
          TypeError: there is none.
        """
        try:
            data = self._environment.physics.data._data
        except AttributeError:
            data = None
        if not isinstance(data, mujoco.MjData):
            raise TypeError(
                f"{type(self._environment).__name__} has no MuJoCo simulation to show; expected an "
                "environment of limberjack.suite, or a control.Environment with a mujoco.Physics"
            )
        return data

    def status(self) -> Status:
        """The running episode's status now."""
        terms = self._terms()
        is_success = getattr(self._task, "is_success", None)
        goal = getattr(self._task, "GOAL", ())
        limit = shown_by(self._environment, "step_limit")
        return Status(
            episode=self._episodes,
            seed=self._episode_seed,
            start=self._start,
            step=self._steps,
            step_limit=None if limit is None else math.ceil(limit / self._repeat),
            time=self._steps * self._interval,
            reward=self._reward,
            total=self._total,
            terms={name: float(value) for name, value in terms.items()},
            success=bool(is_success(terms)) if terms and goal and is_success else None,
            paused=self._paused,
            speed=self._speed,
            note=self._ending or self._note,
            policy=self._policy,
            action=self._shown_action(),
            plan=None if (plan := self._plan()) is self._plan_before else plan,
            quality=self.shown.quality,
        )

    @property
    def _repeat(self) -> int:
        """Control steps of an action."""
        return getattr(self._environment, "action_repeat", 1)

    @property
    def _interval(self) -> float:
        """Simulated seconds from one action to the next."""
        return self._environment.control_timestep() * self._repeat

    def _terms(self) -> Mapping[str, float]:
        """The terms of the reward in this state, where the task defines them."""
        task, physics = self._task, self._environment.physics
        if task is None or not hasattr(task, "reward_terms"):
            return {}
        try:
            with stand_in(task, physics):  # it may count its calls, or draw
                return task.reward_terms(physics)
        except NotImplementedError:
            return {}

    def _shown_action(self) -> tuple[float, ...]:
        if self._policy != NO_POLICY:
            return ()
        return tuple(float(value) for value in np.ravel(np.asarray(self._chosen_action())))

    def _chosen_action(self) -> object:
        """The policy's action, or that of the person where there is no policy."""
        if self._policy == NO_POLICY and self._action is not None:
            return self._action.copy()
        return self._act(self._time_step)

    # Episodes.

    def _begin_episode(self) -> None:
        """Begins an episode with its start and the policy."""
        self._begin_start()
        self._complete_start()

    def _complete_start(self) -> None:
        self._begin_policy()
        self._is_over = False
        self.shown.note_start()

    def _begin_policy(self) -> None:
        """Begins the policy in this state."""
        seed = self._episodes - 1 if self._episode_seed is None else self._episode_seed
        self._act = self._policies[self._policy](self._environment, seed)

    def _begin_start(self) -> None:
        """Begins an episode without a policy; `_complete_start` must follow."""
        environment = self._environment
        self._is_over = True  # until the start is complete
        self._episode_seed = None
        if self._seed is not None:
            self._episode_seed = (self._seed + self._episodes) % SEEDS
            environment.reseed(self._episode_seed)
        self._episodes += 1
        self._time_step = environment.reset()
        self._start = kind_of_start(environment) if self._task is not None else None
        self._steps = 0
        self._reward: float | None = None
        self._total = 0.0
        self._note, self._ending = self._ending, ""

    def _apply_push(self) -> None:
        """Sets the forces on pushed bodies, and removes them from released ones."""
        now = self._push.any(axis=-1)
        if self._pushed.any():
            self.data.xfrc_applied[self._pushed] = 0.0
        if now.any():
            self.data.xfrc_applied[now] = self._push[now]
        self._pushed = now
