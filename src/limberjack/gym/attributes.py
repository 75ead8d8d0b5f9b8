"""Attributes and methods of the rows of a `VectorEnv`, as if each row were an `Env`.

    envs.get_attr("dt")                          # (0.025, 0.025, ...)
    envs.set_attr("_move_speed", 5.0)            # a setting of the task, the same in all rows
    envs.call("render")                          # a picture of each row

The rows of a vectorised batch share one task, so they have its settings in common; what the task
declares in EPISODE_ATTRIBUTES is separate for each row. A batch of complete environments has
`environments`, and answers for each of them by its own `get_attr`, `set_attr` and `call`.
"""

import copy
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeGuard, cast

import numpy as np

from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batch_contract import Batch
from limberjack.rl.many import ManyTasks
from limberjack.rl.rows import RowsEnvironment
from limberjack.utils.suggest import did_you_mean

__all__ = ["Rows", "are_environments", "call", "get", "has", "set_values"]

# Attributes of an `Env` that all rows have in common, with the names that a `VectorEnv` has for
# them.
_COMMON = {
    "action_space": "single_action_space",
    "dt": "dt",
    "layout": "layout",
    "metadata": "metadata",
    "observation_space": "single_observation_space",
    "render_mode": "render_mode",
    "single_action_space": "single_action_space",
    "single_observation_space": "single_observation_space",
    "spec": "spec",
}
# Attributes of a `control.Environment` that a vectorised batch has for its rows.
_OF_BATCH = (
    "action_repeat",
    "is_running",
    "name",
    "pixels",
    "randomization",
    "reward_terms",
    "step_limit",
    "success",
    "timed_out",
    "world",
)
_METHODS = (
    "action_spec",
    "control_timestep",
    "get_wrapper_attr",
    "has_wrapper_attr",
    "render",
    "snapshot",
)
# Not settings: the stream belongs to a row, and the rows share the colours of materials.
_MACHINERY = ("_random", "random", "_visualize_reward", "visualize_reward")
_SETTINGS = (bool, int, float, str, tuple, list, np.ndarray, np.generic, type(None))
_NUMBERS = (int, float, np.integer, np.floating)
_WAY_OUT = (
    "For rows with attributes of their own make the batch of complete environments, with "
    "limberjack.rl.batch_of(..., vectorised=False)."
)


# Any: arguments of a method of any class.
_Args = Sequence[Any]
_Kwargs = Mapping[str, Any]  # as above


