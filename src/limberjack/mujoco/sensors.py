"""Which sensors need not be computed until somebody asks for their readings.

Nothing that a simulation does depends on what its sensors of acceleration and force read. The
humanoid has 31 of them, which no task observes and which take 6 % of a step. So a batch leaves them
out until they are asked for, by name or all at once; from then on they are computed at each step,
the last one included, which is repeated. Readings are those that they would always have been.
"""

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np

__all__ = ["FIELDS", "may_rest"]

# What depends on such sensors: their readings, and what MuJoCo computes for some of them only.
FIELDS = ("sensordata", "cacc", "cfrc_int", "cfrc_ext")

_FROM_ACCELERATION = mujoco.mjtStage.mjSTAGE_ACC.value
# They read accelerations and forces and write their readings, nothing else.
_WITHOUT_EFFECT = [
    getattr(mujoco.mjtSensor, f"mjSENS_{name}").value
    for name in (
        *("ACCELEROMETER", "FORCE", "TORQUE", "TOUCH"),
        *("ACTUATORFRC", "JOINTACTFRC", "TENDONACTFRC", "JOINTLIMITFRC", "TENDONLIMITFRC"),
        *("FRAMELINACC", "FRAMEANGACC"),
    )
]


def may_rest(model: Any, own_fields: Iterable[str] = ()) -> np.ndarray:
    """The sensors without which all but `FIELDS` is the same, bit for bit, (nsensor,) booleans.

    Args:
      model: an `mujoco.MjModel`.
      own_fields: of the model, that each simulation has for itself.
    """
    # Plugins and callbacks may read readings; sensors with a delay remember them.
    remembered = model.nhistory or model.sensor_interval.any() or model.sensor_delay.any()
    if model.nplugin or remembered or _any_callback():
        return np.zeros(model.nsensor, bool)
    if any(field.startswith("sensor_") for field in own_fields):
        return np.zeros(model.nsensor, bool)
    late = model.sensor_needstage == _FROM_ACCELERATION
    return late & np.isin(model.sensor_type, _WITHOUT_EFFECT)


def _any_callback() -> bool:
    """Whether physics is extended by functions of the user's."""
    getters = (getattr(mujoco, name) for name in dir(mujoco) if name.startswith("get_mjcb_"))
    return any(get() is not None for get in getters)
