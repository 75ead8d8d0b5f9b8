"""Lists and sets of tasks, as batches."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import many


@pytest.mark.parametrize(
    ("how", "expected"),
    [
        ({"rows": 2}, [2, 2]),
        ({"rows": [1, 3]}, [1, 3]),
        ({"rows": np.array([1, 3])}, [1, 3]),
        ({"rows": np.int64(2)}, [2, 2]),
        ({"num_envs": 6}, [3, 3]),
    ],
)
def test_rows_are_given_for_each_task_or_together(how: Any, expected: list[int]) -> None:
    batch = suite.load_batch(["pendulum:swingup", "reacher:easy"], seed=4, **how)
    assert [task.rows.stop - task.rows.start for task in batch.tasks] == expected
    assert [part.num_envs for part in batch.parts] == expected
    first = batch.reset().observation["observations"]
    for row in range(batch.num_envs):
        domain, _, task = batch.tasks[batch.task_ids[row]].name.partition(":")
        alone = suite.load(domain, task, {"random": 4 + row}).reset().observation
        flat = np.concatenate([np.ravel(value) for value in alone.values()])
        np.testing.assert_array_equal(first[row, : len(flat)], flat)


@pytest.mark.parametrize(
    ("how", "error", "message"),
    [
        ({}, TypeError, "rows is None and num_envs is None; expected one of them"),
        ({"rows": 1, "num_envs": 2}, TypeError, "expected one of them"),
        ({"rows": 0}, ValueError, "rows is 0; expected a whole number"),
        ({"rows": [1]}, ValueError, "rows has 1 numbers; expected 2"),
        ({"rows": [1, True]}, ValueError, "rows is True"),
        ({"rows": "22"}, ValueError, "rows is '2'"),
        ({"num_envs": 5}, ValueError, "num_envs is 5; expected a multiple of 2"),
        ({"num_envs": 0}, ValueError, "num_envs is 0"),
        ({"rows": 1, "seed": -1}, ValueError, "seed"),
        ({"rows": 1, "num_threads": 0}, ValueError, "num_threads is 0"),
        ({"rows": 1, "task_kwargs": {"random": 1}}, TypeError, "does not accept 'random'"),
    ],
)
def test_rows_that_do_not_fit_are_refused(how: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        suite.load_batch(["pendulum:swingup", "reacher:easy"], **how)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((["pendulum:swingup"], "swingup", 2), "expected None with a list of tasks"),
        (("pendulum", "swingup"), "num_envs is None and rows is None"),
    ],
)
def test_one_task_and_several_are_not_mixed(given: Any, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        suite.load_batch(*given)
    with pytest.raises(TypeError, match="rows only for a list of tasks"):
        suite.load_batch("pendulum", "swingup", 2, rows=2)  # pyright: ignore[reportCallIssue]


def test_an_unknown_task_is_named() -> None:
    with pytest.raises(ValueError, match=r"Task .swingip. does not exist.*Did you mean .swingup."):
        suite.load_batch(["reacher:easy", "pendulum:swingip"], rows=1)


def test_halves_have_the_rows_and_widths_of_the_whole() -> None:
    tasks, rows = ["pendulum:swingup", "reacher:easy", "lqr:lqr_2_1"], [2, 3, 2]
    whole = suite.load_batch(tasks, rows=rows, seed=6)
    halves = suite.load_halves(tasks, rows, seed=6)
    assert [half.num_envs for half in halves] == [4, 3]
    assert [task.rows for task in halves[1].tasks] == [slice(0, 2), slice(2, 5), slice(5, 7)]
    actions = np.random.RandomState(0).uniform(-1, 1, whole.action_mask.shape)
    found = [whole.reset(), whole.step(actions)]
    parts = [[half.reset() for half in halves]]
    parts.append([halves[0].step(actions[:4]), halves[1].step(actions[4:])])
    for expected, (first, second) in zip(found, parts, strict=True):
        for name, values in expected.observation.items():
            both = np.concatenate([first.observation[name], second.observation[name]])
            np.testing.assert_array_equal(both, values, name)
        np.testing.assert_array_equal(np.r_[first.reward, second.reward], expected.reward)
    with pytest.raises(ValueError, match="there is 1 row; expected at least 2"):
        suite.load_halves(tasks[:1], 1)


def test_every_task_of_the_suite_has_an_instruction_of_its_own_domain() -> None:
    for domain, task in suite.ALL_TASKS:
        sentence = many.instruction(domain, task)
        assert sentence.endswith("."), (domain, task)
        assert len(sentence.split()) >= 3, (domain, task)