class Rows(Protocol):
    """The attributes of a `VectorEnv` that this module uses."""

    batches: tuple[Batch, ...]
    halves: tuple[slice, ...]
    num_envs: int

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each row; None without a render mode."""
        ...


def get(envs: Rows, name: str) -> list[object]:
    """An attribute of each row.

    Raises:
      AttributeError: rows have no such attribute; the message suggests the nearest name.
    """
    if name in _COMMON:
        return [getattr(envs, _COMMON[name])] * envs.num_envs
    return [value for batch in _batches(envs) for value in _of_batch(batch, name)]


def has(envs: Rows, name: str) -> bool:
    """Whether `get` returns the attribute."""
    return name in _COMMON or all(_knows(batch, name) for batch in _batches(envs))


def are_environments(envs: Rows) -> bool:
    """Whether the rows are complete environments; otherwise they share a task."""
    return all(_is_of_environments(batch) for batch in _batches(envs))


def set_values(envs: Rows, name: str, values: object) -> None:
    """Set an attribute of rows to a value, or to the items of a list or tuple, one for each row.

    A setting of a vectorised task must be equal in all rows, of the same kind as before, and leave
    the specs of observations and actions as they are.

    Raises:
      AttributeError: rows have no such attribute, or it cannot be set.
      ValueError: there are not as many values as rows, or a setting differs between rows,
        changes the specs or makes rows differ from single environments; nothing was set.
      TypeError: a value is of another kind than before; nothing was set.
    """
    given = list(values) if isinstance(values, list | tuple) else [values] * envs.num_envs
    if len(given) != envs.num_envs:
        raise ValueError(
            f"there are {len(given)} values of {name!r}; expected {envs.num_envs}: one for each "
            "row, or a single value that is not a list or tuple"
        )
    if name in _COMMON:
        raise AttributeError(
            f"all rows share the attribute {name!r}: give it where the environment is made"
        )
    if any(isinstance(batch, ManyTasks) for batch in envs.batches):
        raise AttributeError(
            f"{name!r} cannot be set in rows of several tasks: set it in the batch of its task, in "
            "envs.batches[0].parts"
        )
    parts = [given[rows] for rows in envs.halves]
    if not are_environments(envs):
        _set_in_tasks(cast(Sequence[BatchEnvironment], envs.batches), name, parts)
        return
    for batch, part in zip(cast(Sequence[RowsEnvironment], envs.batches), parts, strict=True):
        # Copies, since rows must not share an array.
        batch.set_attr(name, [copy.deepcopy(value) for value in part])


def call(envs: Rows, name: str, args: _Args, kwargs: _Kwargs, rows: Sequence[int]) -> list[object]:
    """The results of a method of some rows; the values of an attribute, as in Gymnasium.

    Raises:
      AttributeError: rows have neither such a method nor such an attribute.
    """
    if name == "render":
        pictures = envs.render(*args, **kwargs) or [None] * envs.num_envs
        return [pictures[row] for row in rows]
    if name == "has_wrapper_attr":
        return [has(envs, *args, **kwargs)] * len(rows)
    if name == "get_wrapper_attr":
        found = get(envs, *args, **kwargs)
        return [found[row] for row in rows]
    if name in _COMMON:
        found = get(envs, name)
    else:
        found = [one for batch in _batches(envs) for one in _methods_of(batch, name)]
    chosen = [found[row] for row in rows]
    return [one(*args, **kwargs) if callable(one) else one for one in chosen]


# Any: of a class of the user.
def _methods_of(batch: Batch, name: str) -> list[Any]:
    """A method of each row of one batch, or the values of an attribute."""
    if _is_of_environments(batch):
        return batch.get_attr(name)
    if name == "snapshot":
        return [functools.partial(batch.snapshot, [row]) for row in range(batch.num_envs)]
    if name in ("control_timestep", "action_spec"):
        of_all = batch.control_timestep if name == "control_timestep" else batch.single_action_spec
        return [of_all] * batch.num_envs
    if _knows(batch, name):
        return _of_batch(batch, name)
    known = [*_METHODS, *_names(batch)]
    raise AttributeError(
        f"the rows of a batch have no method {name!r}.{did_you_mean(name, known)} Their methods "
        f"are {', '.join(_METHODS)}; call those of the batch on `batches`. {_WAY_OUT}"
    )


def _set_in_tasks(
    batches: Sequence[BatchEnvironment], name: str, parts: Sequence[Sequence[object]]
) -> None:
    """Sets an attribute of the tasks of vectorised batches, given a value for each row."""
    tasks = [_task(batch) for batch in batches]
    # A setting must be equal in all rows, also between the halves.
    given = [value for part in parts for value in part]
    new = [
        _rows_of_memory(task, name, part) if name in _memory(task) else _setting(task, name, given)
        for task, part in zip(tasks, parts, strict=True)
    ]
    specs = [_specs(batch) for batch in batches]
    kept = [dict(vars(task)) for task in tasks]
    try:
        for task, value in zip(tasks, new, strict=True):
            setattr(task, name, copy.copy(value))
        if not _are_kept(batches, specs):
            raise ValueError(
                f"{name!r} of the task cannot be {given[0]!r} here: that changes the observations "
                "or actions; make another environment, with this value in task_kwargs"
            )
        batches[0].check_task()
    except BaseException:
        for task, attributes in zip(tasks, kept, strict=True):
            vars(task).clear()
            vars(task).update(attributes)
        raise
    if name in _memory(tasks[0]):
        for batch in batches:
            batch.keep_as_first(name)


def _batches(envs: Rows) -> list[Batch]:
    """The batches of one task each."""
    return [
        part
        for batch in envs.batches
        for part in (batch.parts if isinstance(batch, ManyTasks) else (batch,))
    ]


def _is_of_environments(batch: Batch) -> TypeGuard[RowsEnvironment]:
    return hasattr(batch, "environments")


def _of_batch(batch: Batch, name: str) -> list[object]:
    """An attribute of each row of one batch."""
    if _is_of_environments(batch):
        return batch.get_attr(name)
    count = batch.num_envs
    if name in ("reward_terms", "randomization"):
        by_name: Mapping[str, np.ndarray] = getattr(batch, name)
        copies = {key: np.broadcast_to(v, (count, *np.shape(v)[1:])) for key, v in by_name.items()}
        return [{key: v[row].copy() for key, v in copies.items()} for row in range(count)]
    if name in ("success", "timed_out"):
        values = getattr(batch, name)
        return [None] * count if values is None else list(values.tolist())
    if name == "is_running":
        return list((~batch.begins).tolist())
    if name == "step_limit":
        limit = batch.step_limit
        return [math.ceil(limit) if math.isfinite(limit) else None] * count
    if name == "world":
        return [copy.deepcopy(getattr(batch, name)) for _ in range(count)]
    if name in _OF_BATCH:
        return [getattr(batch, name)] * count
    task = _task(batch)
    if name in _memory(task):
        return list(np.array(getattr(task, name)))
    if not _is_setting(task, name):
        raise AttributeError(
            f"the rows of a batch have no attribute {name!r}."
            f"{did_you_mean(name, [*_COMMON, *_names(batch)])} They have "
            f"{', '.join([*_COMMON, *_OF_BATCH])} and the settings of the task "
            f"{type(task).__name__}. {_WAY_OUT}"
        )
    value = getattr(task, name)
    return [copy.copy(value) for _ in range(count)]


def _knows(batch: Batch, name: str) -> bool:
    try:
        _of_batch(batch, name)
    except AttributeError:
        return False
    return True


def _names(batch: Batch) -> list[str]:
    """The names of attributes of a vectorised batch's rows."""
    task = _task(batch)
    return [*_OF_BATCH, *_memory(task), *_setting_names(task)]


