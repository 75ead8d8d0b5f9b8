"""`Locomotion`: the cost of the humanoid's tasks, to stand, walk or run.

Beside the true reward, which is flat for a body on the ground, there are terms that lead there: a
high head, an upright torso, and feet below the capture point, where the body would come to rest
(its centre of mass plus its velocity times the time constant of falling). A body that is down
stands up first, as for standing, and moves only then.

A run has a target speed beyond reach, and repeats its own gait: each step continues with the
mirrored motion of the step before. `gait.py` has the plans that are proposed.
"""

import dataclasses
import enum
from typing import ClassVar

import numpy as np

from limberjack.planner.cost import AnyPhysics, AnyTask, Cost
from limberjack.planner.humanoid.gait import STEP, Gait, postures, strides
from limberjack.planner.optimisers.mppi import MPPI
from limberjack.planner.settings import Settings
from limberjack.planner.spline import targets_at
from limberjack.utils import arrays

__all__ = ["Locomotion", "Stage", "actuators"]

_FALLING = 0.3  # seconds; time constant of an inverted pendulum as high as the hips
_CONTROL_STEP = 0.025  # seconds; the task's

# To stand, few wide samples do. Moving takes many samples, and a damped control law: without it,
# light limbs oscillate at the rate of control, which costs effort.
_STAND = Settings(
    samples=64,
    horizon=0.6,
    knots=4,
    timestep=0.0125,
    gain=2.5,
    damping=0.0,
    noise=0.5,
    optimiser=MPPI(finest=0.1),
)
_WALK = dataclasses.replace(
    _STAND, samples=96, horizon=0.5, knots=6, gain=3.0, damping=0.03, noise=0.8
)
# Longer time steps predict a foot's strike so badly that the body falls.
_RUN = dataclasses.replace(_WALK, knots=7, anchored=True, timestep=_CONTROL_STEP / 3)


class Stage(enum.Enum):
    """Stages of a humanoid's task."""

    STAND = "stand up, and stand"
    MOVE = "move at the task's speed"


def _has_fallen(physics: AnyPhysics) -> bool:
    return physics.head_height().item() < 1.0  # metres


def _is_steady(physics: AnyPhysics) -> bool:
    """Whether the head is up, the torso upright, and the body slower than one that falls."""
    speed = np.linalg.norm(physics.center_of_mass_velocity())  # metres per second
    is_up = physics.head_height().item() > 1.35 and physics.torso_upright().item() > 0.9
    return bool(is_up and speed < 1.5)


_TRANSITIONS = {Stage.STAND: (_is_steady, Stage.MOVE), Stage.MOVE: (_has_fallen, Stage.STAND)}


