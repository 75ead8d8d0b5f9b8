"""`Simulation`: the interface of single and batched simulations, on which `Physics` is built.

    simulation.set_fields({"body_mass": masses})
    simulation.step(5)
    height = simulation.data_field("xpos")[0][..., 3, 2]
    saved = simulation.save(None, ("body_mass",))
    simulation.load(saved)

`SingleSimulation` and `BatchSimulation` implement `Simulation` in full. `Fields` is the part that a
`Physics` needs for reading; recorded states implement only that.

Arrays have a leading batch axis in a batch. `rows` are sorted row numbers, None for all; a single
simulation is one row. Names, tasks and rendering are handled elsewhere.

The last `Call` is recorded, so that a simulation has the same quantities after loading as when it
was saved: quantities that depend on accelerations belong to the last time step, not to the state
after it. Only this file and the two implementations know the form of a record: `model_fields` and
`without_calls` serve others.
"""

import enum
import operator
from collections.abc import Mapping, Sequence
from typing import Protocol

import mujoco
import numpy as np

from limberjack.mujoco.wrapper.core import MjModel
from limberjack.utils.log import log
from limberjack.worlds.appearance.looks import Look

__all__ = [
    "ACTUATION",
    "MOST_AT_ONCE",
    "STATE",
    "Call",
    "CountsWarnings",
    "Field",
    "Fields",
    "Rows",
    "Simulation",
    "can_be_repeated",
    "checked_signature",
    "checked_steps",
    "described",
    "is_bad_state",
    "model_fields",
    "read_field",
    "without_calls",
    "write_field",
]

STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value  # everything a time step depends on
ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION.value

MOST_AT_ONCE = 2**31 - 1  # time steps that MuJoCo takes in one call
_STATE_BITS = mujoco.mjtState.mjNSTATE.value
_MOST_STEPS = 100_000  # far more than a control step has

# Keys in the result of `save` other than model fields; the last three record the last call.
_STATES = ("state", "sensordata", "before", "call", "count")

Rows = np.ndarray | None
Field = tuple[np.ndarray, bool]  # an array, and whether it has a leading batch axis


class Call(enum.IntEnum):
    """The kinds of a simulation's last call; a count of time steps, at least 1, goes with it."""

    LOAD = 0  # `load` of a state alone
    START = 1  # `forward_without_actuation`
    FORWARD = 2
    STEP = 3
    STEP_WHOLE = 4


class Fields(Protocol):
    """Live arrays of MuJoCo's structs by name, of one simulation or of many."""

    # None for a single simulation, whose arrays have no leading axis.
    num_envs: int | None

    @property
    def model(self) -> MjModel:
        """The model, which the rows of a batch share."""
        ...

    def data_field(self, name: str) -> Field:
        """A field of MjData, and whether it has a leading batch axis."""
        ...

    def model_field(self, name: str) -> Field:
        """A field of MjModel, and whether it has a leading batch axis."""
        ...


