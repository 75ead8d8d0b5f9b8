"""What the planner avoids for a humanoid: a low head, a fall, standing where it should go.

Beside the true reward, which is flat for a body on the ground, there are terms that lead there: a
high head, an upright torso, feet below the point where the body would come to rest (its centre of
mass plus its velocity times the time constant of falling, known as the capture point).

A body that is down first stands up, as for standing, and goes only then. While it goes, strides of
many phases, periods and lengths are proposed: chance alone finds a shuffle, hardly a stride.
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.cost import Cost, Settings
from limberjack.utils import arrays

__all__ = ["GOING", "Move", "actuators"]

_FEET = ["left_foot", "right_foot"]
_HEAD_HEIGHT = 1.55  # metres; a little above what is rewarded in full
_FALLING = 0.3  # seconds; the time constant of an inverted pendulum as high as the hips
_SPARE = 1.2  # times the task's speed is aimed at: it must hold throughout a stride
_DOWN = 1.0  # metres; with the head below this it has fallen and must stand up
_STANDS = 1.35  # metres; with the head above this, upright and slow, it may go
_UPRIGHT = 0.9  # cosine of the torso's tilt, from which it counts as upright
_SLOW = 1.5  # metres per second; less than a fall through standing height has

_STRIDES = 24  # proposed at each planning
_PERIODS = (0.45, 0.6, 0.75)  # seconds for two steps
_LENGTHS = (0.4, 1.2)  # parts of the full stride
_LEANS = (-0.3, 0.1)  # radians added to both hips; negative brings the legs forward

# To stand, wide samples and few of them do; to go, what counts is many samples, and a law that is
# damped: without that light limbs swing to and fro at the rate of control, and effort is paid for.
_STILL = Settings(
    samples=64,
    horizon=0.6,
    knots=4,
    interval=1,
    timestep=0.0125,
    gain=2.5,
    noise=0.5,
    finest=0.1,
)
GOING = dataclasses.replace(
    _STILL, samples=96, horizon=0.5, knots=6, gain=3.0, damping=0.03, noise=0.8
)

# Angles in radians by actuator; others are 0.
_POSES: list[dict[str, float]] = [
    {},
    {"hip_y": -0.6, "knee": -1.0, "ankle_y": -0.4},
    {"hip_y": -1.6, "knee": -2.2, "ankle_y": -0.6, "abdomen_y": -0.3},
    {"hip_y": -1.9, "knee": -2.6, "ankle_y": -0.7, "abdomen_y": -0.9},
    {"abdomen_y": -1.0, "hip_y": -1.2, "knee": -0.4},
    {"hip_y": -1.8, "knee": -1.0, "abdomen_y": -1.2, "shoulder1": 0.8, "shoulder2": -0.8},
]


class Move(Cost):
    """Stands up, and moves at the task's speed."""

    def __init__(self, task: Any) -> None:
        """Takes a `humanoid.Humanoid` task."""
        super().__init__(task)
        self._speed = float(task._move_speed)
        self._aim = _SPARE * self._speed
        self._haste = 1.0
        self.settings = GOING if self._speed else _STILL
        self._goes = False
        self._names: list[str] = []  # of the actuators
        self._poses: np.ndarray | None = None  # that are proposed, (n, nu)

    def reset(self) -> None:
        """Stands up first."""
        self._goes = False

    def look(self, physics: Any) -> None:
        """Goes once it stands, until it falls."""
        height = physics.head_height().item()
        speed = np.linalg.norm(physics.center_of_mass_velocity())
        if height < _DOWN:
            self._goes = False
        elif height > _STANDS and physics.torso_upright().item() > _UPRIGHT and speed < _SLOW:
            self._goes = self._speed > 0

    def step_cost(self, physics: Any) -> np.ndarray:
        """Lowness, tilt, imbalance, haste and the missing reward, (N,)."""
        data = physics.named.data
        velocity = physics.center_of_mass_velocity()
        height = physics.head_height()
        lowness = np.maximum(_HEAD_HEIGHT - height, 0.0)
        tilt = 1.0 - physics.torso_upright()
        left, right = (data.xpos[foot] for foot in _FEET)
        feet = (left[..., :2] + right[..., :2]) / 2
        centre = physics.center_of_mass_position()
        is_up = np.clip((height - 0.9) / 0.4, 0.0, 1.0)
        resting = centre[..., :2] + _FALLING * velocity[..., :2] - feet
        cost = 2.0 * lowness + 0.5 * is_up * tilt + 0.05 * (physics.control() ** 2).mean(axis=-1)
        cost += self._motion(physics, velocity, is_up, resting)
        return cost + 2.0 * (1.0 - self._reward(physics))

    def _reward(self, physics: Any) -> np.ndarray:
        """The task's reward, (N,); without its speed while standing up."""
        terms = self.task.reward_terms(physics)
        if self._speed and not self._goes:
            terms["movement"] = 1.0
        return self.task.reward_of(terms)

    def _motion(
        self, physics: Any, velocity: np.ndarray, is_up: np.ndarray, resting: np.ndarray
    ) -> np.ndarray:
        """What standing and moving ask for besides being up, (N,)."""
        if not self._goes:
            haste = arrays.norm(velocity[..., :2])
            return arrays.norm(resting) + 0.3 * is_up * haste
        heading = physics.named.data.xmat["torso", ["xx", "yx"]]
        length = np.maximum(arrays.norm(heading), 1e-6)
        ahead = _along(velocity, heading) / length
        short = np.maximum(self._aim - ahead, 0.0) / self._aim
        forward = _along(resting, heading) / length
        sideways = np.abs(resting[..., 0] * heading[..., 1] - resting[..., 1] * heading[..., 0])
        forward -= _FALLING * np.minimum(ahead, self._aim)
        imbalance = self._imbalance(np.abs(forward), sideways / length)
        # More than standing still would cost, else it would pay to stay down.
        down = self._haste + 0.5 + arrays.norm(resting)
        return is_up * (self._haste * short + imbalance) + (1.0 - is_up) * down

    def _imbalance(self, forward: np.ndarray, sideways: np.ndarray) -> np.ndarray:
        """What it costs that the body would not come to rest above its feet, (N,); in metres."""
        return 0.5 * (sideways + forward)

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Strides while it goes; else poses held, and random ones."""
        self._names = self._names or actuators(physics)
        if self._goes:
            return _strides(self._names, self.settings, random)
        if self._poses is None:
            held = [[_angle(pose, name) for name in self._names] for pose in _POSES]
            self._poses = np.array(held)
        drawn = random.uniform(-1.0, 1.0, (4, len(self._names)))
        held = np.concatenate([self._poses, drawn])
        return np.repeat(held[:, None], self.settings.knots, axis=1)


def actuators(physics: Any) -> list[str]:
    """The actuators' names, in their order; they are those of the joints that they turn."""
    return [physics.model.id2name(i, "actuator") for i in range(physics.model.nu)]


