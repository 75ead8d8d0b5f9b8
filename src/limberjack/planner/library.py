"""The planner's cost of a task, which the task names, and the files that decide a plan.

    cost = cost_for(env.task)       # of `task.planner_cost`, "module:Class"

Costs of other tasks are passed to the `Planner` itself.
"""

import importlib
import inspect
from pathlib import Path

from limberjack.planner.cost import Cost

__all__ = ["cost_for", "sources_for"]

_PLANNER = Path(__file__).parent


def cost_for(task: object) -> Cost:
    """The cost that a task names as its `planner_cost`, made for it.

    Raises:
      ValueError: it names none, or one that cannot be found; the message says what to write.
    """
    name = getattr(task, "planner_cost", None)
    if name is None:
        raise ValueError(
            f"the planner knows no cost for tasks of type {type(task).__name__}: write a subclass "
            "of limberjack.planner.Cost whose step_cost(physics) returns what each state of a "
            "batch should avoid, shape (N,), and pass it as Planner(env, cost=...), or name it in "
            "the task as planner_cost = 'module:Class'; docs/planner.md and "
            "examples/planner_cost.py show how"
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
            f"planner_cost of {type(task).__name__} is {name!r}, which is no subclass of "
            "limberjack.planner.Cost"
        )
    return found(task)


def sources_for(task: object) -> list[Path]:
    """The files that decide a plan for a task: the planner's package, then the cost's own module.

    Raises:
      ValueError: as `cost_for`.
    """
    files = sorted(_PLANNER.rglob("*.py"))
    own = Path(inspect.getfile(type(cost_for(task)))).resolve()
    return files if own in [file.resolve() for file in files] else [*files, own]
