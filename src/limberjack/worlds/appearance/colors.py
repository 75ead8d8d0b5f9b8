"""Colours of materials and textures, drawn for an episode.

    walk = ColorWalk(stream, materials, scale=0.1, is_moving=True)
    walk.at(7)                                  # (n, 3): after seven changes
    floor, body, sky = palette(stream, deviation=0.1)

`ColorWalk` has the ranges of the Distracting Control Suite, `palette` those of DMC-GB; see
`options`.
"""

from typing import NamedTuple

import numpy as np

__all__ = ["GREEN", "ColorWalk", "Palette", "palette", "repainted_floor", "repainted_sky"]

GREEN = np.array([51, 204, 51], np.uint8)  # DMC-GB: (0.2, 0.8, 0.2), which a video replaces

_STEP = 0.03  # standard deviation of a change, times the scale: suite_utils.py of DCS
# Of the suite's common/materials.xml and common/skybox.xml, around which DMC-GB draws.
_FLOOR, _BODY, _SKY = (0.1, 0.2, 0.3), (0.7, 0.5, 0.3), (0.4, 0.6, 0.8)
_LIGHTER = 0.1  # by which the floor's second colour exceeds the first, in all 200 sets of DMC-GB
_FULL = 255  # of a channel


class ColorWalk:
    """Colours that begin anywhere in a range, and may walk in it."""

    def __init__(
        self, stream: np.random.RandomState, original: np.ndarray, scale: float, is_moving: bool
    ) -> None:
        """Draws the first colours.

        Args:
          stream: the colours' own.
          original: (n, 3), 0 to 1.
          scale: greatest distance from the original, in each channel.
          is_moving: whether they change.
        """
        self.original = original.copy()
        self._stream = stream
        self._low = np.clip(original - scale, 0.0, 1.0)
        self._high = np.clip(original + scale, 0.0, 1.0)
        self._deviation = _STEP * scale if is_moving else 0.0
        self._colors = self._low + stream.uniform(size=original.shape) * (self._high - self._low)
        self.changes = 0  # made so far

    def at(self, changes: int) -> np.ndarray:
        """The colours after a number of changes, at least those made so far, (n, 3)."""
        while self.changes < changes:
            self.changes += 1
            if self._deviation:
                moved = self._colors + self._stream.randn(*self._colors.shape) * self._deviation
                self._colors = np.clip(moved, self._low, self._high)
        return self._colors


class Palette(NamedTuple):
    """Colours, (3,) each, 0 to 1."""

    floor: np.ndarray
    second_floor: np.ndarray
    body: np.ndarray
    sky: np.ndarray


def palette(stream: np.random.RandomState, deviation: float) -> Palette:
    """Colours normal around the suite's, clipped."""
    drawn = [np.clip(stream.normal(mean, deviation), 0.0, 1.0) for mean in (_FLOOR, _BODY, _SKY)]
    floor, body, sky = drawn
    return Palette(floor, np.minimum(floor + _LIGHTER, 1.0), body, sky)


def repainted_floor(texture: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """A checkerboard of four fields, (h, w, 3) uint8, in two other colours.

    Its edge remains, which a texture of fewer than four pixels in a row has not.
    """
    height, width = texture.shape[:2]
    row, column = height // 4, width // 4
    other = min(width - column, width - 1)
    edge = int(min(height, width) >= 4)
    painted = texture.copy()
    within = np.s_[edge : height - edge, edge : width - edge]
    inside, source = painted[within], texture[within]
    for old, new in ((texture[row, column], first), (texture[row, other], second)):
        inside[(source == old).all(axis=-1)] = np.rint(np.asarray(new) * _FULL).astype(np.uint8)
    return painted


def repainted_sky(texture: np.ndarray, color: np.ndarray) -> np.ndarray:
    """A gradient from a colour to black, (h, w, 3) uint8, from another colour; its stars remain."""
    is_star = (texture == _FULL).all(axis=-1)
    brightest = texture[~is_star].max(axis=0, initial=1)
    painted = np.rint(texture * (np.asarray(color) * _FULL / brightest)).clip(0, _FULL)
    painted[is_star] = _FULL
    return painted.astype(np.uint8)
