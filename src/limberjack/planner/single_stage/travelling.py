"""Costs of going somewhere: point_mass, lqr, swimmer, and the quadruped's escape and fetch.

Beside the missing reward, each has the distance that is left.
"""

from typing import ClassVar

import numpy as np

from limberjack.planner.cost import AnyPhysics, Cost
from limberjack.planner.optimisers.icem import ICEM
from limberjack.planner.settings import Settings

__all__ = ["Escape", "Fetch", "PointMass", "Regulator", "Swimmer"]


class PointMass(Cost):
    """The ball's distance from the target, and its speed there."""

    settings = Settings(
        horizon=1.0, knots=6, samples=48, interval=2, noise=0.5, optimiser=ICEM(colour=2.0)
    )
    weights: ClassVar = {"distance": 4.0, "motion": 0.5}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """The arena is 0.6 m wide."""
        distance = physics.mass_to_target_dist()
        speed = (physics.velocity() ** 2).sum(axis=-1)
        return {
            "distance": distance,
            "motion": np.exp(-20.0 * distance) * speed,
            "reward": 1.0 - self.task.get_reward(physics),
        }


class Regulator(Cost):
    """The cost that the task itself has, of positions and forces."""

    settings = Settings(
        horizon=3.0, knots=13, samples=48, interval=2, gain=1.5, damping=0.0, noise=1.0
    )

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """A start costs 1, with positions of norm sqrt(2)."""
        return {"reward": 1.0 - self.task.get_reward(physics)}

    def terminal(self, physics: AnyPhysics) -> np.ndarray:
        """Cost of the motion that is left, in means of a plan: that of a start is 1.5."""
        return 1.5 * physics.state_norm() ** 2 / 2


class Swimmer(Cost):
    """The nose's distance from the target."""

    settings = Settings(
        horizon=1.8,
        knots=12,
        samples=48,
        interval=2,
        gain=1.0,
        damping=0.0,
        noise=1.0,
        optimiser=ICEM(colour=0.0),
    )
    weights: ClassVar = {"distance": 1.0}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """Targets are up to 2.8 m away, or 0.4 m in two of ten episodes."""
        return {
            "distance": physics.nose_to_target_dist(),
            "reward": 1.0 - self.task.get_reward(physics),
        }


class Escape(Cost):
    """The missing way to the edge of the terrain, the torso's tilt and the effort."""

    settings = Settings(horizon=1.0, knots=8, samples=24, interval=2, noise=1.0)
    weights: ClassVar = {"way": 4.0, "tilt": 0.3, "effort": 0.05}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """The terrain's edge is 30 m from its centre, where episodes start."""
        edge = physics.model.hfield_size[..., 0, 0]
        return {
            "way": np.maximum(1.0 - physics.origin_distance() / edge, 0.0),
            "tilt": 1.0 - physics.torso_upright(),
            "effort": (physics.control() ** 2).mean(axis=-1),
            "reward": 1.0 - self.task.get_reward(physics),
        }


class Fetch(Cost):
    """The ball's distance from the workspace and from the target, and the torso's tilt."""

    settings = Settings(
        horizon=1.0, knots=8, samples=40, interval=2, noise=1.0, optimiser=ICEM(colour=0.0)
    )
    weights: ClassVar = {"reach": 1.0, "bring": 1.0, "behind": 0.5, "tilt": 0.5, "effort": 0.05}

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """Metres. A body between ball and target would push the ball away from the target."""
        reach, bring = physics.self_to_ball_distance(), physics.ball_to_target_distance()
        data = physics.named.data
        to_ball = (data.xpos["ball"] - data.site_xpos["workspace"])[..., :2]
        to_target = (data.site_xpos["target"] - data.xpos["ball"])[..., :2]
        along = (to_ball * to_target).sum(axis=-1) / np.maximum(reach * bring, 1e-6)
        return {
            "reach": reach,
            "bring": bring,
            "behind": (1.0 - along) / 2 * np.minimum(bring, 1.0),
            "tilt": 1.0 - physics.torso_upright(),
            "effort": (physics.control() ** 2).mean(axis=-1),
            "reward": 1.0 - self.task.get_reward(physics),
        }
