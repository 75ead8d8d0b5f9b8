"""Copies of environments: independent and exact, or refused with the attribute's name."""

import copy
import functools
import pickle
import threading
import types
from typing import Any

import numpy as np
import pytest

from limberjack.rl import control, copies
from limberjack.suite.wrappers import _delegating

from . import odd_environments as odd


class _Everything(odd.Repeating):
    """A wrapper that delegates all names, as many programs write it."""

    def __getattr__(self, name: str) -> Any:
        if name == "_env":
            raise AttributeError(name)
        return getattr(self._env, name)


class _Slotted(_delegating.Wrapper):
    __slots__ = ("factor",)

    def step(self, action: Any) -> Any:
        time_step = super().step(action)
        return time_step._replace(reward=(time_step.reward or 0.0) * self.factor)


class _Reduced(_Everything):
    """Keeps a lock, and leaves it out of its state."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.lock = threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.lock = threading.Lock()


def _everything(seed: int) -> Any:
    return _Everything(odd.environment(odd.LastAction, seed))


def _slotted(seed: int) -> Any:
    env = _Slotted(odd.environment(odd.LastAction, seed))
    env.factor = 3.0
    return env


def _reduced(seed: int) -> Any:
    return _Reduced(odd.environment(odd.Queues, seed))


_WRAPPERS = {
    "all names": _everything,
    "two wrappers": lambda seed: _Everything(_everything(seed)),
    "slots": _slotted,
    "a state of its own": _reduced,
}


@pytest.mark.parametrize("kind", [*odd.KINDS, *_WRAPPERS])
def test_a_copy_continues_as_the_original_and_neither_changes_the_other(kind: str) -> None:
    build = {**odd.KINDS, **_WRAPPERS}[kind]
    actions = odd.actions_of(20, 1)[:, 0]
    expected = list(odd.steps_of(build(5), actions))
    env = build(5)
    assert list(odd.steps_of(env, actions[:4])) == expected[:4]
    twin = copies.copied(env)
    assert type(twin) is type(env)
    another = copies.copied(twin)
    assert list(odd.steps_of(twin, actions[4:])) == expected[4:]
    assert list(odd.steps_of(env, actions[4:])) == expected[4:]
    assert list(odd.steps_of(another, actions[4:])) == expected[4:]
