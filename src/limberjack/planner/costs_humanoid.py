"""What the planner avoids in the humanoid's tasks: a low head, a fall, standing where it should go.

Beside the true reward, which is flat for a body on the ground, there are terms that lead there: a
high head, an upright torso, feet below the point where the body would come to rest (its centre of
mass plus its velocity times the time constant of falling, known as the capture point).
"""

from typing import Any

import numpy as np

from limberjack.planner.cost import Cost, Settings
from limberjack.utils import arrays

__all__ = ["Move"]

_FEET = ["left_foot", "right_foot"]
_HEAD_HEIGHT = 1.55  # metres; a little above what is rewarded in full
_FALLING = 0.3  # seconds; the time constant of an inverted pendulum as high as the hips
_FASTEST = 3.5  # metres per second; about what half a second of foresight is good for

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

    settings = Settings(
        samples=64,
        horizon=0.6,
        knots=4,
        interval=1,
        timestep=0.0125,
        gain=2.5,
        noise=0.5,
        finest=0.1,
    )

    def __init__(self, task: Any) -> None:
        """Takes a `humanoid.Humanoid` task."""
        super().__init__(task)
        self._speed = float(task._move_speed)
        # Running is worth more speed than is safe: the reward grows up to 10 m/s.
        self._aim = min(1.2 * self._speed, _FASTEST)
        self._haste = 1.0 if self._speed < _FASTEST else 3.0

    def step_cost(self, physics: Any) -> np.ndarray:
        """Lowness, tilt, imbalance, haste and the missing reward, (N,)."""
        data = physics.named.data
        velocity = physics.center_of_mass_velocity()
        lowness = np.maximum(_HEAD_HEIGHT - physics.head_height(), 0.0)
        tilt = 1.0 - physics.torso_upright()
        feet = data.xpos[_FEET].mean(axis=-2)
        centre = physics.center_of_mass_position()
        is_up = np.clip((physics.head_height() - 0.9) / 0.4, 0.0, 1.0)
        resting = centre[..., :2] + _FALLING * velocity[..., :2] - feet[..., :2]
        cost = 2.0 * lowness + 0.5 * is_up * tilt + 0.05 * (physics.control() ** 2).mean(axis=-1)
        cost += self._motion(physics, velocity, is_up, resting)
        return cost + 2.0 * (1.0 - self.task.get_reward(physics))

    def _motion(
        self, physics: Any, velocity: np.ndarray, is_up: np.ndarray, resting: np.ndarray
    ) -> np.ndarray:
        """What standing and moving ask for besides being up, (N,)."""
        if not self._speed:
            haste = arrays.norm(velocity[..., :2])
            return arrays.norm(resting) + 0.3 * is_up * haste
        heading = physics.named.data.xmat["torso", ["xx", "yx"]]
        length = np.maximum(arrays.norm(heading), 1e-6)
        ahead = (velocity[..., :2] * heading).sum(axis=-1) / length
        short = np.maximum(self._aim - ahead, 0.0) / self._aim
        forward = (resting * heading).sum(axis=-1) / length
        sideways = np.abs(resting[..., 0] * heading[..., 1] - resting[..., 1] * heading[..., 0])
        balance = sideways / length + np.abs(forward - _FALLING * np.minimum(ahead, self._aim))
        # More than standing still would cost, else it would pay to stay down.
        down = self._haste + 0.5 + arrays.norm(resting)
        return is_up * (self._haste * short + 0.5 * balance) + (1.0 - is_up) * down

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Poses held, and random ones."""
        names = [physics.model.id2name(i, "actuator") for i in range(physics.model.nu)]
        held = [np.array([_angle(pose, name) for name in names]) for pose in _POSES]
        held += list(random.uniform(-1.0, 1.0, (4, len(names))))
        return np.repeat(np.array(held)[:, None], self.settings.knots, axis=1)


def _angle(pose: dict[str, float], actuator: str) -> float:
    """The angle of an actuator's joint in a pose, which names joints of both sides at once."""
    return pose.get(actuator.removeprefix("left_").removeprefix("right_"), 0.0)
