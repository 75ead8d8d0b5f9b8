"""Poses of the stacker's boxes: flat, at rest, in each other's way."""

from typing import Any

import numpy as np

__all__ = ["DOWN", "FLAT", "HALF", "PASSES", "crest", "haste", "lies_too_low", "stands", "turned"]

HALF = 0.022  # metres; half a box
FLAT = 0.01  # of `turned`: 6 degrees
PASSES = 1.5 * HALF  # above another one a box that is carried keeps clear of it
DOWN = -np.pi  # radians; angle of a hand that points down
_BELOW = 0.18  # metres; boxes that are higher than this are falling, or on the arm


def turned(data: Any, box: str | list[str]) -> Any:
    """0 for boxes that lie flat on any of their sides, 0.25 for one on an edge, (...)."""
    square = data.xmat[box, "xx"] ** 2
    return square * (1.0 - square)


def stands(data: Any, box: str, gap: float, allowed: float, stood: bool) -> bool:
    """Whether a box rests where it should; one that stood there may have moved a little."""
    if stood:
        return gap < 2.0 * allowed
    speed = np.abs(data.qvel[[f"{box}_x", f"{box}_z"]]).max()
    return bool(gap < allowed and speed < 0.1 and turned(data, box) < FLAT)  # metres per second


def crest(data: Any, boxes: list[str], start: float, end: float) -> float:
    """Height of the highest of the boxes between two places, metres; 0 if there is none."""
    low, high = min(start, end) - 2.5 * HALF, max(start, end) + 2.5 * HALF
    places = data.site_xpos[boxes]
    tops = [float(p[2]) + HALF for p in places if low < p[0] < high and p[2] < _BELOW]
    return max(tops, default=0.0)


def lies_too_low(box: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Height that a box (N, 2) lacks to pass the floor and others (N, n, 2), metres, (N,)."""
    beside = np.abs(others[..., 0] - box[..., None, 0])
    lack = others[..., 1] + HALF + PASSES - box[..., None, 1]
    # It must begin to rise at 0.13 m from another one's middle, and be above at 0.09 m.
    lack *= np.clip((0.13 - beside) / (0.13 - 0.09), 0.0, 1.0) * (others[..., 1] < _BELOW)
    # A box that is dragged over the floor, below 50 mm, turns in the hand.
    return np.maximum(lack.max(axis=-1), np.maximum(0.05 - box[..., 1], 0.0))


def haste(data: Any, box: str) -> np.ndarray:
    """By how much a box that is held is carried too fast, or jerked, so that it slips, (N,)."""
    dofs = [f"{box}_x", f"{box}_z"]
    velocity, pull = data.qvel[dofs], data.qacc[dofs]
    fast = np.maximum(np.hypot(velocity[..., 0], velocity[..., 1]) - 1.3, 0.0)  # m/s
    jerked = np.maximum(np.hypot(pull[..., 0], pull[..., 1]) - 10.0, 0.0)  # m/s2
    return 2.0 * fast + 0.05 * jerked
