"""`cost_for`: the planner's cost for a task, and the source files on which a plan depends.

    cost = cost_for(env.task)       # from `task.planner_cost`, "module:Class"

Costs of other tasks are passed to `Planner` directly.
"""

import importlib
import inspect
from pathlib import Path

from limberjack.planner.cost import Cost

__all__ = ["cost_for", "sources_for"]


def cost_for(task: object) -> Cost:
    """An instance of the cost that a task names in `planner_cost`.

    Raises:
      ValueError: the task names no cost, or one that cannot be found; the message has advice.
    """
    name = getattr(task, "planner_cost", None)
    if name is None:
        raise ValueError(
            f"the planner knows no cost for tasks of type {type(task).__name__}: write a subclass "
            "of limberjack.planner.Cost whose step_cost(physics) returns the cost of each state of "
            "a batch, shape (N,), and pass it as Planner(env, cost=...), or name it in the task as "
            "planner_cost = 'module:Class'; see docs/planner.md and examples/planner_cost.py"
        )
    module, _, kind = str(name).partition(":")
    try:
        found = getattr(importlib.import_module(module), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f"planner_cost of {type(task).__name__} is {name!r}; expected 'module:Class' of a "
            f"limberjack.planner.Cost: {error}"
        ) from error
    if not (isinstance(found, type) and issubclass(found, Cost)):
        raise ValueError(
            f"planner_cost of {type(task).__name__} is {name!r}, which is not a subclass of "
            "limberjack.planner.Cost"
        )
    return found(task)


def sources_for(task: object) -> list[Path]:
    """Source files on which plans for a task depend: the planner's package and the cost's module.

    Raises:
      ValueError: see `cost_for`.
    """
    files = sorted(Path(__file__).parent.rglob("*.py"))
    own = Path(inspect.getfile(type(cost_for(task)))).resolve()
    return files if own in [file.resolve() for file in files] else [*files, own]
