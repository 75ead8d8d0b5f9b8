"""The part that all tasks of the suite have in common.

A task keeps its settings and its random stream, and nothing of the running episode: what an
episode needs lives in the physics. So one task serves one simulation or a batch of them.
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.rl.contract import Nested
from limberjack.rl.reward_terms import reward_of_terms
from limberjack.utils.arrays import Quantity

__all__ = ["Kwargs", "Observed", "Picture", "Random", "Task"]

# Any: keyword arguments of `control.Environment`, which checks them.
Kwargs = Mapping[str, Any] | None
Random = np.random.RandomState | int | None  # a stream, its seed, or None for any

# A start that is rejected this often will never be accepted: the suite's own need a handful.
_MAX_START_ATTEMPTS = 10_000

_SUCCESS = 0.9  # a term of the goal from which it counts as reached

_COLOURED = ["self", "effector", "target"]  # materials that show the reward
_DEFAULTS = [f"{name}_default" for name in _COLOURED]
_HIGHLIGHTS = [f"{name}_highlight" for name in _COLOURED]


class Picture(NamedTuple):
    """The moment at which a picture shows a task: `PICTURES` of a domain's module, by task."""

    camera: int | str = 0
    seed: int = 0  # of the episode
    steps: int = 0  # after its start


class Observed(NamedTuple):
    """Meaning and unit of an observation: `OBSERVATIONS` of a domain's module, by key."""

    meaning: str
    unit: str = ""  # empty for a pure number


_Physics = TypeVar("_Physics", bound=mujoco.Physics)


class Task(control.Task[_Physics]):
    """A task whose actions are the actuators' controls, in the order of the model's file.

    A domain names its own physics, `class Humanoid(base.Task[Physics])`, and annotates with it.
    """

    # Fields of the model that `initialize_episode` sets, which a batch keeps for each row.
    EPISODE_FIELDS: tuple[str, ...] = ()
    # The terms of the reward that make up the goal; the others say how it is to be reached.
    GOAL: tuple[str, ...] = ()
    # The kinds of starts that `start` tells apart; none if there is one kind only.
    STARTS: tuple[str, ...] = ()
    # The planner's cost for this task as 'module:Class', imported on first use; it takes the task.
    planner_cost: str | None = None

    def __init__(self, random: Random = None) -> None:
        """Makes a task.

        Args:
          random: the stream that episodes are drawn from, or its seed; None seeds it anew.
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
        """The stream that episodes are drawn from."""
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

    def action_spec(self, physics: _Physics) -> Nested:
        """The spec of the actuators' controls."""
        return mujoco.action_spec(physics)

    def initialize_episode(self, physics: _Physics) -> None:
        """Colours the start; tasks call it last, when the start is set."""
        self.after_step(physics)

    def before_step(self, action: Nested, physics: _Physics) -> None:
        """Sets the actuators' controls to the action, (..., nu).

        Raises:
          ValueError: the action has another shape; nothing is set.
        """
        if type(action) is not np.ndarray:
            action = np.asarray(getattr(action, "continuous_actions", action))
        expected = physics.simulation.ctrl.shape
        if action.shape != expected:
            raise ValueError(
                f"action has shape {action.shape}; expected {expected}: one number for each "
                "actuator; nothing was stepped"
            )
        physics.set_control(action)

    def after_step(self, physics: _Physics) -> None:
        """Colours materials by the reward, if that is wanted."""
        if self._visualize_reward:
            with np.errstate(under="ignore"):  # a reward of 0 is no error
                _show_reward(physics, self.get_reward(physics))

    # The reward is what `reward_of` makes of `reward_terms`, unless a task defines it otherwise.
    get_reward = reward_of_terms  # pyright: ignore[reportAssignmentType] (its `self` is a protocol)

    def reward_terms(self, physics: _Physics) -> dict[str, Quantity]:
        """The quantities between 0 and 1 that the reward is made of, (...) each, by name."""
        raise NotImplementedError(
            f"{type(self).__name__} defines neither get_reward nor reward_terms and reward_of"
        )

    def reward_of(self, terms: dict[str, Quantity]) -> Quantity:
        """The reward that the terms make, (...)."""
        raise NotImplementedError(f"{type(self).__name__} does not define reward_of")

    def is_success(self, terms: dict[str, Quantity]) -> Quantity:
        """Whether the goal is reached now, (...) booleans: all of its terms are nearly 1."""
        return functools.reduce(np.logical_and, (terms[name] >= _SUCCESS for name in self.GOAL))

    def start(self, physics: _Physics) -> str | None:
        """The kind of start of an episode that has just begun, of `STARTS`; None without any."""
        return None

    def draw_collision_free_start(self, physics: _Physics, draw: Callable[[], None]) -> None:
        """Calls `draw`, which sets a random state, until that state has no contacts.

        Raises:
          RuntimeError: no draw was free of contacts.
        """
        for _ in range(_MAX_START_ATTEMPTS):
            draw()
            physics.after_reset()
            if not physics.data.ncon:
                return
        raise RuntimeError(
            f"{type(self).__name__}: none of {_MAX_START_ATTEMPTS} random starts was free of "
            "contacts; has the model been changed so that none can be?"
        )


def _show_reward(physics: mujoco.Physics, reward: Quantity) -> None:
    """Blends the coloured materials from their default to their highlight."""
    colours = physics.named.model.mat_rgba
    # The power keeps high rewards apart, where colours are compared.
    blend = np.clip(reward, 0.0, 1.0) ** 4
    colours[_COLOURED] = blend * colours[_HIGHLIGHTS] + (1.0 - blend) * colours[_DEFAULTS]