def _along(vectors: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """How far vectors (..., 2 or more) go along a heading (..., 2) times its length, (...)."""
    return vectors[..., 0] * heading[..., 0] + vectors[..., 1] * heading[..., 1]


def _strides(names: list[str], settings: Settings, random: np.random.Generator) -> np.ndarray:
    """Plans of steady strides at all phases, (n, knots, nu); arms and trunk are at 0."""
    phases = 2 * np.pi * (np.arange(_STRIDES) + random.uniform(0.0, 1.0, _STRIDES)) / _STRIDES
    rates = 2 * np.pi / random.choice(_PERIODS, _STRIDES)
    length = random.uniform(*_LENGTHS, _STRIDES)[:, None]
    lean = random.uniform(*_LEANS, _STRIDES)[:, None]
    times = np.linspace(0.0, settings.spacing * (settings.knots - 1), settings.knots)
    plans = np.zeros((_STRIDES, settings.knots, len(names)))
    for side, lag in (("left", 0.0), ("right", np.pi)):
        # At 0 the leg is foremost; it goes back on the ground, and forward again from pi on.
        phase = phases[:, None] + rates[:, None] * times + lag
        swing, push = np.maximum(-np.sin(phase), 0.0), np.maximum(np.sin(phase - 0.8), 0.0)
        plans[..., names.index(f"{side}_hip_y")] = lean - length * (0.35 + 0.65 * np.cos(phase))
        plans[..., names.index(f"{side}_knee")] = -0.25 - 1.3 * length * swing
        plans[..., names.index(f"{side}_ankle_y")] = -0.2 + 0.6 * length * push
    return plans


def _angle(pose: dict[str, float], actuator: str) -> float:
    """The angle of an actuator's joint in a pose, which names joints of both sides at once."""
    return pose.get(actuator.removeprefix("left_").removeprefix("right_"), 0.0)
