"""Costs of turning something: finger spin and fish upright.

Beside the missing reward, each has the turn that is left, or the speed that is missing.
"""

from typing import ClassVar

import numpy as np

from limberjack.planner.cost import AnyPhysics, Cost
from limberjack.planner.optimisers.icem import ICEM
from limberjack.planner.settings import Settings
from limberjack.utils import arrays

__all__ = ["FishUpright", "Spin"]


class Spin(Cost):
    """The missing speed of the body, and the distance of the finger from the body."""

    # Of tuning seeds 1000 and 1001 spin has 440 and 413 with iCEM, 373 and 367 with MPPI.
    settings = Settings(
        horizon=0.8,
        knots=16,
        samples=64,
        gain=2.0,
        damping=0.05,
        noise=1.5,
        optimiser=ICEM(colour=0.0),
    )
    weights: ClassVar = {"speed": 2.0, "finger": 0.5}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """The body is to turn at 15 rad/s, in the negative direction."""
        data = physics.named.data
        return {
            "speed": np.maximum(16.0 + physics.hinge_velocity(), 0.0) / 16.0,
            "finger": arrays.norm(data.geom_xpos["fingertip"] - data.xpos["spinner"]),
            "reward": 1.0 - self.task.get_reward(physics),
        }


class FishUpright(Cost):
    """The torso's tilt, and its turning where it is upright."""

    settings = Settings(horizon=1.0, knots=8, samples=48, interval=2, noise=0.8)
    weights: ClassVar = {"tilt": 1.0, "motion": 0.02}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """A fish upside down costs 1."""
        tilt = (1.0 - physics.upright()) / 2
        turning = (physics.torso_velocity()[..., 3:] ** 2).sum(axis=-1)
        return {
            "tilt": tilt,
            "motion": np.exp(-20.0 * tilt) * turning,
            "reward": 1.0 - self.task.get_reward(physics),
        }
