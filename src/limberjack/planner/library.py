"""Which cost belongs to which task.

    cost = cost_for(env.task)

Costs of other tasks are passed to the `Planner` itself.
"""

from collections.abc import Callable
from typing import Any

from limberjack.planner import costs_humanoid, costs_manipulator, costs_stacker
from limberjack.planner.cost import Cost
from limberjack.suite import humanoid, manipulator, stacker

__all__ = ["cost_for"]

_MAKERS: dict[type, Callable[[Any], Cost]] = {
    humanoid.Humanoid: costs_humanoid.Move,
    manipulator.Bring: costs_manipulator.Bring,
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
        "limberjack.planner.Cost whose step_cost(physics) returns what each simulation of a batch "
        "should avoid, shape (N,), and pass it as Planner(env, cost=...); docs/planner.md and "
        "examples/planner_cost.py show how"
    )
