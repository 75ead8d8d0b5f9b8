"""Reward terms that several domains of walking, running and hopping bodies share.

    upright = locomotion.upright(physics.torso_upright(), at_least=0.9)
    moving = locomotion.speed(physics.speed(), at_least=10)

Each is between 0 and 1, (...), and takes quantities of one simulation or of a batch.
`forward_speed` reads the sensor that planar bodies share.
"""

import numpy as np

from limberjack import mujoco
from limberjack.utils import arrays, rewards

__all__ = ["forward_speed", "low_effort", "speed", "upright"]


def forward_speed(physics: mujoco.Physics) -> arrays.Quantity:
    """Velocity of the body's centre of mass along x, (...), metres per second."""
    # `[..., 0]` would give an array, not a number, for one simulation.
    return physics.named.data.sensordata["torso_subtreelinvel"].T[0]


def upright(cosine: arrays.Quantity, at_least: float) -> arrays.Quantity:
    """1 for a cosine of the tilt of `at_least` or more, decreasing linearly to 0 at -1."""
    return rewards.tolerance(
        cosine, (at_least, np.inf), margin=1 + at_least, sigmoid="linear", value_at_margin=0
    )


def speed(
    speed: arrays.Quantity,
    at_least: float,
    margin: float | None = None,
    value_at_margin: float = 0,
) -> arrays.Quantity:
    """1 for a speed of `at_least` or more, decreasing linearly below it.

    Args:
      speed: metres per second, (...).
      at_least: the speed that is fully rewarded, metres per second.
      margin: how far below it the term is `value_at_margin`; by default at standstill.
      value_at_margin: between 0 and 1.
    """
    return rewards.tolerance(
        speed,
        (at_least, np.inf),
        margin=at_least if margin is None else margin,
        sigmoid="linear",
        value_at_margin=value_at_margin,
    )


def low_effort(control: np.ndarray) -> np.ndarray:
    """1 without control, (..., nu) -> (...); full effort of all actuators loses a fifth."""
    mean = rewards.mean_tolerance(control, margin=1, sigmoid="quadratic", value_at_margin=0)
    return (4 + mean) / 5
