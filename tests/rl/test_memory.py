"""Memory of tasks and physics: what is kept, put back and left alone."""

import collections
import copy
import functools
import pickle
import threading
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import memory

from . import odd_environments as odd


@pytest.mark.parametrize("kind", odd.KINDS)
def test_the_specs_and_a_second_look_leave_the_memory_and_the_stream(kind: str) -> None:
    build, actions = odd.KINDS[kind], odd.actions_of(2 * odd.STEPS, 1)[:, 0]
    env, expected = build(2), list(odd.steps_of(build(2), actions))
    for action, facts in zip(actions, expected, strict=True):
        env.observation_spec()
        env.action_spec()
        assert next(odd.steps_of(env, action[None])) == facts


class _Held(odd.Pole):
    """Holds what cannot be copied, and a list that others hold too."""

    def __init__(self, random: Any, log: list[float]) -> None:
        super().__init__(random=random)
        self.lock = threading.Lock()
        self.log = log

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        with self.lock:
            self.log.append(float(physics.data.time))
        return super().get_observation(physics)


def test_the_specs_of_a_task_that_cannot_be_copied_are_found_and_its_list_stays_the_same() -> None:
    log: list[float] = []
    env = odd.environment(functools.partial(_Held, log=log))  # pyright: ignore[reportArgumentType]
    env.reset()
    assert log == [0.0]
    env.observation_spec()
    assert log == [0.0]
    env.step([0.0])
    assert log == [0.0, 0.02]
    assert env.task.log is log
