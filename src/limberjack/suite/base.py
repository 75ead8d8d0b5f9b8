"""Base class of all tasks of the suite.

A task of the suite stores its settings and its random stream, but nothing about the current
episode, which lives entirely in the physics. One task therefore works for a single simulation and
for a batch. A task that must remember something declares it in `EPISODE_ATTRIBUTES`.
"""

import functools
import math
from collections.abc import Callable, Mapping
from typing import ClassVar, NamedTuple, TypedDict, TypeVar

import dm_env
import numpy as np
from dm_env import specs

from limberjack import mujoco
from limberjack.rl import control
from limberjack.rl.contract import Nested
from limberjack.rl.copies import control_of
from limberjack.rl.memory import stand_in
from limberjack.rl.pixels import PixelOptions, Pixels
from limberjack.rl.randomize import Draw
from limberjack.rl.reward_terms import reward_of_terms
from limberjack.utils.arrays import Quantity
from limberjack.utils.suggest import did_you_mean
from limberjack.worlds.appearance import Appearance, AppearanceOptions
from limberjack.worlds.faults import Faults, Parameter

__all__ = [
    "Kwargs",
    "Observed",
    "Options",
    "Picture",
    "Seed",
    "StepKwargs",
    "StepOptions",
    "Task",
    "kind_of_start",
]


class Options(TypedDict, total=False):
    """Keyword arguments of `control.Environment` that every task accepts."""

    flat_observation: bool
    legacy_step: bool
    randomize: Mapping[str, Draw] | None
    pixels: PixelOptions | Pixels | None
    action_repeat: int
    faults: str | Mapping[str, object] | Faults | None
    appearance: AppearanceOptions | str | Appearance | None


class StepOptions(Options, total=False):
    """The keyword arguments accepted by tasks that do not set the control time step themselves."""

    control_timestep: float | None
    n_sub_steps: int | None


Kwargs = Options | None  # of a factory that sets the control time step
StepKwargs = StepOptions | None  # of one that does not
Seed = np.random.RandomState | int | None  # a seed, a stream, or None for an arbitrary seed

# Limit for rejection sampling of starts: the suite's own tasks need a handful of attempts.
_MAX_START_ATTEMPTS = 10_000

_SUCCESS = 0.9  # value from which a term of the goal counts as reached

_COLOURED = ["self", "effector", "target"]  # materials that show the reward
_DEFAULTS = [f"{name}_default" for name in _COLOURED]
_HIGHLIGHTS = [f"{name}_highlight" for name in _COLOURED]


class Picture(NamedTuple):
    """Camera and time of a task's picture; used in `PICTURES` of a domain's module."""

    camera: int | str = 0
    seed: int = 0  # seed of the episode
    steps: int = 0  # steps after its start


class Observed(NamedTuple):
    """Meaning and unit of an observation: `OBSERVATIONS` of a domain's module, by key."""

    meaning: str
    unit: str = ""  # empty for a pure number


_Physics = TypeVar("_Physics", bound=mujoco.Physics)


