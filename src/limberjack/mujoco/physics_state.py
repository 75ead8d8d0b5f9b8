"""`get_state` and `set_state`: the state of a `Physics` as one array; both become its methods.

    state = physics.get_state()
    physics.set_state(state)

The state of a batch has a leading batch axis.
"""

from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.simulation import checked_signature

__all__ = ["get_state", "set_state"]


def get_state(physics: Any, sig: int | None = None) -> np.ndarray:  # of any domain's own class
    """The state as one array, (..., size).

    Args:
      physics: a `Physics` (Any, because its module imports this one).
      sig: the components to include, as `mujoco.mjtState` bits. The default is dm_control's state:
        positions, velocities, activations and plugin states. It lacks the solver's warm start;
        `mjSTATE_INTEGRATION` is everything a step depends on.

    Raises:
      ValueError, TypeError: `sig` has other bits, or is not a whole number.
    """
    if sig is None:
        return np.concatenate(physics._physics_state_items(), axis=-1)
    return physics.simulation.get_state(checked_signature(sig))


# Any: of any domain's own class.
def set_state(physics: Any, physics_state: np.ndarray, sig: int | None = None) -> None:
    """Sets the state to an array from `get_state(sig)`; does not recompute derived quantities.

    Args:
      physics: a `Physics`.
      physics_state: (..., size).
      sig: as for `get_state`.

    Raises:
      ValueError, TypeError: the array has another shape, or see `get_state`; nothing is changed.
    """
    if sig is not None:
        sig = checked_signature(sig)
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
