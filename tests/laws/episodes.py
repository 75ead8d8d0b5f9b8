"""Environments and episodes as bits, for the laws and promises: equal bits, equal behaviour.

The laws hold for every domain. They run on those of the suite, or on the domain named by the
variable LAWS_OF, which may be in an installed package: `LAWS_OF=swing pytest tests/laws`. Facts
specific to a task are read from the task, or from `expectations` in the folder of the domains'
tests.
"""

import inspect
import itertools
import os
from collections.abc import Iterable
from typing import Any

import dm_env
import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.rl.action_specs import bounds_to_try
from tests.representatives import or_slow

__all__ = [
    "DOMAINS",
    "LAST_TASKS",
    "TASKS",
    "Task",
    "actions",
    "bits",
    "costly",
    "kinds",
    "load",
    "play",
    "rotated",
    "short",
    "snapshot",
    "variant",
]

Task = tuple[str, str]


def _tasks() -> tuple[Task, ...]:
    domain = os.environ.get("LAWS_OF")
    if domain is None:
        return suite.ALL_TASKS
    return tuple((domain, task) for task in suite.module_of(domain).SUITE)


TASKS = [pytest.param(task, id=":".join(task)) for task in _tasks()]
# One task of each domain: its last, which has the most that can go wrong in its start.
LAST_TASKS = list({task[0]: task for task in _tasks()}.values())
DOMAINS = [pytest.param(task, id=":".join(task)) for task in LAST_TASKS]


def costly(params: list[Any]) -> list[Any]:
    """Parameters of a law that takes long: slow for tasks of the suite without a feature."""
    return params if "LAWS_OF" in os.environ else or_slow(params)


def _named(choice: Any) -> str:
    return getattr(choice, "__name__", str(choice))


def rotated(*choices: Iterable[Any], of: Iterable[Task] | None = None) -> list[Any]:
    """Parameters of a law: each task with one combination of the choices, in turn.

    The combinations are of sizes, threads and the like, which do not depend on the task: the tasks
    together meet each of them. Where there are fewer tasks than combinations, each task meets all.
    """
    combinations = list(itertools.product(*choices))
    tasks = list(_tasks() if of is None else of)
    turns = [(combinations[i % len(combinations)], task) for i, task in enumerate(tasks)]
    if len(tasks) < len(combinations):
        turns = list(itertools.product(combinations, tasks))
    return [
        pytest.param(task, *chosen, id="-".join([":".join(task), *map(_named, chosen)]))
        for chosen, task in turns
    ]


_OF_EVERY_FACTORY = ("time_limit", "random", "environment_kwargs")


def load(task: Task, seed: int = 0, **environment_kwargs: Any) -> control.Environment:
    """An environment of the task."""
    return suite.load(*task, {"random": seed}, environment_kwargs)


def short(task: Task, steps: int) -> dict[str, float]:
    """Arguments of the task for episodes of so many steps."""
    return {"time_limit": steps * suite.load(*task).control_timestep()}


def variant(task: Task) -> dict[str, bool]:
    """Arguments of the task that negate each of its boolean options."""
    parameters = inspect.signature(suite.module_of(task[0]).SUITE[task[1]]).parameters
    return {
        name: not parameter.default
        for name, parameter in parameters.items()
        if name not in _OF_EVERY_FACTORY and isinstance(parameter.default, bool)
    }


def kinds(task: Any) -> set[str | None]:
    """The kinds of starts that a task may have."""
    return set(task.STARTS) or {None}


def actions(env: control.Environment, count: int, seed: int = 0) -> np.ndarray:
    """Random valid actions, (count, nu)."""
    spec = env.action_spec()
    stream = np.random.RandomState(seed)
    return stream.uniform(*bounds_to_try(spec), (count, *spec.shape))


def bits(value: Any) -> Any:
    """A time step, or anything in it, in a form that is equal only if all types and bits are."""
    if isinstance(value, dm_env.TimeStep):
        return tuple(bits(part) for part in value)
    if isinstance(value, dict):
        return [(name, bits(part)) for name, part in value.items()]
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.str, value.shape, value.tobytes()
    return type(value).__name__, repr(value)


def play(env: control.Environment, steps: int, seed: int = 0, reset: bool = True) -> list[Any]:
    """The bits of an episode's start, unless `reset` is False, and of `steps` random steps."""
    told = [bits(env.reset())] if reset else []
    return told + [bits(env.step(action)) for action in actions(env, steps, seed)]


def snapshot(env: control.Environment) -> Any:
    """Everything that the environment's future depends on, as bits."""
    physics = env.physics
    # mjSTATE_INTEGRATION and the results of the first half of the step in progress.
    state = physics.get_state(mujoco.mjtState.mjSTATE_INTEGRATION.value)
    data = physics.data
    computed = [data.xpos, data.cvel, data.qfrc_bias, data.sensordata, data.warning.number]
    model = physics.model._official
    settings = [model.body_pos, model.body_quat, model.mat_rgba, model.opt.disableflags]
    stream = env.task.random.get_state()
    return [bits(np.array(part)) for part in (state, *computed, *settings)] + [bits(stream)]