class Locomotion(Cost):
    """Cost of standing up, and of moving at the task's speed."""

    weights: ClassVar = {"height": 2.0, "tilt": 0.5, "effort": 0.05, "motion": 1.0, "reward": 2.0}

    def __init__(self, task: AnyTask) -> None:
        """Takes a `humanoid.Humanoid` task."""
        super().__init__(task)
        speed, runs = task.move_speed, task.move_speed > 2.0  # metres per second
        self.settings = _RUN if runs else _WALK if speed else _STAND
        # The target speed; 0 to stand. A walk must hold its speed throughout a stride; a run is
        # slower with a target of 4 m/s, and no faster with one of 6 m/s.
        self._aim = 5.0 if runs else 1.2 * speed
        # Costs of the whole lack of speed, and of the square of a metre's imbalance besides half a
        # metre's: a tenth of a metre is normal in a run.
        self._haste, self._fall = (6.0, 5.0) if runs else (1.0, 0.0)
        self._names: list[str] = []  # of the actuators
        self.reset()

    def reset(self) -> None:
        """Stands up first."""
        self._stage = Stage.STAND
        self._gait: Gait | None = None  # while it runs

    @property
    def _per_knot(self) -> float:
        """Control steps from knot to knot."""
        return self.settings.spacing / _CONTROL_STEP

    def stage(self) -> Stage:
        """The current stage."""
        return self._stage

    def update(self, physics: AnyPhysics) -> None:
        """Moves once the body is steady, until it falls."""
        self._names = self._names or actuators(physics)
        is_due, following = _TRANSITIONS[self._stage]
        if self._aim and is_due(physics):
            runs = self.settings.anchored and following is Stage.MOVE
            self._stage, self._gait = following, Gait(self._names) if runs else None

    def terms(self, physics: AnyPhysics) -> dict[str, np.ndarray]:
        """Terms of being up, of moving, and the missing reward."""
        height = physics.head_height()
        is_up = np.clip((height - 0.9) / 0.4, 0.0, 1.0)
        return {
            # A little above the height that is fully rewarded, metres.
            "height": np.maximum(1.55 - height, 0.0),
            "tilt": is_up * (1.0 - physics.torso_upright()),
            "effort": (physics.control() ** 2).mean(axis=-1),
            "motion": self._motion(physics, is_up),
            "reward": 1.0 - self._reward(physics),
        }

    def _reward(self, physics: AnyPhysics) -> np.ndarray:
        """The task's reward, (N,); without its speed while standing up."""
        terms = self.task.reward_terms(physics)
        if self._aim and self._stage is Stage.STAND:
            terms["movement"] = 1.0
        return self.task.reward_of(terms)

    def _motion(self, physics: AnyPhysics, is_up: np.ndarray) -> np.ndarray:
        """Imbalance, and the lack or excess of speed, (N,)."""
        velocity = physics.center_of_mass_velocity()
        imbalance = _imbalance(physics, velocity)
        if self._stage is Stage.STAND:
            return arrays.norm(imbalance) + 0.3 * is_up * arrays.norm(velocity[..., :2])
        heading = physics.named.data.xmat["torso", ["xx", "yx"]]
        length = np.maximum(arrays.norm(heading), 1e-6)
        ahead = _along(velocity, heading) / length
        short = np.maximum(self._aim - ahead, 0.0) / self._aim
        forward = _along(imbalance, heading) / length - _FALLING * np.minimum(ahead, self._aim)
        sideways = imbalance[..., 0] * heading[..., 1] - imbalance[..., 1] * heading[..., 0]
        forward, sideways = np.abs(forward), np.abs(sideways) / length
        fall = 0.5 * (sideways + forward) + self._fall * (forward**2 + sideways**2)
        # More than standing still would cost: otherwise staying down would pay.
        down = self._haste + 0.5 + arrays.norm(imbalance)
        return is_up * (self._haste * short + fall) + (1.0 - is_up) * down

    def proposals(self, physics: AnyPhysics, random: np.random.Generator) -> np.ndarray:
        """Postures to stand up; strides, and then the body's own gait, to move."""
        if self._stage is Stage.STAND:
            return postures(self._names, self.settings.knots, random)
        if self._gait is None or not self._gait.is_known:
            return strides(self._names, self.settings, random)
        times = self._per_knot * (np.arange(self.settings.knots) - self.phase)
        return self._gait.proposals(times, random)

    def followed(self, targets: np.ndarray) -> None:
        """Stores the targets in the gait."""
        if self._gait is not None:
            self._gait.add(targets)

    def continued(self, plan: np.ndarray) -> np.ndarray:
        """The mirrored targets of a step before, (nu,)."""
        if self._gait is None:
            return super().continued(plan)
        return self._gait.mirrored(targets_at(plan, len(plan) - STEP / self._per_knot))


def actuators(physics: AnyPhysics) -> list[str]:
    """The actuators' names, in their order; they are those of the joints that they turn."""
    return [physics.model.id2name(i, "actuator") for i in range(physics.model.nu)]


def _imbalance(physics: AnyPhysics, velocity: np.ndarray) -> np.ndarray:
    """From the middle of the feet to the capture point, (N, 2), metres."""
    left, right = (physics.named.data.xpos[foot] for foot in ("left_foot", "right_foot"))
    feet = (left[..., :2] + right[..., :2]) / 2
    centre = physics.center_of_mass_position()
    return centre[..., :2] + _FALLING * velocity[..., :2] - feet


def _along(vectors: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Component of vectors (..., 2 or more) along a heading (..., 2) times its length, (...)."""
    return vectors[..., 0] * heading[..., 0] + vectors[..., 1] * heading[..., 1]
