"""Backgrounds: procedural noise, and the frames of clips.

    noise = Noise(stream)
    noise.at(7)                                     # (128, 128, 3) uint8, seven changes later
    shown = Shown.random(stream, clips, is_moving=True)
    shown = Shown.next(number, clips, is_moving=True)
    shown.at(7)                                     # (256, 256, 3) uint8
    on_green_screen(picture, frame)

Clips are chosen as in the Distracting Control Suite (background.py) or in turn, as in DMC-GB, whose
green screen is that of its wrappers.py; see `options`.
"""

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np

from limberjack.worlds.appearance.media import Clip, resized

__all__ = ["Noise", "Shown", "is_green", "on_green_screen"]

# Ours.
_NOISE_SIDE = 128  # pixels
_WAVES = 12  # for each channel
_MOST_WAVES = 4  # across a side, in either direction
_TURN = 0.2  # greatest phase that a wave gains per change, radians

# DMC-GB: least hue (degrees), saturation and value of the pixels that a video replaces.
_LOWEST = 100.0, 80.0, 70.0
_HIGHEST_HUE = 185.0
_FULL = 255.0


class Noise:
    """Smooth colours that move, a sum of waves."""

    def __init__(self, stream: np.random.RandomState) -> None:
        """Draws the waves."""
        shape = 3, _WAVES
        self._across = stream.randint(-_MOST_WAVES, _MOST_WAVES + 1, shape)
        self._along = stream.randint(-_MOST_WAVES, _MOST_WAVES + 1, shape)
        self._phases = stream.uniform(0.0, 2 * np.pi, shape)
        self._turns = stream.uniform(-_TURN, _TURN, shape)
        self._means = stream.uniform(0.2, 0.8, 3)

    def at(self, changes: int) -> np.ndarray:
        """The picture after a number of changes, (128, 128, 3) uint8."""
        at = np.arange(_NOISE_SIDE) * (2 * np.pi / _NOISE_SIDE)
        x = self._across[..., None] * at + (self._phases + changes * self._turns)[..., None]
        y = self._along[..., None] * at
        # cos(x + y) of all waves, summed by products of matrices.
        waves = np.cos(y).swapaxes(-1, -2) @ np.cos(x) - np.sin(y).swapaxes(-1, -2) @ np.sin(x)
        values = self._means[:, None, None] + waves / np.sqrt(8 * _WAVES)
        return np.moveaxis((values.clip(0.0, 1.0) * _FULL).astype(np.uint8), 0, -1)


@dataclasses.dataclass(frozen=True)
class Shown:
    """A clip, and the frames of it that an episode shows.

    Attributes:
      clip: the clip.
      first: the number of the first frame.
      direction: 1 or -1; the order turns round at both ends. 0: one frame only.
      is_loop: whether it begins again after the last frame instead.
    """

    clip: Clip
    first: int = 0
    direction: int = 1
    is_loop: bool = False

    @classmethod
    def random(cls, stream: np.random.RandomState, clips: Sequence[Clip], is_moving: bool) -> Self:
        """Any clip, from any of its frames on, in either direction."""
        clip = clips[stream.randint(len(clips))]
        first, direction = int(stream.randint(clip.length)), int(stream.choice([-1, 1]))
        return cls(clip, first, direction if is_moving else 0)

    @classmethod
    def next(cls, number: int, clips: Sequence[Clip], is_moving: bool) -> Self:
        """The clip of an episode by its number, from the beginning."""
        return cls(clips[number % len(clips)], 0, int(is_moving), is_loop=True)

    def at(self, changes: int) -> np.ndarray:
        """The frame after a number of changes, (SIDE, SIDE, 3) uint8."""
        if not self.direction:
            return self.clip.frame(self.first)
        length = self.clip.length
        if self.is_loop:
            return self.clip.frame((self.first + changes) % length)
        # Forwards, with the last frame twice as in DCS, and backwards without the first one.
        order = [*range(length), *range(length - 1, 0, -1)]
        is_backward = self.direction < 0 and self.first > 0
        place = 2 * length - 1 - self.first if is_backward else self.first
        return self.clip.frame(order[(place + changes) % len(order)])


def is_green(picture: np.ndarray) -> np.ndarray:
    """A mask of the pixels of a picture, (h, w, 3) uint8, that are green enough to be replaced."""
    red, green, blue = (picture[..., i].astype(np.float64) for i in range(3))
    value = np.maximum(np.maximum(red, green), blue)
    spread = value - np.minimum(np.minimum(red, green), blue)
    safe = np.where(spread > 0, spread, 1.0)
    # Degrees. Only where green, or blue, is the largest channel can the hue be in the range.
    hue = np.where(value == green, 120 + 60 * (blue - red) / safe, 240 + 60 * (red - green) / safe)
    hue = np.where((value == red) & (spread > 0), 60 * ((green - blue) / safe % 6), hue)
    saturation = _FULL * spread / np.where(value > 0, value, 1.0)
    is_hue = (hue >= _LOWEST[0]) & (hue <= _HIGHEST_HUE)
    return is_hue & (spread > 0) & (saturation >= _LOWEST[1]) & (value >= _LOWEST[2])


def on_green_screen(picture: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """The picture, (h, w, 3) uint8, with a frame in the place of its green pixels."""
    behind = resized(frame, *picture.shape[:2])
    return np.where(is_green(picture)[..., None], behind, picture)
