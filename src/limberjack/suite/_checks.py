"""Validation of a domain's module, with all problems in one message.

It creates an environment of each task, which also gives the episode lengths.
"""

import inspect
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import dm_env

from limberjack.registry import Row
from limberjack.rl import control
from limberjack.rl.copies import control_of
from limberjack.suite import base

__all__ = ["rows_of"]

_KEYWORDS = ("time_limit", "random", "environment_kwargs")  # required of every factory


def rows_of(name: str, module: ModuleType) -> tuple[Row, ...]:
    """The registry rows of a domain's tasks.

    Raises:
      ValueError: the name is not an identifier, or the module is incomplete.
    """
    problems: list[str] = []
    rows: list[Row] = []
    if not (isinstance(name, str) and name.isidentifier()):
        problems.append(f"the name {name!r} is not a Python identifier")
    suite = getattr(module, "SUITE", None)
    if not (isinstance(suite, Mapping) and callable(getattr(suite, "tagged", None))):
        problems.append(
            f"SUITE is {'missing' if suite is None else repr(suite)}; expected a "
            "limberjack.utils.containers.TaggedTasks"
        )
    elif not suite:
        problems.append("SUITE has no tasks; decorate each factory with @SUITE.add()")
    else:
        problems += _picture_problems(module, suite)
        for task in suite:
            row = _row(name, task, suite, problems)
            rows += [] if row is None else [row]
    if problems:
        text = "; ".join(f"({number}) {what}" for number, what in enumerate(problems, 1))
        raise ValueError(f"domain {name!r}, module {module.__name__}, cannot be registered: {text}")
    return tuple(rows)


def _picture_problems(module: ModuleType, suite: Mapping[str, object]) -> list[str]:
    """Problems with a module's `PICTURES`."""
    pictures = getattr(module, "PICTURES", {})
    if not isinstance(pictures, Mapping):
        return [f"PICTURES is {pictures!r}; expected a base.Picture for each task, by name"]
    return [
        *(f"PICTURES has a task {task!r}, SUITE has not" for task in pictures if task not in suite),
        *(
            f"PICTURES[{task!r}] is {picture!r}; expected a limberjack.suite.base.Picture"
            for task, picture in pictures.items()
            if not isinstance(picture, base.Picture)
        ),
    ]


# Any: a user's `TaggedTasks`, which may hold anything.
def _row(name: str, task: object, suite: Any, problems: list[str]) -> Row | None:
    """The row of a task; if it has problems, appends them to `problems` and returns None."""
    factory = suite[task]
    if not (isinstance(task, str) and task.isidentifier()):
        problems.append(f"the task name {task!r} is not a Python identifier")
        return None
    missing = _missing_keywords(factory)
    if missing:
        problems.append(f"factory {task} does not accept {', '.join(missing)}")
        return None
    try:
        environment = factory(random=0)
    except Exception as error:  # a user's factory may raise anything; reported with the others
        problems.append(f"factory {task} raises {type(error).__name__}: {error}")
        return None
    if not isinstance(environment, dm_env.Environment):
        what = type(environment).__name__
        problems.append(
            f"factory {task} returns a {what}; expected a control.Environment, or another "
            "dm_env.Environment"
        )
        return None
    inner = control_of(environment)  # of a wrapper; it may have none
    wrong, dof, steps = [], 0, None
    if isinstance(inner, control.Environment):
        wrong = _task_problems(inner)
        dof = getattr(getattr(inner.physics, "model", None), "nv", 0)
        steps = inner.step_limit
    problems += [f"the task of {task} has {what}" for what in wrong]
    tags = tuple(tag for tag in suite.tags() if task in suite.tagged(tag))
    environment.close()
    return None if wrong else Row(name, task, tags, steps, int(dof))


def _missing_keywords(factory: object) -> list[str]:
    assert callable(factory)
    parameters = inspect.signature(factory).parameters
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return []
    return [name for name in _KEYWORDS if name not in parameters]


def _task_problems(environment: control.Environment) -> list[str]:
    """Problems with the task attributes that other modules read."""
    task, wrong = environment.task, []
    for attribute in ("EPISODE_FIELDS", "GOAL", "STARTS"):
        names = getattr(task, attribute, ())
        if not isinstance(names, tuple) or not all(isinstance(name, str) for name in names):
            wrong.append(f"{attribute} = {names!r}; expected a tuple of names")
    cost = getattr(task, "planner_cost", None)
    if cost is not None and not (isinstance(cost, str) and cost.count(":") == 1):
        wrong.append(f"planner_cost = {cost!r}; expected 'module:Class', or None")
    return wrong
