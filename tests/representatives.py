"""Representative tasks, for tests that depend on a feature rather than on the task.

    from tests.representatives import REPRESENTATIVES

    @pytest.mark.parametrize("task", REPRESENTATIVES)
    def test_a_picture_has_the_size_asked_for(task: Task) -> None: ...

Numbers and laws are tested for all tasks; pictures, Gymnasium's options, snapshots, memory and
rejected input only for these, so that a new domain adds little test time. A task with a feature
that none of these has is added here. `contract/test_representatives.py` checks that each task has
its feature.
"""

import pytest

__all__ = ["FEATURES", "PAIRS", "REPRESENTATIVES", "Task"]

Task = tuple[str, str]

FEATURES: dict[str, Task] = {
    "a free root and contacts in three dimensions": ("humanoid", "walk"),
    "generalised positions and velocities as the observation": ("humanoid", "run_pure_state"),
    "model fields set at each start, and kinds of starts": ("manipulator", "insert_peg"),
    "starts that are rejected, and starts at the goal": ("manipulator", "bring_ball"),
    "many bodies that touch, and a goal of several terms": ("stacker", "stack_4"),
}

# For tests that take a task, and for those that take a domain and a task.
REPRESENTATIVES = [pytest.param(task, id=":".join(task)) for task in FEATURES.values()]
PAIRS = [pytest.param(*task, id=":".join(task)) for task in FEATURES.values()]
