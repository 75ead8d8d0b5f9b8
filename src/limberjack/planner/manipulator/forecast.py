"""`Forecast`: poses of an object in the near future, from the planner's own simulation.

forecast = Forecast("ball", task.object_joints, settings)
forecast.update(physics)
poses = forecast.poses  # at the knots of a plan; none for an object at rest
"""

import contextlib
from collections.abc import Iterator

import mujoco
import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.hand import ARM
from limberjack.planner.manipulator.props import Pose, pose_of
from limberjack.planner.settings import Settings
from limberjack.rl.control import PhysicsError

__all__ = ["MEETS", "Forecast", "restored"]

MEETS = 1, 2, 4  # knots at which the hand may meet a moving object
_HEAVY = 1e4  # kg m2; inertia of an arm that stays where it is
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value


class Forecast:
    """Poses of an object at the plan's knots, if the arm stays where it is."""

    def __init__(self, site: str, joints: list[str], settings: Settings) -> None:
        self._site, self._joints = site, joints
        self._count = settings.knots - 1
        self._span = settings.horizon / self._count  # seconds from knot to knot
        self.poses: list[Pose] = []  # none at rest, fewer if the simulation diverges
        self.settles = False  # whether the object is at rest at the horizon, or nearly so

    def update(self, physics: Physics) -> None:
        """Simulates up to the horizon; the simulation is then in the same state as before."""
        data = physics.named.data
        self.settles = bool(np.abs(data.qvel[self._joints]).max() < 0.02)
        self.poses = []
        if self.settles:
            return
        armature = physics.named.model.dof_armature
        before = armature[ARM].copy()
        with restored(physics):
            armature[ARM], data.qvel[ARM] = _HEAVY, 0.0
            try:
                physics.forward()
                for _ in range(self._count):
                    physics.step(round(self._span / physics.timestep()))
                    self.poses.append(pose_of(data, self._site))
            except PhysicsError:
                pass  # fewer poses
            finally:
                armature[ARM] = before
            self.settles = bool(np.abs(data.qvel[self._joints]).max() < 0.2)

    def met(self, data: NamedFields) -> list[Pose]:
        """The poses at the knots of `MEETS`; the current one for an object at rest."""
        last = len(self.poses)
        met = [self.poses[min(knot, last) - 1] for knot in MEETS if last]
        return met or [pose_of(data, self._site)]


@contextlib.contextmanager
def restored(physics: Physics) -> Iterator[None]:
    """Within the context a single simulation may be changed; then it is as before."""
    state = physics.get_state(_STATE)
    yield
    physics.set_state(state, _STATE)
    physics.forward()
