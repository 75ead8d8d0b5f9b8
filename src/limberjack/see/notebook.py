"""`show`: pictures and films inline in a Jupyter notebook.

    limberjack.show(env.render())                       # a picture
    limberjack.show(frames, fps=40)                     # a film of a list of pictures
    limberjack.show([batch.render(height=120, width=160) for ...], fps=40)  # of a batch: a mosaic

The result has `_repr_html_`, which notebooks call. It contains its pictures, which are saved in the
notebook's file. Nothing of Jupyter is imported. A film needs the extra 'video'; a picture does not.
"""

import base64
import math
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from limberjack.see.video import Writer, mosaic
from limberjack.utils import png

__all__ = ["Shown", "show"]

_LEAST_WIDTH = 320  # pixels; smaller pictures, such as an agent's, are enlarged


class Shown:
    """A picture or a film for a notebook."""

    def __init__(self, html: str) -> None:
        """Takes the HTML of the picture or film."""
        self._html = html

    def _repr_html_(self) -> str:
        return self._html

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._html)} characters of HTML, for a notebook>"


def show(frames: object, fps: float = 30.0) -> Shown:
    """A picture or a film that a notebook shows inline when it is a cell's last line.

    Args:
      frames: an array of uint8, or a list or generator of arrays: a picture (height, width, 3), a
        film (frames, height, width, 3), or a film of a batch (frames, rows, height, width, 3).
      fps: frames per second; 1 / env.control_timestep() plays in real time.

    Raises:
      ImportError: it is a film, and the extra 'video' is not installed.
      ValueError: the arrays are not pictures, or `fps` is not a positive number.
    """
    if isinstance(frames, Iterable) and not isinstance(frames, np.ndarray):
        frames = list(frames)
        shapes = sorted({np.shape(frame) for frame in frames})
        if len(shapes) > 1:
            raise ValueError(f"frames have shapes {shapes}; expected one shape for all of them")
    pictures = np.asarray(frames)
    if pictures.ndim == 5 and pictures.size:
        pictures = np.stack([mosaic(rows) for rows in pictures])
    is_rgb = pictures.ndim in (3, 4) and pictures.shape[-1] == 3 and pictures.size
    if not is_rgb or pictures.dtype != np.uint8:
        raise ValueError(
            f"frames have shape {pictures.shape} and dtype {pictures.dtype}; expected uint8 and "
            "(height, width, 3), (frames, height, width, 3) or (frames, rows, height, width, 3)"
        )
    if not (math.isfinite(fps) and fps > 0):
        raise ValueError(f"fps is {fps}; expected a positive number of frames per second")
    width = pictures.shape[-2]
    style = f"width: {width * math.ceil(_LEAST_WIDTH / width)}px; max-width: 100%"
    if width < _LEAST_WIDTH:
        style += "; image-rendering: pixelated"
    if pictures.ndim == 3:
        source = _data("image/png", png.encode(pictures))
        return Shown(f'<img src="{source}" alt="a rendered frame" style="{style}">')
    source = _data("video/mp4", _encoded(pictures, fps))
    return Shown(
        f'<video src="{source}" style="{style}" aria-label="{len(pictures)} rendered frames" '
        "controls autoplay loop muted playsinline></video>"
    )


def _encoded(pictures: np.ndarray, fps: float) -> bytes:
    """An MP4 of the pictures; an odd side, which H.264 does not allow, is extended by one pixel."""
    _, height, width, _ = pictures.shape
    pictures = np.pad(pictures, ((0, 0), (0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "film.mp4"
        writer = Writer(path, height + height % 2, width + width % 2, fps)
        try:
            for picture in pictures:
                writer.write(picture)
            writer.finish()
        finally:
            writer.discard()
        return path.read_bytes()


def _data(kind: str, content: bytes) -> str:
    """A data URL of the content."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
