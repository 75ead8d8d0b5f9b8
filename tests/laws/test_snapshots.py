"""A restored snapshot has the same future as the original, bit for bit, for every task."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.randomize import scale

from .episodes import LAST_TASKS, TASKS, Task, costly, rotated, short

_TASKS = pytest.mark.parametrize("task", costly(TASKS))
_RANDOMIZE = {"body_mass": scale(0.8, 1.2), "geom_friction": scale(0.5, 1.5)}


def _short(task: Task) -> dict[str, Any]:
    return dict(short(task, 20))


def _actions(env: Any, steps: int) -> np.ndarray:
    return np.random.RandomState(1).uniform(-1, 1, (steps, *env.action_spec().shape))


def _assert_same(one: Any, other: Any) -> None:
    np.testing.assert_array_equal(one.step_type, other.step_type)
    np.testing.assert_array_equal(one.reward, other.reward)
    for name, value in one.observation.items():
        np.testing.assert_array_equal(value, other.observation[name], name)


@pytest.mark.parametrize(("task", "steps_before"), costly(rotated([0, 1, 13, 20])))
def test_a_single_environment_continues_from_a_snapshot(task: Task, steps_before: int) -> None:
    env = suite.load(*task, {"random": 1, **_short(task)})
    env.reset()
    actions = _actions(env, steps_before + 45)  # across the ends of two episodes
    for action in actions[:steps_before]:
        env.step(action)
    seen = env.task.get_observation(env.physics)
    snapshot = pickle.loads(pickle.dumps(env.snapshot()))
    future = [env.step(action) for action in actions[steps_before:]]
    other = suite.load(*task, {"random": 99, **_short(task)})
    other.reset()
    other.step(actions[0])
    for twin in (env, other):
        twin.restore(snapshot)
        for name, value in seen.items():
            np.testing.assert_array_equal(twin.task.get_observation(twin.physics)[name], value)
        for action, expected in zip(actions[steps_before:], future, strict=True):
            _assert_same(twin.step(action), expected)


@_TASKS
def test_copies_and_pickles_of_a_batch_have_its_future(task: Task) -> None:
    kwargs, randomize = dict(short(task, 16)), {"randomize": _RANDOMIZE}
    batch = suite.load_batch(*task, 3, 2, 3, kwargs, randomize)
    batch.reset()
    actions = _actions(batch, 27)  # across the end of each row's episode
    for action in actions[:9]:
        batch.step(action)
    batch.reset([2])
    other_threads = suite.load_batch(*task, 3, 1, 70, kwargs, randomize)
    other_threads.restore(batch.snapshot())
    twins = [copy.deepcopy(batch), pickle.loads(pickle.dumps(batch)), other_threads]
    for action in actions[9:]:
        expected = batch.step(action)
        for twin in twins:
            _assert_same(twin.step(action), expected)


@pytest.mark.parametrize(
    ("task", "num_envs", "option"),
    rotated([None, 3], ["randomize", "legacy_step"], of=LAST_TASKS),
)
def test_copies_and_pickles_keep_how_an_environment_is_run(
    task: Task, num_envs: int | None, option: str
) -> None:
    kwargs = {option: {"randomize": _RANDOMIZE, "legacy_step": False}[option]}
    if num_envs is None:
        env: Any = suite.load(*task, {"random": 3, **_short(task)}, kwargs)
    else:
        env = suite.load_batch(*task, num_envs, 2, 3, _short(task), kwargs)
    env.reset()
    actions = _actions(env, 32)  # into the next episodes, whose fields are drawn by the copy
    for action in actions[:9]:
        env.step(action)
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    twins.append(copy.deepcopy(twins[0]))
    for action in actions[9:]:
        expected = env.step(action)
        for twin in twins:
            _assert_same(twin.step(action), expected)


@_TASKS
def test_one_row_goes_into_any_row_of_any_batch(task: Task) -> None:
    single = suite.load(*task, {"random": 5, **_short(task)})
    single.reset()
    actions = _actions(single, 32)
    for action in actions[:7]:
        single.step(action)
    batch = suite.load_batch(*task, 5, 2, 40, task_kwargs=_short(task))
    batch.reset()
    batch.step(np.stack([actions[0]] * 5))
    batch.restore(single.snapshot(), [3])
    batch.copy_row(3, 1)
    for action in actions[7:]:
        expected = single.step(action)
        time_step = batch.step(np.stack([action] * 5))
        for row in (1, 3):
            assert time_step.step_type[row] == int(expected.step_type)
            for name, value in expected.observation.items():
                np.testing.assert_array_equal(time_step.observation[name][row], value)
    twin = suite.load(*task, {"random": 0, **_short(task)})
    twin.restore(batch.snapshot([1]))
    _assert_same(twin.step(actions[0]), single.step(actions[0]))


def test_a_snapshot_of_something_else_is_refused_and_nothing_changes() -> None:
    env = suite.load("humanoid", "walk", {"random": 0})
    env.reset()
    twin = copy.deepcopy(env)
    batch = suite.load_batch("humanoid", "walk", 2, 1, 0)
    batch.reset()
    other_task = suite.load("stacker", "stack_2", {"random": 0})
    other_task.reset()
    for snapshot, what in [
        (other_task.snapshot(), "task 'Stack'"),
        (batch.snapshot(), "holds 2 environments; expected 1"),
    ]:
        with pytest.raises(ValueError, match=what):
            env.restore(snapshot)
    with pytest.raises(ValueError, match="holds 1 environments; expected 2"):
        batch.restore(env.snapshot())
    action = np.zeros(env.action_spec().shape)
    _assert_same(env.step(action), twin.step(action))
