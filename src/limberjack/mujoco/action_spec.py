"""`action_spec`: the controls of a model's actuators, as dm_env describes actions."""

from typing import Any

import mujoco
import numpy as np
from dm_env import specs

__all__ = ["action_spec"]


def action_spec(physics: Any) -> specs.BoundedArray:
    """The spec of the controls, (nu,); an unlimited one is bounded by MuJoCo's maximum."""
    model = physics.model._model
    limited = model.actuator_ctrllimited.ravel().astype(bool)[:, None]
    bounds = np.where(limited, model.actuator_ctrlrange, [-mujoco.mjMAXVAL, mujoco.mjMAXVAL])
    return specs.BoundedArray(
        shape=(model.nu,), dtype=float, minimum=bounds[:, 0], maximum=bounds[:, 1]
    )
