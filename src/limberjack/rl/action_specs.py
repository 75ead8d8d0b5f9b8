"""`bounded_spec`: the action spec for agents, checked against the actions the task accepts.

    spec = bounded_spec(task, physics)  # a dm_env.specs.BoundedArray

A task's `before_step` may map actions to actuators in any way, while learners, batches and random
policies rely on `action_spec`. A task that overrides `before_step` but not `action_spec` is tested
once on a copy of the physics.

The other functions check actions before a step, which must be finite numbers; the task checks their
shape.
"""

import copy
import functools
import inspect
import math
import reprlib
from collections.abc import Callable
from typing import Any

import dm_env
import numpy as np
from dm_env import specs

from limberjack.rl.contract import Physics, Task
from limberjack.rl.copies import difference
from limberjack.rl.shared_streams import put_back_after

__all__ = [
    "as_numbers",
    "bounded_spec",
    "bounds_to_try",
    "check_finite",
    "in_shape",
    "not_finite",
    "open_bounds",
    "spec_of",
]

_LONGEST_DELAY = 20  # calls after which an action that waits in a queue reaches the actuators
_WIDEST = 1e9  # larger bounds mean 'unlimited': MuJoCo's own limit is 1e10


def bounded_spec(task: Task, physics: Physics) -> specs.BoundedArray:
    """The task's action spec, checked to be usable by an agent.

    Raises:
      TypeError: the spec is not a single bounded array.
      ValueError: the task maps actions itself but inherits the spec, and does not accept actions of
        that spec or ignores some of their elements.
    """
    name = type(task).__name__
    spec = _bounded(task.action_spec(physics), f"task {name}")
    if _maps_actions(task):
        with put_back_after():
            problem = _problem(spec, _effect(task, physics))
        if problem:
            raise ValueError(
                f"task {name} defines before_step but not action_spec, and {problem}; define "
                "action_spec(self, physics) to return a BoundedArray for the actions of before_step"
            )
    return spec


def spec_of(env: dm_env.Environment) -> specs.BoundedArray:
    """The spec of the actions of an environment of any class, checked as by `bounded_spec`.

    Raises:
      TypeError, ValueError: see `bounded_spec`.
    """
    if difference(env) is None:
        plain: Any = env  # a `control.Environment`, whose module imports this one
        return bounded_spec(plain.task, plain.physics)
    return _bounded(env.action_spec(), type(env).__name__)


def _bounded(spec: object, owner: str) -> specs.BoundedArray:
    """The spec, if agents can use it."""
    if not isinstance(spec, specs.BoundedArray):
        raise TypeError(
            f"action_spec of {owner} is {spec!r}; expected a dm_env.specs.BoundedArray, which "
            "batches, Gymnasium and the policies 'random' and 'zero' rely on"
        )
    return spec


def open_bounds(spec: specs.BoundedArray) -> tuple[np.ndarray, np.ndarray]:
    """The bounds of the spec, infinite where it is unlimited."""
    low, high = (np.broadcast_to(bound, spec.shape) for bound in (spec.minimum, spec.maximum))
    return np.where(low > -_WIDEST, low, -np.inf), np.where(high < _WIDEST, high, np.inf)


