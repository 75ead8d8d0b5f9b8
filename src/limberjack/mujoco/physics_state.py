"""`get_state` and `set_state`: the state of a `Physics` as one array; both are its methods.

    state = physics.get_state()
    physics.set_state(state)

The state of a batch has a leading axis of simulations.
"""

from typing import Any

import mujoco
import numpy as np

__all__ = ["get_state", "set_state"]


def get_state(physics: Any, sig: int | None = None) -> np.ndarray:
    """The state as one array, (..., size).

    Args:
      physics: a `Physics`, whose module imports this one, hence Any.
      sig: which parts, as `mujoco.mjtState` bits. By default positions, velocities and
        activations, and plugins' states: what dm_control means by state. That misses the solver's
        warm start; `mjSTATE_INTEGRATION` is everything a step depends on.
    """
    if sig is None:
        return np.concatenate(physics._physics_state_items(), axis=-1)
    return physics.simulation.get_state(sig)


def set_state(physics: Any, physics_state: np.ndarray, sig: int | None = None) -> None:
    """Sets the state, an array as returned by `get_state(sig)`; computes nothing.

    Args:
      physics: a `Physics`.
      physics_state: (..., size).
      sig: as for `get_state`.

    Raises:
      ValueError: the array has another shape; nothing is changed.
    """
    state = np.asarray(physics_state, float)
    items: list[np.ndarray] = physics._physics_state_items()
    sizes = [item.shape[-1] for item in items]
    size = sum(sizes) if sig is None else mujoco.mj_stateSize(physics.model._model, sig)
    shape = (*items[0].shape[:-1], size)
    if state.shape != shape:
        raise ValueError(f"Input physics state has shape {state.shape}. Expected {shape}.")
    if sig is not None:
        physics.simulation.set_state(state, sig)
        return
    parts = np.split(state, np.cumsum(sizes)[:-1], axis=-1)
    for item, part in zip(items, parts, strict=True):
        np.copyto(item, part)
