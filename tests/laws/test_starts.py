"""Starts of episodes of any task."""

from typing import Any

import numpy as np
import pytest

from limberjack.suite import base
from tests.suite import expectations

from .episodes import TASKS, Task, bits, kinds, load

_STARTS = 25


def calls_in_a_start(env: Any, owner: Any, name: str) -> bool:
    """Whether a start calls a method of the environment's task or physics."""
    method, calls = getattr(owner, name), []
    setattr(owner, name, lambda *given: (calls.append(given), method(*given)))
    env.reset()
    delattr(owner, name)
    env.reseed(0)
    return bool(calls)


def has_free_starts(env: Any) -> bool:
    """Whether the task draws starts with `draw_collision_free_start`."""
    return calls_in_a_start(env, env.task, "draw_collision_free_start")


@pytest.mark.parametrize("task", TASKS)
def test_starts_have_no_contacts_and_joints_within_their_limits(task: Task) -> None:
    env = load(task)
    is_free = has_free_starts(env)
    is_simulated = calls_in_a_start(env, env.physics, "step")  # limits are soft there
    model = env.physics.model._official
    limited = np.flatnonzero(model.jnt_limited.ravel())
    low, high = model.jnt_range[limited].T
    for _ in range(_STARTS):
        env.reset()
        assert env.physics.data.ncon == 0 or not is_free
        assert env.physics.time() == 0.0
        assert not env.physics.control().any()
        positions = env.physics.position()[model.jnt_qposadr[limited]]
        assert is_simulated or np.all((low <= positions) & (positions <= high))


@pytest.mark.parametrize("task", TASKS)
def test_the_first_observation_is_of_the_state_that_the_episode_starts_from(task: Task) -> None:
    env = load(task)
    for _ in range(5):
        first = env.reset().observation
        env.physics.after_reset()
        again = env.task.get_observation(env.physics)
        assert bits(first) == bits(again)


@pytest.mark.parametrize("task", TASKS)
def test_starts_differ_and_their_kinds_are_declared(task: Task) -> None:
    env = load(task)
    expected = expectations.STARTS.get(task)
    assert expected is None or expected == kinds(env.task)
    seen = set()
    for _ in range(_STARTS):
        seen.add(str(bits(env.reset().observation)))
        assert env.task.start(env.physics) in kinds(env.task)
    assert len(seen) == _STARTS


@pytest.mark.parametrize("task", TASKS)
def test_a_start_that_cannot_be_collision_free_is_an_error_naming_task_and_bound(
    task: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(base, "_MAX_START_ATTEMPTS", 30)
    env, twin = load(task), load(task)
    if not has_free_starts(env):
        pytest.skip(f"{task[1]} does not draw starts until they are free of contacts")
    margins = env.physics.model.geom_margin.copy()
    env.physics.model.geom_margin[:] = 10.0  # everything touches everything
    name = type(env.task).__name__
    with pytest.raises(RuntimeError, match=rf"{name}: none of 30 random starts was free of cont"):
        env.reset()
    # Works again once the model is restored.
    env.physics.model.geom_margin[:] = margins
    env.task._random = np.random.RandomState(4)
    twin.task._random = np.random.RandomState(4)
    action = np.zeros(env.action_spec().shape)
    assert bits(env.step(action)) == bits(twin.step(action))
    assert bits(env.step(action)) == bits(twin.step(action))
