"""A row of many tasks equals the same row of its task's own batch, bit for bit, for every task."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.gym import VectorEnv
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.many import ManyTasks

from .episodes import TASKS

_ROWS = 2  # of each task
_SEED = 11
_TASKS: list[Any] = [param.values[0] for param in TASKS]
# Every task has several episodes of so many seconds in a test, of 2 to 12 steps each.
_SECONDS = 0.06


@pytest.fixture(scope="module")
def pair() -> Iterator[tuple[ManyTasks, list[Any]]]:
    """All tasks as one batch, and the batch of each."""
    kwargs = {"time_limit": _SECONDS}
    many = suite.load_batch(_TASKS, rows=_ROWS, seed=_SEED, task_kwargs=kwargs)
    alone = [
        suite.load_batch(domain, task, _ROWS, 1, _SEED + facts.rows.start, kwargs)
        for (domain, task), facts in zip(_TASKS, many.tasks, strict=True)
    ]
    yield many, alone
    for batch in (many, *alone):
        batch.close()


def _actions(many: ManyTasks, stream: np.random.RandomState) -> np.ndarray:
    """Random actions, with rubbish behind those of narrower tasks."""
    low, high = bounds_to_try(many.single_action_spec())
    actions = stream.uniform(low, high, many.action_mask.shape)
    actions[~many.action_mask] = np.nan
    return actions


def _flat(observation: Any) -> np.ndarray:
    return np.concatenate([np.reshape(v, (_ROWS, -1)) for v in observation.values()], axis=1)


def _assert_equal(many: ManyTasks, found: Any, alone: list[Any], expected: list[Any]) -> None:
    padded = found.observation["observations"]
    terms: Any = many.reward_terms
    for task, batch, one in zip(many.tasks, alone, expected, strict=True):
        rows = task.rows
        flat = _flat(one.observation)
        np.testing.assert_array_equal(padded[rows, : task.observation_size], flat, task.name)
        assert not padded[rows, task.observation_size :].any()
        for name in ("step_type", "reward", "discount"):
            mine = getattr(found, name)[rows]
            np.testing.assert_array_equal(mine, getattr(one, name), f"{name} of {task.name}")
        for name in ("begins", "timed_out", "diverged"):
            mine = getattr(many, name)[rows]
            np.testing.assert_array_equal(mine, getattr(batch, name), f"{name} of {task.name}")
        for name, values in batch.reward_terms.items():
            np.testing.assert_array_equal(terms[name][rows], values, f"{name} of {task.name}")
            assert many.rows_with(name)[rows].all()


def test_values_and_ends_are_those_of_each_task_alone(pair: tuple[ManyTasks, list[Any]]) -> None:
    many, alone = pair
    seeds = [_SEED + row for row in range(many.num_envs)]
    found = many.reset(seeds=seeds)
    own = [[seeds[row] for row in range(many.num_envs)[task.rows]] for task in many.tasks]
    expected = [batch.reset(seeds=of_task) for batch, of_task in zip(alone, own, strict=True)]
    _assert_equal(many, found, alone, expected)
    stream = np.random.RandomState(0)
    for step in range(16):
        actions = _actions(many, stream)
        found = many.step(actions)
        expected = [
            batch.step(actions[task.rows, : task.action_size])
            for batch, task in zip(alone, many.tasks, strict=True)
        ]
        _assert_equal(many, found, alone, expected)
        if step % 6 == 4:  # a row in three begins again, with a seed or without
            ids = np.flatnonzero(stream.uniform(size=many.num_envs) < 0.3)
            given = [None if row % 2 else 1000 + row for row in ids.tolist()]
            found = many.reset(ids, given)
            expected = []
            for task, batch in zip(many.tasks, alone, strict=True):
                here = (ids >= task.rows.start) & (ids < task.rows.stop)
                of_task = [seed for seed, is_here in zip(given, here, strict=True) if is_here]
                expected.append(batch.reset(ids[here] - task.rows.start, of_task))
            _assert_equal(many, found, alone, expected)
    finished = sum(one.episodes for one in many.statistics().values())
    assert finished > many.num_envs  # every row has ended more than once, on average


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_the_three_modes_are_those_of_each_task_alone(
    pair: tuple[ManyTasks, list[Any]], mode: str
) -> None:
    many, alone = pair
    whole = VectorEnv(many, flat=True, autoreset_mode=mode)
    parts = [VectorEnv(batch, flat=True, autoreset_mode=mode) for batch in alone]
    stream = np.random.RandomState(1)
    observations, _ = whole.reset(seed=_SEED)
    for task, part in zip(many.tasks, parts, strict=True):
        seen, _ = part.reset(seed=_SEED + task.rows.start)
        np.testing.assert_array_equal(observations[task.rows, : task.observation_size], seen)
    for _ in range(14):
        actions = _actions(many, stream)
        observations, rewards, terminated, truncated, info = whole.step(actions)
        ended = terminated | truncated
        for task, part in zip(many.tasks, parts, strict=True):
            rows, size = task.rows, task.observation_size
            seen, *numbers, own = part.step(actions[rows, : task.action_size])
            np.testing.assert_array_equal(observations[rows, :size], seen, task.name)
            for mine, its in zip((rewards, terminated, truncated), numbers, strict=True):
                np.testing.assert_array_equal(mine[rows], its, task.name)
            for name, values in own.get("reward_terms", {}).items():
                np.testing.assert_array_equal(info["reward_terms"][name][rows], values, name)
            if "success" in own:
                np.testing.assert_array_equal(info["success"][rows], own["success"])
                np.testing.assert_array_equal(info["_success"][rows], own["_success"])
            else:
                assert not info["_success"][rows].any()
            for row in np.flatnonzero(own.get("_final_obs", ())):
                last = info["final_obs"][rows][row]
                np.testing.assert_array_equal(last[:size], own["final_obs"][row])
                assert not last[size:].any()
        if mode == "Disabled" and ended.any():
            observations, _ = whole.reset(options={"reset_mask": ended})
            for task, part in zip(many.tasks, parts, strict=True):
                if ended[task.rows].any():
                    seen, _ = part.reset(options={"reset_mask": ended[task.rows]})
                    mine = observations[task.rows, : task.observation_size]
                    np.testing.assert_array_equal(mine, seen)


def test_a_snapshot_of_all_rows_has_their_future(pair: tuple[ManyTasks, list[Any]]) -> None:
    many, _ = pair
    many.reset(seeds=[_SEED + row for row in range(many.num_envs)])
    stream = np.random.RandomState(2)
    actions = [_actions(many, stream) for _ in range(12)]
    for one in actions[:3]:
        many.step(one)
    snapshot = many.snapshot()
    future = [many.step(one) for one in actions[3:]]
    many.step(actions[0])
    many.restore(snapshot)
    for one, expected in zip(actions[3:], future, strict=True):
        found = many.step(one)
        for name in ("step_type", "reward", "discount"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        for name, values in expected.observation.items():
            np.testing.assert_array_equal(found.observation[name], values)