def _task(batch: Batch) -> object:
    """The one task of a vectorised batch."""
    return batch.task  # pyright: ignore[reportAttributeAccessIssue]


def _memory(task: object) -> tuple[str, ...]:
    """Attributes of the task that have a value for each row."""
    return tuple(getattr(task, "EPISODE_ATTRIBUTES", ()))


def _is_setting(task: object, name: str) -> bool:
    """Whether a task has a plain value of this name that is the same for all rows."""
    is_fixed = name.startswith("__") or name.isupper() or name in _MACHINERY
    return not is_fixed and hasattr(task, name) and isinstance(getattr(task, name), _SETTINGS)


def _setting_names(task: object) -> list[str]:
    return [name for name in vars(task) if _is_setting(task, name)]


def _setting(task: object, name: str, values: Sequence[object]) -> object:
    """The new value of a task's setting, which all rows must have in common."""
    on_class = getattr(type(task), name, None)
    is_fixed = isinstance(on_class, property) and on_class.fset is None
    if is_fixed or not _is_setting(task, name):
        known = _setting_names(task)
        raise AttributeError(
            f"the task {type(task).__name__} has no setting {name!r} that can be changed."
            f"{did_you_mean(name, known)} It has: {', '.join(known) or 'none'}. {_WAY_OUT}"
        )
    first, old = values[0], getattr(task, name)
    if not all(_is_equal(value, first) for value in values[1:]):
        raise ValueError(
            f"{name!r} differs between rows, and the rows of a vectorised batch share their task: "
            f"give one value for all. {_WAY_OUT}"
        )
    return _of_kind(name, first, old)


def _rows_of_memory(task: object, name: str, values: Sequence[object]) -> np.ndarray:
    """The values of rows of an attribute that the task declares in EPISODE_ATTRIBUTES."""
    old = np.asarray(getattr(task, name))
    new = [_of_kind(name, value, old[row]) for row, value in enumerate(values)]
    return np.array(new, old.dtype)


def _of_kind(name: str, value: object, old: object) -> object:
    """The value, checked to be of the kind of the old one."""
    if isinstance(old, np.ndarray):
        given = np.asarray(value)
        if given.shape == old.shape and np.can_cast(given.dtype, old.dtype, "same_kind"):
            return np.array(given, old.dtype)
        raise TypeError(
            f"{name!r} is {value!r}; expected an array of shape {old.shape} and dtype {old.dtype}, "
            "as it is now; nothing was set"
        )
    both = old, value
    are_bools = [isinstance(one, bool | np.bool_) for one in both]
    are_numbers = [isinstance(one, _NUMBERS) for one in both]
    if old is None or all(are_bools) or (all(are_numbers) and not any(are_bools)):
        is_of_kind = isinstance(value, _SETTINGS)
    else:
        is_of_kind = isinstance(value, type(old)) and not any(are_numbers)
    if not is_of_kind:
        raise TypeError(
            f"{name!r} is {value!r}; expected a value like {old!r}, as it is now; nothing was set"
        )
    return value


def _is_equal(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray):
        return np.array_equal(one, np.asarray(other))
    return one is other or (not isinstance(other, np.ndarray) and bool(one == other))


def _are_kept(batches: Sequence[Batch], specs: list[list[object]]) -> bool:
    """Whether the specs of batches are still these."""
    try:
        return [_specs(batch) for batch in batches] == specs
    except ValueError:  # a batch refuses an observation of another form itself
        return False


def _specs(batch: Batch) -> list[object]:
    """The shapes and types of a batch's observations and actions."""
    spec = batch.single_action_spec()
    shapes = [(name, one.shape, one.dtype) for name, one in batch.observation_spec().items()]
    bounds = np.asarray(spec.minimum).tolist(), np.asarray(spec.maximum).tolist()
    return [shapes, spec.shape, spec.dtype, bounds]