class Task(control.Task[_Physics]):
    """A task whose actions are the actuators' controls, in the order of the model's file.

    A domain specifies its own physics, `class Humanoid(base.Task[Physics])`, and annotates with it.
    """

    # Model fields that `initialize_episode` or `begin_stream` sets. Each row of a batch has its own
    # copy of them.
    EPISODE_FIELDS: tuple[str, ...] = ()
    # Attributes of the task that belong to an episode: numbers and arrays whose shape and dtype
    # never change. Each row of a batch has its own; see `rl.episode_attributes`.
    EPISODE_ATTRIBUTES: tuple[str, ...] = ()
    # The reward terms that define the goal; the others shape the behaviour.
    GOAL: tuple[str, ...] = ()
    # Parameters of the model that `faults` may perturb, by name.
    PERTURBATIONS: ClassVar[Mapping[str, Parameter]] = {}
    # The kinds of starts that `start` distinguishes; empty if there is only one kind.
    STARTS: tuple[str, ...] = ()
    # The planner's cost for this task as 'module:Class', imported on first use and called with the
    # task.
    planner_cost: str | None = None

    def __init__(self, random: Seed = None) -> None:
        """Creates a task.

        Args:
          random: the stream from which episodes are drawn, or its seed; None for an arbitrary seed.
        """
        if not isinstance(random, np.random.RandomState):
            try:
                random = np.random.RandomState(random)
            except (TypeError, ValueError) as error:
                raise type(error)(
                    f"random is {random!r}; expected a numpy.random.RandomState, a seed from 0 to "
                    "2**32 - 1, or None"
                ) from error
        self._random = random
        self._visualize_reward = False

    @property
    def random(self) -> np.random.RandomState:
        """The stream from which episodes are drawn."""
        return self._random

    @property
    def visualize_reward(self) -> bool:
        """Whether materials are coloured by the reward at each step."""
        return self._visualize_reward

    @visualize_reward.setter
    def visualize_reward(self, value: bool) -> None:
        if not isinstance(value, bool):
            raise ValueError(f"Expected a boolean, got {type(value)}.")
        self._visualize_reward = value

    def action_spec(self, physics: _Physics) -> specs.BoundedArray:
        """Spec of the actuators' controls."""
        return mujoco.action_spec(physics)

    def initialize_episode(self, physics: _Physics) -> None:
        """Colours the start; tasks call it last, once the start is set."""
        self.after_step(physics)

    def before_step(self, action: Nested, physics: _Physics) -> None:
        """Sets the actuators' controls to the action, (..., nu).

        For one actuator, one number for each simulation may have any shape: (), (1,) or (1, 1) for
        a single simulation, (N,), (N, 1) or (N, 1, 1) for a batch of N.

        Raises:
          ValueError: the action has another shape; nothing is set.
        """
        is_array = type(action) is np.ndarray
        if not is_array:
            action = getattr(action, "continuous_actions", action)
        if _has_controls_of_its_own(type(physics)):
            physics.set_control(action)
            return
        if not is_array:
            action = np.asarray(action)
        expected = physics.simulation.ctrl.shape
        if action.shape != expected:
            rows = expected[:-1]
            is_one_each = action.size == math.prod(rows) and action.shape[: len(rows)] == rows
            if expected[-1] != 1 or not is_one_each:
                raise ValueError(
                    f"action has shape {action.shape}; expected {expected}: one number for each "
                    "actuator; nothing was stepped"
                )
            action = action.reshape(expected)
        physics.set_control(action)

    def after_step(self, physics: _Physics) -> None:
        """Colours materials by the reward, if `visualize_reward` is set."""
        if self._visualize_reward:
            # A reward that underflows to 0 is not an error.
            with np.errstate(under="ignore"), stand_in(self, physics) as task:
                _show_reward(physics, task.get_reward(physics))

    # The reward is `reward_of(reward_terms)` unless a task overrides it.
    get_reward = reward_of_terms  # pyright: ignore[reportAssignmentType] (its `self` is a protocol)

    def reward_terms(self, physics: _Physics) -> dict[str, Quantity]:
        """Terms of the reward by name, each between 0 and 1, (...)."""
        raise NotImplementedError(
            f"{type(self).__name__} defines neither get_reward nor reward_terms"
        )

    def reward_of(self, terms: dict[str, Quantity]) -> Quantity:
        """The reward computed from its terms, (...); unless overridden, their product in order."""
        return functools.reduce(lambda product, term: product * term, terms.values())

    def is_success(self, terms: dict[str, Quantity]) -> Quantity:
        """Whether the goal is currently reached, (...) booleans: all of its terms are nearly 1.

        Raises:
          ValueError: GOAL names what is no term.
        """
        try:
            return functools.reduce(np.logical_and, (terms[name] >= _SUCCESS for name in self.GOAL))
        except KeyError as error:
            name = str(error.args[0])
            raise ValueError(
                f"GOAL of task {type(self).__name__} names {name!r}, which is none of its terms: "
                f"{', '.join(terms)}.{did_you_mean(name, terms)}"
            ) from None

    def start(self, physics: _Physics) -> str | None:
        """The kind of start of an episode that has just begun, one of `STARTS`; None if empty."""
        return None

    def draw_collision_free_start(self, physics: _Physics, draw: Callable[[], None]) -> None:
        """Calls `draw`, which sets a random state, until the state has no contacts.

        Raises:
          RuntimeError: no attempt was free of contacts.
        """
        for _ in range(_MAX_START_ATTEMPTS):
            draw()
            physics.after_reset()
            if not physics.data.ncon:
                return
        raise RuntimeError(
            f"{type(self).__name__}: none of {_MAX_START_ATTEMPTS} random starts was free of "
            "contacts; check whether a change of the model rules out such starts"
        )


@functools.lru_cache
def _has_controls_of_its_own(cls: type) -> bool:
    """Whether a class of a user says itself what its controls are: then it checks them, too."""
    if issubclass(cls, mujoco.Physics):
        return cls.set_control is not mujoco.Physics.set_control
    return not hasattr(cls, "simulation")  # it is none of MuJoCo


def _show_reward(physics: mujoco.Physics, reward: Quantity) -> None:
    """Blends the coloured materials between their default and highlight colours."""
    colours = physics.named.model.mat_rgba
    # The power makes differences between high rewards visible.
    blend = np.clip(reward, 0.0, 1.0) ** 4
    try:
        highlights, defaults = colours[_HIGHLIGHTS], colours[_DEFAULTS]
        colours[_COLOURED] = blend * highlights + (1.0 - blend) * defaults
    except KeyError as error:
        raise ValueError(
            "visualize_reward is set, but the model lacks a material that shows the reward "
            f"({error}); expected {', '.join([*_COLOURED, *_DEFAULTS, *_HIGHLIGHTS])}, which "
            "./common/materials.xml of the suite defines"
        ) from error


def kind_of_start(environment: dm_env.Environment) -> str | None:
    """The kind of start of an episode that has just begun; None for a task without kinds."""
    inner = control_of(environment)
    task = getattr(inner, "task", None)
    return task.start(getattr(inner, "physics", None)) if isinstance(task, Task) else None
