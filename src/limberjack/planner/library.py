"""Which cost belongs to which task.

    cost = cost_for(env.task)

Costs of other tasks are passed to the `Planner` itself.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from limberjack.planner import (
    costs_humanoid,
    costs_insertion_ball,
    costs_insertion_peg,
    costs_manipulator,
    costs_peg,
    costs_running,
    costs_stacker,
)
from limberjack.planner.cost import Cost
from limberjack.suite import humanoid, manipulator, stacker

__all__ = ["cost_for", "sources_for"]

_HERE = Path(__file__).parent
_ALGORITHM = "sampling"  # the module
_WALKING = 2.0  # metres per second; a humanoid that must be faster runs
_IMPORTED = re.compile(r"^from limberjack\.planner\.(\w+) import", re.MULTILINE)


def _bring_or_insert(task: manipulator.Bring) -> Cost:
    if task._use_peg:
        return (costs_insertion_peg.InsertPeg if task._insert else costs_peg.BringPeg)(task)
    return (costs_insertion_ball.InsertBall if task._insert else costs_manipulator.Bring)(task)


def _move_or_run(task: humanoid.Humanoid) -> Cost:
    runs = task._move_speed > _WALKING
    return costs_running.Run(task) if runs else costs_humanoid.Move(task)


_MAKERS: dict[type, Callable[[Any], Cost]] = {
    humanoid.Humanoid: _move_or_run,
    manipulator.Bring: _bring_or_insert,
    stacker.Stack: costs_stacker.Stack,
}


def cost_for(task: Any) -> Cost:
    """The cost that the planner knows for a task of the suite.

    Raises:
      ValueError: it knows none; the message says what to write.
    """
    for kind in type(task).__mro__:
        if kind in _MAKERS:
            return _MAKERS[kind](task)
    raise ValueError(
        f"the planner knows no cost for tasks of type {type(task).__name__}: write a subclass of "
        "limberjack.planner.Cost whose step_cost(physics) returns what each state of a batch "
        "should avoid, shape (N,), and pass it as Planner(env, cost=...); docs/planner.md and "
        "examples/planner_cost.py show how"
    )


def sources_for(task: Any) -> list[Path]:
    """The files that decide how it is planned for a task, sorted: other costs are not among them.

    Raises:
      ValueError: as `cost_for`.
    """
    cost_module = type(cost_for(task)).__module__.rpartition(".")[2]
    found = {_HERE / f"{_ALGORITHM}.py", _HERE / f"{cost_module}.py"}
    left = list(found)
    while left:
        imported = {_HERE / f"{name}.py" for name in _IMPORTED.findall(left.pop().read_text())}
        new = imported - found - {Path(__file__)}  # this file only knows which cost it is
        found |= new
        left += new
    return sorted(found)
