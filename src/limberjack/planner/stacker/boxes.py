"""Poses of the stacker's boxes: flat, at rest, in each other's way."""

from typing import Any

import numpy as np

__all__ = ["FLAT", "HALF", "PASSES", "crest", "haste", "lies_too_low", "stands", "turned"]

HALF = 0.022  # metres; half a box
_RESTS = 0.1  # metres per second; what is slower may be let go
FLAT = 0.01  # of `turned`: 6 degrees
_BELOW = 0.18  # metres; boxes that are higher than this are falling, or on the arm
PASSES = 1.5 * HALF  # above another one a box that is carried keeps clear of it
_OFF_THE_FLOOR = 0.05  # metres; a box that is dragged over the floor turns in the hand
_CARRIED = 1.3  # metres per second; a box that is carried faster slips out of the hand
_SMOOTH = 10.0  # metres per second squared; so does one that is jerked more
_FROM, _UNTIL = 0.13, 0.09  # metres to the middle of another box: where it must begin to be above


def turned(data: Any, box: str | list[str]) -> Any:
    """0 for boxes that lie flat on any of their sides, 0.25 for one on an edge, (...)."""
    square = data.xmat[box, "xx"] ** 2
    return square * (1.0 - square)


def stands(data: Any, box: str, gap: float, allowed: float, stood: bool) -> bool:
    """Whether a box rests where it should; one that stood there may have moved a little."""
    if stood:
        return gap < 2.0 * allowed
    speed = np.abs(data.qvel[[f"{box}_x", f"{box}_z"]]).max()
    return bool(gap < allowed and speed < _RESTS and turned(data, box) < FLAT)


def crest(data: Any, boxes: list[str], start: float, end: float) -> float:
    """Height of the highest of the boxes between two places, metres; 0 if there is none."""
    low, high = min(start, end) - 2.5 * HALF, max(start, end) + 2.5 * HALF
    places = data.site_xpos[boxes]
    tops = [float(p[2]) + HALF for p in places if low < p[0] < high and p[2] < _BELOW]
    return max(tops, default=0.0)


def lies_too_low(box: np.ndarray, others: np.ndarray) -> np.ndarray:
    """By how much a box must be higher to pass the others near by and the floor, metres, (N,).

    Args:
      box: x and z of the one that is carried, (N, 2).
      others: of the others, (N, n, 2).
    """
    beside = np.abs(others[..., 0] - box[..., None, 0])
    lack = others[..., 1] + HALF + PASSES - box[..., None, 1]
    lack *= np.clip((_FROM - beside) / (_FROM - _UNTIL), 0.0, 1.0) * (others[..., 1] < _BELOW)
    return np.maximum(lack.max(axis=-1), np.maximum(_OFF_THE_FLOOR - box[..., 1], 0.0))


def haste(data: Any, box: str) -> np.ndarray:
    """By how much a box that is held is carried too fast, or jerked, (N,)."""
    dofs = [f"{box}_x", f"{box}_z"]
    velocity, pull = data.qvel[dofs], data.qacc[dofs]
    fast = np.maximum(np.hypot(velocity[..., 0], velocity[..., 1]) - _CARRIED, 0.0)
    return 2.0 * fast + 0.05 * np.maximum(np.hypot(pull[..., 0], pull[..., 1]) - _SMOOTH, 0.0)
