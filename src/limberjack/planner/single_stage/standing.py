"""Costs of heavy bodies that must stand before they do anything else: dog and humanoid_CMU.

Their rewards are products of factors, which are flat where one factor is 0. So each cost adds up
what every factor lacks.
"""

from typing import ClassVar

import numpy as np

from limberjack.planner.cost import AnyPhysics, Cost
from limberjack.planner.optimisers.icem import ICEM
from limberjack.planner.settings import Settings
from limberjack.utils import arrays

__all__ = ["Dog", "HumanoidCMU"]


_FALLING = 0.3  # seconds; as of the humanoid: where the body would come to rest


class Dog(Cost):
    """The factors' missing parts, torso and pelvis below their height, the tilt and the effort."""

    # Of 300 steps of walk, seed 1000 has 165; with white iCEM 128, with its best elite 120, with
    # plans of 0.3 s 38, with noise of 0.25 and 1 62 and 119, with plans at every third step 99.
    settings = Settings(
        horizon=0.6,
        knots=5,
        samples=40,
        interval=2,
        timestep=0.0075,
        cost_interval=3,
        gain=1.5,
        damping=0.0,
        noise=0.5,
    )
    weights: ClassVar = {"factors": 2.0, "height": 4.0, "tilt": 1.0, "effort": 0.02}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """The torso of a dog that stands is 0.4 m high; a fetching dog has two more factors."""
        wanted = np.stack(physics.default_heights(), axis=-1)
        lacking = np.maximum(0.9 * wanted - physics.torso_pelvis_height(), 0.0)
        return {
            "factors": 1.0 - self.task.get_reward_factors(physics).mean(axis=-1),
            "height": lacking.sum(axis=-1),
            "tilt": (1.0 - physics.upright()).mean(axis=-1) / 2,
            "effort": (physics.control() ** 2).mean(axis=-1),
            "reward": 1.0 - self.task.get_reward(physics),
        }


class HumanoidCMU(Cost):
    """A low head, a tilted thorax, a body that is not above its feet, motion and effort."""

    # Of 300 steps of stand, seeds 1000 and 1001 have 238 and 122. MPPI had 69 and 10 in more time,
    # with noise of 0.5 and 0.6 s; with that noise alone seed 1001 has 21, and with 0.15 1.
    settings = Settings(
        horizon=0.4,
        knots=4,
        samples=64,
        timestep=0.01,
        gain=3.0,
        damping=0.1,
        noise=0.25,
        optimiser=ICEM(colour=0.0, takes_best=True),
    )
    weights: ClassVar = {"height": 2.0, "tilt": 1.0, "balance": 1.0, "motion": 0.02, "effort": 0.05}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """The head of a humanoid that stands is 1.4 m high; a little more is wanted."""
        data = physics.named.data
        feet = data.xpos[["lfoot", "rfoot"]][..., :2].mean(axis=-2)
        centre = physics.center_of_mass_position()[..., :2]
        drift = physics.center_of_mass_velocity()[..., :2]
        return {
            "height": np.maximum(1.5 - physics.head_height(), 0.0),
            "tilt": (1.0 - physics.torso_upright()) / 2,
            "balance": arrays.norm(centre + _FALLING * drift - feet),
            "motion": np.abs(physics.velocity()).mean(axis=-1),
            "effort": (physics.control() ** 2).mean(axis=-1),
            "reward": 1.0 - self.task.get_reward(physics),
        }

    def proposals(self, physics: AnyPhysics, random: np.random.Generator) -> np.ndarray:
        """Straight legs, and three squats; random variations do not bend all joints of a leg."""
        names = [physics.model.id2name(i, "actuator") for i in range(physics.model.nu)]
        held = [[posture.get(name[1:], 0.0) for name in names] for posture in _POSTURES]
        return np.repeat(np.array(held)[:, None], self.settings.knots, axis=1)


# Angles of the joints of both legs, radians; others are 0.
_POSTURES: list[dict[str, float]] = [
    {},
    {"femurrx": -0.5, "tibiarx": 1.0, "footrx": -0.5},
    {"femurrx": -1.2, "tibiarx": 2.0, "footrx": -0.8},
    {"femurrx": -2.0, "tibiarx": 2.5, "footrx": -0.6},
]
