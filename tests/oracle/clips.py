"""AMC files for comparisons: text of a clip, and clips like those of the CMU database."""

from collections.abc import Sequence

import numpy as np

__all__ = ["KINDS", "clip", "text_of"]

_VALUES = 62  # per frame of the CMU skeleton
_RATE = 120  # frames per second

KINDS = ["waves", "random walk", "noise", "constant"]


def clip(kind: str, frames: int, seed: int = 0) -> np.ndarray:
    """Values of a clip, (frames, 62), degrees."""
    random = np.random.RandomState(seed)
    if kind == "waves":
        phase = 2 * np.pi * np.arange(frames)[:, None] / _RATE * random.uniform(0.2, 2, _VALUES)
        return 30 * np.sin(phase + random.uniform(0, 6, _VALUES))
    if kind == "random walk":
        return np.cumsum(random.normal(size=(frames, _VALUES)), axis=0)
    if kind == "noise":
        return random.normal(size=(frames, _VALUES)) * 60
    return np.tile(random.normal(size=_VALUES) * 20, (frames, 1))


def text_of(values: np.ndarray | Sequence[Sequence[float]]) -> str:
    """An AMC file with all values of a frame in one line, exactly."""
    lines = [":FULLY-SPECIFIED", ":DEGREES"]
    for number, frame in enumerate(np.asarray(values).tolist(), 1):
        lines += [str(number), " ".join(["all", *map(repr, frame)])]
    return "\n".join([*lines, ""])
