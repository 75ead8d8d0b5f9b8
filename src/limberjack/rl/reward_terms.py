"""The reward of a step and its terms, computed once.

    class Task(control.Task):
        get_reward = reward_of_terms

    reward, terms = reward_and_terms(task, physics)
    success = success_of(task, terms)

A task that defines another `get_reward` has no terms.
"""

import functools
from collections.abc import Mapping
from typing import Protocol, TypeVar

import numpy as np

from limberjack.rl.contract import Physics, Task
from limberjack.utils.arrays import Quantity

__all__ = ["has_goal", "reward_and_terms", "reward_of_terms", "success_of"]

_Physics = TypeVar("_Physics", bound=Physics, contravariant=True)


_SUITE = "limberjack.suite."  # whose tasks remember nothing


class _HasTerms(Protocol[_Physics]):
    def reward_terms(self, physics: _Physics) -> dict[str, Quantity]: ...

    def reward_of(self, terms: dict[str, Quantity]) -> Quantity: ...

    def is_success(self, terms: Mapping[str, Quantity]) -> Quantity: ...


def reward_of_terms(self: _HasTerms[_Physics], physics: _Physics) -> Quantity:
    """The reward computed by `reward_of` from `reward_terms`, (...)."""
    return self.reward_of(self.reward_terms(physics))


def reward_and_terms(task: Task, physics: Physics) -> tuple[Quantity, dict[str, Quantity]]:
    """The reward and its terms by name, (...) each; no terms if the task defines `get_reward`.

    Underflow is not an error, even if NumPy is set to raise: rewards far from a goal are 0.
    """
    if not _is_of_suite(type(task)) and np.geterr()["under"] == "raise":
        # Before the first call, which may change what the task remembers, not before a second.
        with np.errstate(under="ignore"):
            return _reward_and_terms(task, physics)
    try:
        return _reward_and_terms(task, physics)
    except FloatingPointError:
        if np.geterr()["under"] != "raise":
            raise
        # Only after an error, because entering the context takes 0.5 % of a step.
        with np.errstate(under="ignore"):
            return _reward_and_terms(task, physics)


@functools.lru_cache  # a class's module takes 2 % of a step of the pendulum to read
def _is_of_suite(cls: type) -> bool:
    return cls.__module__.startswith(_SUITE)


def _reward_and_terms(task: Task, physics: Physics) -> tuple[Quantity, dict[str, Quantity]]:
    # Checked on the bound method, so that an instance attribute counts too.
    if getattr(task.get_reward, "__func__", None) is not reward_of_terms:
        return task.get_reward(physics), {}
    has_terms: _HasTerms[Physics] = task  # pyright: ignore[reportAssignmentType] (as checked)
    terms = has_terms.reward_terms(physics)
    return has_terms.reward_of(terms), terms


def has_goal(task: object) -> bool:
    """Whether steps of a task say if they reached a goal: it has one, and terms."""
    get_reward = getattr(task, "get_reward", None)
    return bool(getattr(task, "GOAL", ())) and (
        getattr(get_reward, "__func__", None) is reward_of_terms
    )


def success_of(task: Task, terms: Mapping[str, Quantity]) -> Quantity | None:
    """Whether the goal is reached, (...) booleans; None without a goal or without terms."""
    if not terms or not getattr(task, "GOAL", ()):  # tasks need not be subclasses of `base.Task`
        return None
    has_terms: _HasTerms[Physics] = task  # pyright: ignore[reportAssignmentType] (as checked)
    return has_terms.is_success(terms)