class Simulation(Fields, Protocol):
    """The part of a `Physics` that calls MuJoCo; see the module's docstring."""

    # Whether model constants must be recomputed (mj_setConst) after episodes set fields.
    sets_constants: bool
    # With which a single simulation is drawn; None for the look of the model.
    look: Look | None
    # The actuators' controls, (..., nu), live.
    ctrl: np.ndarray
    # MuJoCo's warning counts by type, (..., 7), live.
    warnings: np.ndarray

    def step(self, nstep: int, rows: Rows = None) -> None:
        """Advances by time steps; quantities of positions and velocities match the new state.

        It completes the step whose first half ran last, and ends with the first half of the next
        step.
        """
        ...

    def step_whole(self, nstep: int, rows: Rows = None) -> None:
        """Advances by whole time steps; quantities belong to the state before the last step."""
        ...

    def forward(self, rows: Rows = None) -> None:
        """Recomputes every quantity from the state and the controls."""
        ...

    def forward_without_actuation(self, rows: Rows = None) -> None:
        """Recomputes every quantity with actuation disabled, for the start of an episode."""
        ...

    def reset(self, keyframe: int | None = None, rows: Rows = None) -> None:
        """Returns to the model's default state or to a keyframe, without a forward pass."""
        ...

    def get_state(self, signature: int) -> np.ndarray:
        """The state components selected by `mujoco.mjtState` bits, (..., size)."""
        ...

    def set_state(self, state: np.ndarray, signature: int) -> None:
        """Sets those components; derived quantities are not recomputed."""
        ...

    def set_fields(self, values: Mapping[str, np.ndarray], row: int | None = None) -> None:
        """Sets model fields, of one row in a batch, and recomputes constants if necessary."""
        ...

    def set_constants(self, rows: Rows = None) -> None:
        """Recomputes constants if necessary: if `sets_constants`; the state is kept."""
        ...

    def save(self, rows: Rows, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """Everything that current quantities and future steps depend on, (n, ...) each.

        Args:
          rows: rows of a batch to save.
          fields: model fields to include.
        """
        ...

    def load(self, saved: Mapping[str, np.ndarray], rows: Rows = None) -> None:
        """Restores the result of `save`; without a recorded call, only state-derived quantities."""
        ...

    def set_warnings_aside(self) -> np.ndarray | None:
        """Clears the warning counts and returns their previous values; None if all were 0."""
        ...

    def has_warned(self) -> bool:
        """Whether any warning count is positive."""
        ...

    def new_warnings(self, earlier: np.ndarray | None) -> np.ndarray | None:
        """Mask of warning types raised since `set_warnings_aside`, (..., 7); None if none were."""
        ...


class CountsWarnings:
    """Detection of new warnings, shared by the implementations of `Simulation`.

    MuJoCo resets a simulation that diverges, including its counters, so comparing counts before and
    after a call can miss a warning. Therefore earlier counts are set aside around each call.
    """

    warnings: np.ndarray
    _no_warnings: bytes

    def set_warnings_aside(self) -> np.ndarray | None:
        """See `Simulation`."""
        if self.warnings.tobytes() == self._no_warnings:
            return None
        earlier = self.warnings.copy()
        self.warnings[...] = 0
        return earlier

    def has_warned(self) -> bool:
        """See `Simulation`."""
        return self.warnings.tobytes() != self._no_warnings

    def new_warnings(self, earlier: np.ndarray | None) -> np.ndarray | None:
        """See `Simulation`."""
        new = self.warnings > 0 if self.has_warned() else None
        if earlier is not None:
            self.warnings += earlier
        return new


def checked_steps(nstep: int) -> int:
    """A number of time steps, at least 1.

    Raises:
      ValueError: it is smaller, or not a whole number.
    """
    is_whole = isinstance(nstep, int | np.integer) and not isinstance(nstep, bool)
    if not is_whole or not 1 <= nstep <= MOST_AT_ONCE:
        raise ValueError(
            f"nstep is {nstep!r}; expected a whole number of time steps, at least 1; nothing was "
            "stepped"
        )
    return int(nstep)


def checked_signature(sig: int) -> int:
    """Bits of `mujoco.mjtState` that select parts of a state.

    Raises:
      TypeError: it is not a whole number.
      ValueError: there are other bits.
    """
    try:
        bits = operator.index(sig)
    except TypeError as error:
        raise TypeError(f"sig is {sig!r}; expected bits of mujoco.mjtState") from error
    if not 0 <= bits < 2**_STATE_BITS:
        raise ValueError(
            f"sig is {sig!r}; expected bits of mujoco.mjtState, 0 to {2**_STATE_BITS - 1}, such as "
            "mujoco.mjtState.mjSTATE_INTEGRATION"
        )
    return bits


def can_be_repeated(call: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Whether recorded calls, one or (n,), lead to a state; a damaged one may never return."""
    takes_steps = (call == Call.STEP) | (call == Call.STEP_WHOLE)
    is_forward = (call == Call.START) | (call == Call.FORWARD)
    return is_forward | (takes_steps & (count >= 1) & (count <= _MOST_STEPS))


def model_fields(saved: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The model fields in the result of `save`."""
    return {name: value for name, value in saved.items() if name not in _STATES}


def without_calls(saved: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The result of `save` as if its state had just been loaded, by no recorded call.

    Args:
      saved: 'state', and any other part of the result of `save`.
    """
    state = saved["state"]
    calls = {"call": np.full(len(state), Call.LOAD), "count": np.ones(len(state), int)}
    return {**saved, "before": state.copy(), **calls}


def is_bad_state(model: mujoco.MjModel, state: np.ndarray) -> np.ndarray:
    """Mask of states, (..., nstate) -> (...), that MuJoCo would replace by the default pose.

    Their positions or velocities are NaN or exceed `mujoco.mjMAXVAL`: see mj_checkPos, mj_checkVel.
    """
    moving = state[..., 1 : 1 + model.nq + model.nv]  # after the time
    return ~(abs(moving) <= mujoco.mjMAXVAL).all(axis=-1)


def described(warnings: np.ndarray) -> str:
    """Text with the warning types set in a mask, (..., 7), and with the rows for a batch."""
    kinds = np.count_nonzero(warnings.reshape(-1, warnings.shape[-1]), axis=0).tolist()
    members = zip(mujoco.mjtWarning.__members__, kinds, strict=False)
    names = ", ".join(name for name, count in members if count)
    if warnings.ndim == 1:
        return names
    return f"{names} in rows {np.flatnonzero(warnings.any(axis=-1)).tolist()}"


def read_field(model: mujoco.MjModel | MjModel, name: str) -> np.ndarray | float:
    """A field of a model, or of its options as 'opt.gravity'."""
    return operator.attrgetter(name)(model)


def write_field(model: mujoco.MjModel | MjModel, name: str, value: np.ndarray) -> None:
    """Sets a field of a model, or of its options as 'opt.gravity'."""
    field = read_field(model, name)
    if isinstance(field, np.ndarray):
        field[...] = value
    else:
        setattr(model.opt, name.removeprefix("opt."), value.item())


def _log_warning(message: str | bytes) -> None:
    """Forwards MuJoCo's warnings to Python's logging."""
    log.warning("%s", message.decode() if isinstance(message, bytes) else message)


# Without a handler, MuJoCo prints warnings and writes MUJOCO_LOG.TXT to the working directory.
if mujoco.get_mju_user_warning() is None:
    mujoco.set_mju_user_warning(_log_warning)
