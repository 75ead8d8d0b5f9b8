"""`action_spec`: a model's actuator controls as a dm_env spec."""

from typing import Any

import mujoco
import numpy as np
from dm_env import specs

__all__ = ["action_spec"]


def action_spec(physics: Any) -> specs.BoundedArray:  # of any domain's own class
    """Spec of the controls, (nu,); an unlimited control is bounded by MuJoCo's maximum value."""
    model = physics.model._model
    limited = model.actuator_ctrllimited.ravel().astype(bool)[:, None]
    bounds = np.where(limited, model.actuator_ctrlrange, [-mujoco.mjMAXVAL, mujoco.mjMAXVAL])
    return specs.BoundedArray(
        shape=(model.nu,), dtype=float, minimum=bounds[:, 0], maximum=bounds[:, 1]
    )
