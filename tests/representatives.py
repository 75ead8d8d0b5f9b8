"""Representative tasks, for tests that depend on a feature rather than on the task.

    from tests.representatives import REPRESENTATIVES, in_turn

    @pytest.mark.parametrize("task", REPRESENTATIVES)
    def test_a_picture_has_the_size_asked_for(task: Task) -> None: ...

    @pytest.mark.parametrize(("size", "task"), in_turn(SIZES))
    def test_a_picture_has_any_size(size: int, task: Task) -> None: ...

    @pytest.mark.parametrize("task", EVERY_TASK)
    def test_a_batch_may_be_copied(task: Task) -> None: ...

Numbers are compared with dm_control's for all tasks, single and in batches. Laws that take long,
and follow from code that the tasks share, are tested for these and, in `make test-slow`, for the
others; pictures, Gymnasium's options, memory and rejected input for these alone.
So a new domain adds little test time. A task with a feature that none of these has is added here.
`contract/test_representatives.py` checks that each task has its feature.
"""

import itertools
from collections.abc import Iterable
from typing import Any

import pytest

from limberjack import suite

__all__ = [
    "EVERY_TASK",
    "FEATURES",
    "PAIRS",
    "REPRESENTATIVES",
    "USUAL",
    "Task",
    "in_turn",
    "or_slow",
]

Task = tuple[str, str]

FEATURES: dict[str, Task] = {
    "a free root and contacts in three dimensions": ("humanoid", "walk"),
    "generalised positions and velocities as the observation": ("humanoid", "run_pure_state"),
    "model fields set at each start, and kinds of starts": ("manipulator", "insert_peg"),
    "starts that are rejected, and starts at the goal": ("manipulator", "bring_ball"),
    "many bodies that touch, and a goal of several terms": ("stacker", "stack_4"),
    "a model for each row": ("quadruped", "escape"),
    "fields drawn for each stream, and no time limit": ("lqr", "lqr_2_1"),
    "activations": ("dog", "walk"),
}

# For tests that take a task, and for those that take a domain and a task.
REPRESENTATIVES = [pytest.param(task, id=":".join(task)) for task in FEATURES.values()]
PAIRS = [pytest.param(*task, id=":".join(task)) for task in FEATURES.values()]
# Without lqr, which has one actuator, no control step of its own, and a model for each stream.
USUAL = [pytest.param(task, id=":".join(task)) for task in FEATURES.values() if task[0] != "lqr"]


def or_slow(params: Iterable[Any]) -> list[Any]:
    """The same parameters, which begin with a task: slow unless it is a representative."""
    kept = set(FEATURES.values())
    return [
        param
        if param.values[0] in kept
        else pytest.param(*param.values, id=param.id, marks=pytest.mark.slow)
        for param in params
    ]


EVERY_TASK = or_slow(pytest.param(task, id=":".join(task)) for task in suite.ALL_TASKS)


def in_turn(choices: Iterable[Any]) -> list[Any]:
    """Each choice with one of the representatives, in turn, and each of these at least once.

    For choices that do not depend on the task, instead of their product with the tasks.
    """
    choices = list(choices)
    count = max(len(choices), len(FEATURES))
    pairs = zip(itertools.cycle(choices), itertools.cycle(FEATURES.values()), strict=False)
    return [
        pytest.param(choice, task, id=f"{getattr(choice, '__name__', choice)}-{':'.join(task)}")
        for choice, task in itertools.islice(pairs, count)
    ]
