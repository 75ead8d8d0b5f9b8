"""Films an episode into an MP4 (H.264, yuv420p) that browsers play, without a display.

    film = Film(Path("video.mp4"), environment.control_timestep())
    film.add(environment.physics)  # after the reset and after each step
    film.finish()

It plays in real time. A frame is drawn after every control step, or after every second, third, ...
where steps are shorter than 0.02 s, so that there are never more than 50 frames a second.

The only file that imports imageio_ffmpeg, for the ffmpeg program in its wheel, and that when a film
begins.
"""

import contextlib
import fractions
import math
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from limberjack.utils.files import partial_path

__all__ = ["Film", "frame_stride"]

_MAX_FRAME_RATE = 50.0  # frames per second; every screen shows it, and drawing more takes long
_ROUND_OFF = 1e-9  # so that steps of 0.02 s, whatever their last bit, are all drawn


def frame_stride(control_timestep: float) -> int:
    """The number of control steps, of so many seconds each, from one frame to the next."""
    return max(1, math.ceil(1.0 / (control_timestep * _MAX_FRAME_RATE) - _ROUND_OFF))


class Film:
    """A film under way; its file appears when it is finished."""

    def __init__(
        self,
        path: Path,
        control_timestep: float,
        camera: int | str = 0,
        height: int = 480,
        width: int = 640,
    ) -> None:
        """Begins a film; nothing is drawn or written yet.

        Args:
          path: of the MP4 file.
          control_timestep: seconds between two calls of `add`.
          camera: number or name of a camera of the model.
          height: pixels; even, as the format demands.
          width: pixels; even.

        Raises:
          ImportError: imageio-ffmpeg is not installed.
          ValueError: the height or width is odd.
        """
        if height % 2 or width % 2:
            raise ValueError(f"a film of {height}x{width} pixels: H.264 needs even numbers")
        self._ffmpeg = _find_ffmpeg()
        self._path = path
        self._partial = partial_path(path)
        self._view = {"height": height, "width": width, "camera_id": camera}
        self._stride = frame_stride(control_timestep)
        rate = 1.0 / (control_timestep * self._stride)
        self._frame_rate = fractions.Fraction(rate).limit_denominator(1000)
        self._steps = 0
        self._encoder: subprocess.Popen[bytes] | None = None
        # A file, because a pipe that nobody reads could block the encoder.
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `discard`)

    def add(self, physics: Any) -> None:
        """Draws the present state, if its turn has come.

        Raises:
          RenderingError: no OpenGL can be had.
          OSError: the film cannot be written.
        """
        if self._steps % self._stride == 0:
            self._write(physics.render(**self._view))
        self._steps += 1

    def finish(self) -> None:
        """Puts the file in its place.

        Raises:
          OSError: it cannot be written; nothing is left of it.
        """
        try:
            if self._end_encoder() != 0:
                raise self._write_error()
            os.replace(self._partial, self._path)
        finally:
            self.discard()

    def discard(self) -> None:
        """Ends the film and removes what was written; does nothing to a finished film."""
        if self._encoder is not None and self._encoder.returncode is None:
            self._encoder.kill()
            self._end_encoder()
        self._complaints.close()
        self._partial.unlink(missing_ok=True)

    def _write(self, frame: np.ndarray) -> None:
        if self._encoder is None:
            self._encoder = self._start_encoder()
        assert self._encoder.stdin is not None
        try:
            self._encoder.stdin.write(frame.tobytes())
        except BrokenPipeError:
            self._end_encoder()
            raise self._write_error() from None

    def _start_encoder(self) -> "subprocess.Popen[bytes]":
        size = f"{self._view['width']}x{self._view['height']}"
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", str(self._frame_rate)]
        # The index goes first (faststart), so that a browser plays while it loads.
        h264 = ["-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        return subprocess.Popen(
            [self._ffmpeg, "-y", "-v", "error", *raw, "-i", "-", *h264, str(self._partial)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._complaints,
            start_new_session=True,  # Ctrl-C is for this process to answer
        )

    def _end_encoder(self) -> int:
        """The encoder's exit status, after everything it was given is written."""
        if self._encoder is None:
            return 1
        assert self._encoder.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it ended early; its exit status says so
            self._encoder.stdin.close()
        return self._encoder.wait()

    def _write_error(self) -> OSError:
        self._complaints.seek(0)
        text = self._complaints.read().decode(errors="replace").strip()
        return OSError(f"{self._path} cannot be written: {text or 'it has no frames'}")


def _find_ffmpeg() -> str:
    try:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:  # RuntimeError: a wheel without the program
        raise ImportError("needs the extra 'video': pip install 'limberjack[video]'") from error
