"""Costs of swinging up and balancing: pendulum, cartpole and acrobot.

Beside the missing reward, which is flat far from upright, each has the height or, for the acrobot,
the energy that is still missing and, near the top, the motion that would leave it again.
"""

from typing import ClassVar

import numpy as np

from limberjack.planner.cost import AnyPhysics, Cost
from limberjack.planner.settings import Settings

__all__ = ["Acrobot", "Cartpole", "Pendulum"]

_SPREAD = 2.0  # radians; standard deviation of the pendulum's targets


class Pendulum(Cost):
    """The pole's missing height, and its speed where it is up."""

    settings = Settings(horizon=1.5, knots=8, samples=64, gain=1.0, damping=0.3, noise=_SPREAD)
    weights: ClassVar = {"motion": 0.02}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """Height and reward are about 1 for a pole that hangs; motion counts near the top only."""
        up = physics.pole_vertical()
        speed = physics.angular_velocity()[..., 0]
        return {
            "height": (1.0 - up) / 2,
            "motion": np.exp(-4.0 * (1.0 - up)) * speed**2,
            "reward": 1.0 - self.task.get_reward(physics),
        }

    def proposals(self, physics: AnyPhysics, random: np.random.Generator) -> np.ndarray:
        """Plans around the pole's angle: without limits, targets can drift out of reach."""
        noise = random.normal(scale=_SPREAD, size=(24, self.settings.knots, 1))
        return physics.position() + noise


class Cartpole(Cost):
    """The poles' missing height, their speed where they are up, and the cart's distance."""

    settings = Settings(
        horizon=1.0, knots=8, samples=48, interval=2, gain=3.0, damping=0.5, noise=1.0
    )
    weights: ClassVar = {"motion": 0.02, "off centre": 0.1}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """Height and reward are about 1 for poles that hang; motion counts near the top only."""
        up = physics.pole_angle_cosine()
        motion = np.exp(-4.0 * (1.0 - up)) * physics.angular_vel() ** 2
        return {
            "height": (1.0 - up).mean(axis=-1) / 2,
            "motion": motion.mean(axis=-1),
            "off centre": physics.cart_position() ** 2,
            "reward": 1.0 - self.task.get_reward(physics),
        }


class Acrobot(Cost):
    """The energy that the links lack to stand, the tip's distance, and their speed near the target.

    The energy leads the swing; the distance alone would hold the links still, bent upwards.
    """

    settings = Settings(
        horizon=2.5, knots=14, samples=64, interval=2, gain=1.0, damping=0.1, noise=2.0
    )
    weights: ClassVar = {"energy": 2.0, "distance": 0.25, "motion": 0.02}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """An energy is 2 for links that hang, and a distance is up to 4 m; both are weighted."""
        distance = physics.to_target()
        motion = (physics.velocity() ** 2).sum(axis=-1)
        return {
            "energy": np.abs(1.0 - _energy(physics)),
            "distance": distance,
            "motion": np.exp(-2.0 * distance) * motion,
            "reward": 1.0 - self.task.get_reward(physics),
        }


def _energy(physics: AnyPhysics) -> np.ndarray:
    """Energy of two thin links of 1 m and 1 kg over that of standing, (N,): -1 if they hang."""
    up, across, turning = physics.vertical(), physics.horizontal(), physics.velocity()
    upper, lower = turning[..., 0], turning.sum(axis=-1)
    between = (up[..., 0] * up[..., 1] + across[..., 0] * across[..., 1]) * upper * lower
    kinetic = (4 * upper**2 + lower**2 + 3 * between) / 6
    return (kinetic / 9.81 + 1.5 * up[..., 0] + 0.5 * up[..., 1]) / 2
