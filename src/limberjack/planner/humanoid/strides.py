"""Postures and strides that the humanoid's cost proposes.

    plans = strides(names, settings, random)      # (24, knots, nu), radians
    plans = postures(names, knots, random)        # (10, knots, nu)

Random variations alone find a shuffle, hardly a stride.
"""

import numpy as np

from limberjack.planner.settings import Settings

__all__ = ["postures", "strides"]

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
