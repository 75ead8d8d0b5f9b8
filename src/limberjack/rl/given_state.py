"""Checks of the states that a caller gives for the start of an episode, before anything changes.

    sizes = state_sizes(env.physics)                        # {'qpos': 28, 'qvel': 27}
    given = checked_state({"qpos": positions}, sizes)       # arrays of float64, copies
    given = checked_states({"qpos": positions}, sizes, num_rows=256)    # (256, 28)

A state is a mapping with some of 'qpos', 'qvel' and 'act', or a `Snapshot` of an episode that is
still running. `set_state` of an environment and `set_states` of a batch set it.
"""

from collections.abc import Mapping

import numpy as np

from limberjack.rl.snapshot import Snapshot
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "check_snapshot",
    "checked_state",
    "checked_states",
    "state_sizes",
]

_SIZES = {"qpos": "nq", "qvel": "nv", "act": "na"}  # fields of the data, and of the model
_MAX_VALUE = 1e10  # mjMAXVAL: MuJoCo replaces a state with larger values by the default state


def state_sizes(physics: object) -> dict[str, int]:
    """Numbers in each field of the state by name, in MuJoCo's order, without empty fields.

    Raises:
      TypeError: the physics is not a simulation of MuJoCo.
    """
    model = getattr(physics, "model", None)
    if not all(hasattr(model, size) for size in _SIZES.values()):
        raise TypeError(
            f"a {type(physics).__name__} has no positions and velocities to set; a given state "
            "needs a limberjack.mujoco.Physics"
        )
    sizes = {name: int(getattr(model, size)) for name, size in _SIZES.items()}
    return {name: size for name, size in sizes.items() if size}


def checked_state(
    state: object, sizes: Mapping[str, int], what: str = "state"
) -> dict[str, np.ndarray]:
    """Copies of the fields of one simulation's state, (size,) float64 each.

    Args:
      state: a mapping with some of the names of `sizes`.
      sizes: the result of `state_sizes`.
      what: the state in messages.

    Raises:
      TypeError: it is not a mapping, has another name, or values are not numbers.
      ValueError: it is empty, or values have another shape, or are not finite or too large.
    """
    arrays = _arrays(state, sizes, (), what)
    for name, values in arrays.items():
        bad = _bad(values)
        if bad.any():
            raise ValueError(
                f"{name!r} of the {what} is {values[bad][0]} at index {np.flatnonzero(bad)[0]}; "
                f"{_EXPECTED}"
            )
    return arrays


def checked_states(
    states: object,
    sizes: Mapping[str, int],
    num_rows: int,
    rows: np.ndarray | None = None,
    named: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Copies of the fields of the states of rows, (n, size) float64 each.

    Args:
      states: a mapping with some of the names of `sizes`, to arrays of (num_rows, size).
      sizes: the result of `state_sizes`.
      num_rows: number of rows of the arrays.
      rows: the numbers of the rows to take, (n,); the values of others are not checked. None for
        all.
      named: the numbers of all rows in messages, (num_rows,); None for 0, 1, ...

    Raises:
      TypeError, ValueError: see `checked_state`; messages name the rows.
    """
    taken = np.arange(num_rows) if rows is None else rows
    arrays = _arrays(states, sizes, (num_rows,), "state")
    arrays = {name: values[taken] for name, values in arrays.items()}
    for name, values in arrays.items():
        bad = taken[_bad(values).any(axis=-1)]
        if bad.size:
            numbers = (bad if named is None else named[bad]).tolist()
            raise ValueError(f"{name!r} of the state is invalid in rows {numbers}; {_EXPECTED}")
    return arrays


def check_snapshot(
    snapshot: Snapshot,
    own: Snapshot,
    size: int,
    sizes: Mapping[str, int],
    step_limit: float,
    named: np.ndarray | None = None,
) -> None:
    """Raise unless running episodes can continue from a snapshot.

    Args:
      snapshot: the snapshot that is given.
      own: a snapshot of the environment or batch to restore it into, of any number of rows.
      size: number of environments that the snapshot must hold.
      sizes: the result of `state_sizes`.
      step_limit: steps per episode.
      named: the numbers of the rows in messages, (size,); None for one environment.

    Raises:
      ValueError: the task, model, version, size or an array differs; or an episode has ended, has
        diverged, or has reached the step limit.
    """
    snapshot.check_all(own, size, step_limit)
    if snapshot.begins.any():
        raise ValueError(
            f"the snapshot holds no running episode in {_where(snapshot.begins, named)}: take it "
            "after reset() and before the last step; nothing was reset"
        )
    if snapshot.copies:
        return
    # MuJoCo's state begins with the time, then the positions, velocities and activations.
    bad = _bad(snapshot.physics["state"][:, 1 : 1 + sum(sizes.values())]).any(axis=-1)
    if bad.any():
        raise ValueError(
            f"the state of the snapshot has diverged in {_where(np.asarray(bad), named)}: take it "
            "before that; nothing was reset"
        )


_EXPECTED = f"expected finite numbers from -{_MAX_VALUE:g} to {_MAX_VALUE:g}; nothing was reset"


def _arrays(
    state: object, sizes: Mapping[str, int], leading: tuple[int, ...], what: str
) -> dict[str, np.ndarray]:
    """The fields of a state as new arrays of the right shape, whatever their values."""
    if not isinstance(state, Mapping):
        raise TypeError(
            f"the {what} is {state!r}; expected a mapping such as {{'qpos': ..., 'qvel': ...}}, or "
            "a Snapshot; nothing was reset"
        )
    for name in state:
        if name not in sizes:
            raise TypeError(
                f"the {what} has no field {name!r}.{did_you_mean(name, sizes)} There are: "
                f"{', '.join(sizes)}; nothing was reset."
            )
    if not state:
        raise ValueError(
            f"the {what} is empty; expected some of: {', '.join(sizes)}; nothing was reset"
        )
    return {name: _array(name, state[name], (*leading, sizes[name]), what) for name in state}


def _array(name: str, value: object, shape: tuple[int, ...], what: str) -> np.ndarray:
    try:
        given = np.asarray(value)
    except ValueError as error:  # rows of different lengths
        raise ValueError(
            f"{name!r} of the {what} is {value!r}; expected an array of shape {shape}; nothing was "
            "reset"
        ) from error
    if given.dtype.kind not in "fiu":
        raise TypeError(
            f"{name!r} of the {what} has dtype {given.dtype}; expected numbers; nothing was reset"
        )
    if given.shape != shape:
        raise ValueError(
            f"{name!r} of the {what} has shape {given.shape}; expected {shape}; nothing was reset"
        )
    with np.errstate(over="ignore"):  # a larger number than float64 holds becomes infinite
        return given.astype(float)


def _bad(values: np.ndarray) -> np.ndarray:
    """Mask of the values that MuJoCo rejects in a state; NaN is one of them."""
    return ~(abs(values) <= _MAX_VALUE)


def _where(rows: np.ndarray, named: np.ndarray | None) -> str:
    return "it" if named is None else f"its rows {named[rows].tolist()}"
