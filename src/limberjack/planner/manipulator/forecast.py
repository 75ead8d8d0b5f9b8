"""`Forecast`: poses of an object in the near future, from the planner's own simulation.

forecast = Forecast("ball", task.object_joints, settings)
forecast.update(physics)
poses = forecast.poses  # at the knots of a plan; none for an object at rest
"""

import contextlib
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from limberjack.planner.arm.hand import ARM
from limberjack.planner.manipulator.grips import Pose, pose_of
from limberjack.planner.settings import Settings
from limberjack.rl.control import PhysicsError

__all__ = ["MEETS", "Forecast"]

MEETS = 1, 2, 4  # knots at which the hand may meet a moving object
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value
_HEAVY = 1e4  # kg m2; armature of an arm that does not move during the forecast
_AT_REST = 0.02  # metres or radians per second


class Forecast:
    """Poses of an object at the plan's knots, if the arm stays where it is.

    Attributes:
      poses: those poses; empty for an object at rest, fewer if the simulation diverges.
      settles: whether the object is at rest at the horizon, or nearly so.
    """

    def __init__(self, site: str, joints: list[str], settings: Settings) -> None:
        """Takes the object's site and joints, and the planner's settings."""
        self._site, self._joints = site, joints
        self._count = settings.knots - 1
        self._span = settings.horizon / self._count  # seconds from knot to knot
        self.poses: list[Pose] = []
        self.settles = False

    def update(self, physics: Any) -> None:
        """Simulates up to the horizon; the simulation is then in the same state as before."""
        data, state = physics.named.data, physics.get_state(_STATE)
        self.settles = bool(np.abs(data.qvel[self._joints]).max() < _AT_REST)
        self.poses = []
        if self.settles:
            return
        with contextlib.suppress(PhysicsError), _still_arm(physics):
            physics.forward()
            for _ in range(self._count):
                physics.step(round(self._span / physics.timestep()))
                self.poses.append(pose_of(data, self._site))
        self.settles = bool(np.abs(data.qvel[self._joints]).max() < 10 * _AT_REST)
        physics.set_state(state, _STATE)
        physics.forward()

    def met(self, data: Any) -> list[Pose]:
        """The poses at the knots of `MEETS`; the current one for an object at rest."""
        last = len(self.poses)
        met = [self.poses[min(knot, last) - 1] for knot in MEETS if last]
        return met or [pose_of(data, self._site)]


@contextlib.contextmanager
def _still_arm(physics: Any) -> Iterator[None]:
    """Within the context the arm of a single simulation is too heavy to move."""
    armature = physics.named.model.dof_armature
    before = armature[ARM].copy()
    armature[ARM], physics.named.data.qvel[ARM] = _HEAVY, 0.0
    try:
        yield
    finally:
        armature[ARM] = before
