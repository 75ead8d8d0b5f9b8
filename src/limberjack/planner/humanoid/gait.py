"""Plans that the humanoid's cost proposes: postures, strides, and its own `Gait`, repeated.

    plans = postures(names, knots, random)        # (10, knots, nu), radians; names of the actuators
    plans = strides(names, settings, random)      # (24, knots, nu)
    gait = Gait(names)
    gait.add(targets)  # at each control step
    plans = gait.proposals(times, random)         # (12, knots, nu)

Random variations alone find a shuffle, hardly a stride.
"""

import numpy as np

from limberjack.planner.settings import Settings
from limberjack.planner.spline import targets_at

__all__ = ["STEP", "Gait", "postures", "strides"]

STEP = 14  # control steps from one foot's strike to the other's: 0.35 s, as a human runs

# Angles in radians of the joints of both sides; others are 0.
_POSTURES: list[dict[str, float]] = [
    {},
    {"hip_y": -0.6, "knee": -1.0, "ankle_y": -0.4},
    {"hip_y": -1.6, "knee": -2.2, "ankle_y": -0.6, "abdomen_y": -0.3},
    {"hip_y": -1.9, "knee": -2.6, "ankle_y": -0.7, "abdomen_y": -0.9},
    {"abdomen_y": -1.0, "hip_y": -1.2, "knee": -0.4},
    {"hip_y": -1.8, "knee": -1.0, "abdomen_y": -1.2, "shoulder1": 0.8, "shoulder2": -0.8},
]


def postures(names: list[str], knots: int, random: np.random.Generator) -> np.ndarray:
    """Plans that hold a posture, known ones and random ones, (n, knots, nu)."""
    joints = [name.removeprefix("left_").removeprefix("right_") for name in names]
    known = [[posture.get(joint, 0.0) for joint in joints] for posture in _POSTURES]
    drawn = random.uniform(-1.0, 1.0, (4, len(names)))
    return np.repeat(np.concatenate([known, drawn])[:, None], knots, axis=1)


def strides(names: list[str], settings: Settings, random: np.random.Generator) -> np.ndarray:
    """Plans of steady strides at all phases, (n, knots, nu); arms and trunk are at 0."""
    count = 24
    phases = 2 * np.pi * (np.arange(count) + random.uniform(0.0, 1.0, count)) / count
    rates = 2 * np.pi / random.choice((0.45, 0.6, 0.75), count)  # seconds for two steps
    length = random.uniform(0.4, 1.2, count)[:, None]  # parts of the full stride
    lean = random.uniform(-0.3, 0.1, count)[:, None]  # radians of both hips; forwards below 0
    times = np.linspace(0.0, settings.spacing * (settings.knots - 1), settings.knots)
    plans = np.zeros((count, settings.knots, len(names)))
    for side, lag in (("left", 0.0), ("right", np.pi)):
        # At 0 the leg is foremost; it goes back on the ground, and forward again from pi on.
        phase = phases[:, None] + rates[:, None] * times + lag
        swing, push = np.maximum(-np.sin(phase), 0.0), np.maximum(np.sin(phase - 0.8), 0.0)
        plans[..., names.index(f"{side}_hip_y")] = lean - length * (0.35 + 0.65 * np.cos(phase))
        plans[..., names.index(f"{side}_knee")] = -0.25 - 1.3 * length * swing
        plans[..., names.index(f"{side}_ankle_y")] = -0.2 + 0.6 * length * push
    return plans


class Gait:
    """Targets that a humanoid followed in the last control steps, and their continuation."""

    def __init__(self, names: list[str]) -> None:
        """Takes the actuators' names; a side's begin with `left_` or `right_`."""
        opposite = {"left": "right", "right": "left"}
        parts = [name.partition("_") for name in names]
        mirrored = [opposite.get(side, side) + rest + joint for side, rest, joint in parts]
        self._sources = [names.index(name) for name in mirrored]
        # Angles of these joints change their sign when left and right are exchanged.
        aside = ("abdomen_z", "abdomen_x", "ankle_x", "shoulder1", "shoulder2")
        self._signs = np.array([-1.0 if name.endswith(aside) else 1.0 for name in names])
        self._targets: list[np.ndarray] = []

    @property
    def is_known(self) -> bool:
        """Whether the targets of two steps are stored."""
        return len(self._targets) >= 2 * STEP

    def add(self, targets: np.ndarray) -> None:
        """Stores the targets of a control step, (nu,)."""
        self._targets.append(targets)
        del self._targets[:-60]  # more than two steps

    def mirrored(self, targets: np.ndarray) -> np.ndarray:
        """The same with left and right exchanged, (..., nu)."""
        return self._signs * targets[..., self._sources]

    def middle(self, step: int) -> np.ndarray:
        """The mean of the targets over the last two steps, the same for both sides, (nu,)."""
        mean = np.mean(self._targets[-2 * step :], axis=0)
        return (mean + self.mirrored(mean)) / 2

    def repeated(self, times: np.ndarray, step: int) -> np.ndarray:
        """The targets at times from now on if the gait continues, (n, nu).

        Args:
          times: in control steps; the stored targets are those at -1, -2 and so on.
          step: control steps after which the other side repeats the motion.
        """
        back = np.ceil((times + 1.0) / step).clip(0.0)
        then = targets_at(np.array(self._targets), len(self._targets) + times - back * step)
        return np.where(back[:, None] % 2 == 1, self.mirrored(then), then)

    def proposals(self, times: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Continuations at times, in control steps, and quicker and larger ones, (n, times, nu)."""
        middle, found = self.middle(STEP), [self.repeated(times, STEP)]
        for _ in range(11):
            step = STEP + int(random.integers(-1, 2))
            again = self.repeated(times * random.uniform(0.95, 1.1), step)
            found.append(middle + random.uniform(0.95, 1.2) * (again - middle))
        return np.array(found)
