"""The interface of a simulation, single or batched, that `Physics` is a view of.

    simulation.set_fields({"body_mass": masses})
    simulation.step(5)
    height = simulation.data_field("xpos")[0][..., 3, 2]
    saved = simulation.save(None, ("body_mass",))
    simulation.load(saved)

`SingleSimulation` and `BatchSimulation` implement `Simulation` in full. `Fields` is the part of it
that a `Physics` needs for being read; recorded states implement that alone.

Arrays have a leading axis of simulations in a batch. `rows` are sorted row numbers, None for all; a
single simulation is one row. A simulation knows nothing of names, tasks or rendering.

Calls are remembered, so that a saved simulation shows after loading what it showed when it was
saved: what depends on accelerations belongs to the last time step, not to the state that it led to.
"""

import operator
from collections.abc import Mapping, Sequence
from typing import Protocol

import mujoco
import numpy as np

from limberjack.mujoco.index import Axes, FieldIndexer
from limberjack.mujoco.leaving import Busy
from limberjack.mujoco.wrapper.core import MjModel
from limberjack.utils.arrays import AnyArray
from limberjack.utils.log import log

__all__ = [
    "ACTUATION",
    "FORWARD",
    "LOAD",
    "NOT_FIELDS",
    "START",
    "STATE",
    "CountsWarnings",
    "Field",
    "Fields",
    "Rows",
    "Simulation",
    "described",
    "is_bad_state",
    "read_field",
]

STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value  # what a time step depends on
ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION.value

# The last call of a simulation: a number of steps (`step`), a negative number of them
# (`step_whole`), or one of these.
START = 0  # `forward_without_actuation`
LOAD = np.iinfo(np.int64).max  # `load` of a state alone
FORWARD = np.iinfo(np.int64).min  # `forward`

# What `save` gives beside the fields of the model.
NOT_FIELDS = ("state", "sensordata", "before", "call")

Rows = np.ndarray | None
Field = tuple[AnyArray, bool]  # and whether it has an axis of simulations


class Fields(Protocol):
    """Live arrays of MuJoCo's structs by name, of one simulation or of many."""

    # None for a single simulation, whose arrays have no leading axis.
    num_envs: int | None

    @property
    def model(self) -> MjModel:
        """The model, or the one that the simulations have in common."""
        ...

    def data_field(self, name: str) -> Field:
        """A field of MjData, and whether it has an axis of simulations."""
        ...

    def model_field(self, name: str) -> Field:
        """A field of MjModel, and whether each simulation has values of its own."""
        ...

    def field_for_names(self, name: str) -> Field:
        """As `data_field`, of a field that nothing but its `indexer` reads."""
        ...

    def indexer(self, name: str, field: AnyArray, axes: Axes, batch: bool) -> FieldIndexer:
        """What such a field is indexed by names with; arguments as `FieldIndexer`'s."""
        ...


class Simulation(Fields, Protocol):
    """MuJoCo's part of a `Physics`; see the module's docstring."""

    # Whether constants of the model follow from the fields that episodes set: MuJoCo's mj_setConst.
    sets_constants: bool
    # The actuators' controls, (..., nu), live.
    ctrl: np.ndarray
    # MuJoCo's warnings by kind, (..., 7), live.
    warnings: np.ndarray

    def step(self, nstep: int, rows: Rows = None) -> None:
        """Advances by time steps; positions and velocities are up to date afterwards.

        It finishes the step whose first half ran last and ends with the first half of the next,
        so that everything that depends on positions and velocities belongs to the new state.
        """
        ...

    def step_whole(self, nstep: int, rows: Rows = None) -> None:
        """Advances by whole time steps; quantities belong to the state before the last one."""
        ...

    def forward(self, rows: Rows = None) -> None:
        """Recomputes every quantity from the state and the controls."""
        ...

    def forward_without_actuation(self, rows: Rows = None) -> None:
        """Recomputes every quantity as if there were no actuators, as an episode begins."""
        ...

    def reset(self, keyframe: int | None = None, rows: Rows = None) -> None:
        """Returns to the model's default state or to a keyframe, without a forward pass."""
        ...

    def get_state(self, signature: int) -> np.ndarray:
        """Parts of the state, (..., size), as `mujoco.mjtState` bits."""
        ...

    def set_state(self, state: np.ndarray, signature: int) -> None:
        """Sets those parts; no quantity follows."""
        ...

    def set_fields(self, values: Mapping[str, np.ndarray], row: int | None = None) -> None:
        """Sets fields of the model, of one row in a batch, and the constants that follow."""
        ...

    def save(self, rows: Rows, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """All that the future and the present quantities depend on, (n, ...) each.

        Args:
          rows: of a batch.
          fields: of the model, to be saved too.
        """
        ...

    def load(self, saved: Mapping[str, np.ndarray], rows: Rows = None) -> None:
        """Sets what `save` gave; without its call, quantities that follow from the state follow."""
        ...

    def set_warnings_aside(self) -> np.ndarray | None:
        """Clears the counters of warnings; returns what they were, None for none."""
        ...

    def has_warned(self) -> bool:
        """Whether any warning is counted."""
        ...

    def new_warnings(self, earlier: np.ndarray | None) -> np.ndarray | None:
        """Which kinds of warnings came since they were set aside, (..., 7); None for none."""
        ...


class CountsWarnings(Busy):
    """The part of a simulation that tells new warnings from earlier ones.

    A simulation that diverges is reset by MuJoCo, counters included, so that one that has counted
    before would show the same number: earlier counts are set aside around each call.
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


def is_bad_state(model: mujoco.MjModel, state: np.ndarray) -> np.ndarray:
    """Which states MuJoCo would replace by the default pose at the next step, (..., nstate).

    Positions or velocities are NaN or beyond `mujoco.mjMAXVAL`: see mj_checkPos and mj_checkVel.
    """
    moving = state[..., 1 : 1 + model.nq + model.nv]  # behind the time
    return ~(abs(moving) <= mujoco.mjMAXVAL).all(axis=-1)


def described(warnings: np.ndarray) -> str:
    """The kinds of warnings that are set, (..., 7) booleans, and of a batch the rows."""
    kinds = np.count_nonzero(warnings.reshape(-1, warnings.shape[-1]), axis=0).tolist()
    members = zip(mujoco.mjtWarning.__members__, kinds, strict=False)
    names = ", ".join(name for name, count in members if count)
    if warnings.ndim == 1:
        return names
    return f"{names} in rows {np.flatnonzero(warnings.any(axis=-1)).tolist()}"


def read_field(model: mujoco.MjModel, name: str) -> AnyArray:
    """A field of a model, or of its options as 'opt.gravity'."""
    return operator.attrgetter(name)(model)


def _log_warning(message: str | bytes) -> None:
    """Takes MuJoCo's warnings to Python's logging."""
    log.warning("%s", message.decode() if isinstance(message, bytes) else message)


# Without a handler MuJoCo prints its warnings and writes MUJOCO_LOG.TXT in the working directory.
if mujoco.get_mju_user_warning() is None:
    mujoco.set_mju_user_warning(_log_warning)