def bounds_to_try(spec: specs.BoundedArray, bound: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Bounds for random actions: those of the spec, or +-`bound` where it is unlimited."""
    low, high = open_bounds(spec)
    has_low, has_high = np.isfinite(low), np.isfinite(high)
    lower = np.where(has_low, low, np.minimum(-bound, np.where(has_high, high - 2 * bound, -bound)))
    return lower, np.where(has_high, high, np.maximum(bound, lower + 2 * bound))


def _maps_actions(task: Task) -> bool:
    """Whether `before_step` is defined by a more derived class than `action_spec`."""
    if "action_spec" in vars(task):
        return False
    if "before_step" in vars(task):
        return True
    classes = inspect.getmro(type(task))
    first = {
        name: next(i for i, one in enumerate(classes) if name in vars(one))
        for name in ("before_step", "action_spec")
    }
    return first["before_step"] < first["action_spec"]


def _problem(spec: specs.BoundedArray, effect: Callable[[np.ndarray, int], bytes]) -> str | None:
    """The problem with actions of the spec, as part of a sentence; None if there is none."""
    low, high = bounds_to_try(spec)
    action = (0.6 * low + 0.4 * high).astype(spec.dtype)
    shape = f"an action of the inherited spec, {spec.shape},"
    try:
        before = functools.cache(functools.partial(effect, action))
        for index in np.ndindex(spec.shape):
            others = [_with(action, index, bound[index]) for bound in (low, high)]
            if not any(
                effect(other, calls) != before(calls)
                for calls in (1, _LONGEST_DELAY)
                for other in others
            ):
                return f"{shape} is not what it takes: number {list(index)} of it has no effect"
    except (AttributeError, NameError):  # a mistake of another kind, such as a misspelled name
        raise
    except Exception as error:  # a task may raise anything for an action that it does not accept
        return f"{shape} makes before_step raise {type(error).__name__}: {error}"
    return None


def _with(action: np.ndarray, index: tuple[int, ...], value: object) -> np.ndarray:
    changed = action.copy()
    changed[index] = value
    return changed


def _effect(task: Task, physics: Physics) -> Callable[[np.ndarray, int], bytes]:
    """A function from an action to the state after calls of `before_step` at an episode's start."""
    trial = copy.deepcopy(physics)
    begun = copy.deepcopy(task)
    begun._random = np.random.RandomState(0)
    with trial.reset_context():
        begun.initialize_episode(trial)
    simulation = getattr(trial, "simulation", None)
    saved = None if simulation is None else simulation.save(None, ())

    def effect(action: np.ndarray, calls: int) -> bytes:
        if simulation is None:  # states cannot be compared, so only errors are detected
            copy.deepcopy(begun).before_step(action, copy.deepcopy(trial))
            return action.tobytes()
        simulation.load(saved)
        stepped = copy.deepcopy(begun)
        for _ in range(calls):
            stepped.before_step(action.copy(), trial)
        return simulation.save(None, ())["state"].tobytes()

    return effect


_BYTES = np.dtype(np.float64).itemsize


def as_numbers(action: object) -> np.ndarray:
    """An action, or the actions of many environments, as a numeric array.

    Types wider than MuJoCo's float64 become float64, in which their largest values are infinite;
    others keep their type, since they convert without loss or overflow.

    Raises:
      TypeError: the actions are not real numbers, or Python integers beyond 64 bits.
      ValueError: the rows have different lengths, or an integer is beyond the range of float64.
    """
    try:
        given = np.asarray(action)
    except ValueError as error:
        raise ValueError(f"action is {action!r}; expected an array of numbers") from error
    except OverflowError as error:
        raise ValueError(
            f"action is {reprlib.repr(action)}; expected numbers within the range of float64; "
            "nothing was stepped"
        ) from error
    if given.dtype.kind not in "fiub":
        raise TypeError(
            f"action has dtype {given.dtype}; expected numbers: {reprlib.repr(action)}; nothing "
            "was stepped"
        )
    if given.dtype.itemsize <= _BYTES:
        return given
    with np.errstate(all="ignore"):  # overflow: the result is checked instead
        return given.astype(np.float64)


def in_shape(given: np.ndarray, shape: tuple[int, ...], num_rows: int = 1) -> np.ndarray:
    """The numbers in the shape of their spec; one for one actuator of each row may have any shape.

    Raises:
      ValueError: they have another shape.
    """
    if given.size == math.prod(shape) == num_rows:
        return given.reshape(shape)
    if given.shape != shape:
        raise ValueError(
            f"action has shape {given.shape}; expected {shape}, one number for each actuator; "
            "nothing was stepped"
        )
    return given


def check_finite(given: np.ndarray) -> None:
    """Raises ValueError if an action contains NaN or infinity."""
    bad = not_finite(given)
    if bad is not None:
        where = np.argwhere(bad)
        index = where.ravel() if bad.ndim == 1 else where
        raise ValueError(
            f"action is not finite at index {index.tolist()}: {given}; nothing was stepped"
        )


def not_finite(given: np.ndarray) -> np.ndarray | None:
    """Mask of NaN and infinite elements; None if there are none."""
    if given.dtype.kind != "f":
        return None
    finite = np.isfinite(given)
    # Runs at every step; searching the bytes is the fastest check.
    return ~finite if b"\0" in finite.tobytes() else None
