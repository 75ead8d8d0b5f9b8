"""`bounded_spec`: the spec that agents act by, refused where the task takes other actions.

    spec = bounded_spec(task, physics)  # a dm_env.specs.BoundedArray

Actions belong to the task: its `before_step` may map them to the actuators as it likes. Learners,
batches and random policies rely on `action_spec`. A task that overrides the one and not the other
is tried out once on a copy of the physics.
"""

import copy
import inspect
from collections.abc import Callable

import numpy as np
from dm_env import specs

from limberjack.rl.contract import Physics, Task

__all__ = ["bounded_spec", "bounds_to_try"]

_WIDEST = 1e9  # a bound beyond it stands for 'unlimited': MuJoCo's own is 1e10


def bounded_spec(task: Task, physics: Physics) -> specs.BoundedArray:
    """The task's action spec, if an agent can act by it.

    Raises:
      TypeError: it is not one bounded array.
      ValueError: the task maps actions itself and leaves the spec to its base class, but does not
        take an action of that spec, or ignores a number of it.
    """
    spec = task.action_spec(physics)
    name = type(task).__name__
    if not isinstance(spec, specs.BoundedArray):
        raise TypeError(
            f"action_spec of task {name} is {spec!r}; expected a dm_env.specs.BoundedArray, which "
            "batches, Gymnasium and the policies 'random' and 'zero' act by"
        )
    if _maps_actions(task):
        problem = _problem(task, physics, spec)
        if problem:
            raise ValueError(
                f"task {name} defines before_step but not action_spec, and {problem}; define "
                "action_spec(self, physics) as a BoundedArray of the actions that before_step takes"
            )
    return spec


def bounds_to_try(spec: specs.BoundedArray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of actions to try out: the spec's, but -1 and 1 where unlimited."""
    low, high = np.broadcast_to(spec.minimum, spec.shape), np.broadcast_to(spec.maximum, spec.shape)
    has_low, has_high = abs(low) < _WIDEST, abs(high) < _WIDEST
    lower = np.where(has_low, low, np.minimum(-1.0, np.where(has_high, high - 2.0, -1.0)))
    return lower, np.where(has_high, high, np.maximum(1.0, lower + 2.0))


def _maps_actions(task: Task) -> bool:
    """Whether the task's `before_step` is of a later class than its `action_spec`."""
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


def _problem(task: Task, physics: Physics, spec: specs.BoundedArray) -> str | None:
    """What is wrong with an action of the spec, as the middle of a sentence; None for nothing."""
    effect = _effect(task, physics)
    low, high = bounds_to_try(spec)
    action = (0.6 * low + 0.4 * high).astype(spec.dtype)
    shape = f"an action of the inherited spec, {spec.shape},"
    try:
        before = effect(action)
        for index in np.ndindex(spec.shape):
            if all(effect(_with(action, index, bound[index])) == before for bound in (low, high)):
                return f"{shape} is not what it takes: number {list(index)} of it has no effect"
    except Exception as error:  # whatever a task raises for an action that it does not take
        return f"{shape} makes before_step raise {type(error).__name__}: {error}"
    return None


def _with(action: np.ndarray, index: tuple[int, ...], value: object) -> np.ndarray:
    changed = action.copy()
    changed[index] = value
    return changed


def _effect(task: Task, physics: Physics) -> Callable[[np.ndarray], bytes]:
    """A function from an action to the state that `before_step` leaves at an episode's start."""
    trial = copy.deepcopy(physics)
    begun = copy.deepcopy(task)
    begun._random = np.random.RandomState(0)  # pyright: ignore[reportAttributeAccessIssue]
    with trial.reset_context():
        begun.initialize_episode(trial)
    simulation = getattr(trial, "simulation", None)
    saved = None if simulation is None else simulation.save(None, ())

    def effect(action: np.ndarray) -> bytes:
        if simulation is None:  # the state cannot be compared: only errors are found
            copy.deepcopy(begun).before_step(action, copy.deepcopy(trial))
            return action.tobytes()
        simulation.load(saved)
        copy.deepcopy(begun).before_step(action.copy(), trial)
        return simulation.save(None, ())["state"].tobytes()

    return effect
