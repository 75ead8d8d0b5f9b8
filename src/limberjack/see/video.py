"""Films as MP4 (H.264, yuv420p), which browsers play, or as GIF, without a display.

    film = Film(Path("video.mp4"), environment.control_timestep())
    film.add(environment.physics)  # after the reset and after each step
    film.finish()

A film plays in real time. A frame is drawn after every control step; if steps are shorter than
0.02 s, after every second, third, ... step, so that there are at most 50 frames per second, and in
a GIF at most 25. `Writer` takes frames that are drawn already; `mosaic` joins pictures into one.

The ffmpeg program is found as a film begins. A long film needs no more memory than a short one.
"""

import contextlib
import fractions
import math
import signal
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from limberjack.utils.ffmpeg import find_ffmpeg
from limberjack.utils.files import Partial

__all__ = [
    "SIZE",
    "Film",
    "Rendered",
    "Writer",
    "first_camera",
    "frame_stride",
    "mosaic",
]

SIZE = 480, 640  # height and width of a film by default, pixels

# Frames per second, by the ending of the file. Every screen shows 50, and drawing more is slow. A
# GIF counts in hundredths of a second, and is large.
_MAX_FRAME_RATES = {".mp4": 50.0, ".gif": 25.0}
_ROUND_OFF = 1e-9  # so that steps of 0.02 s, whatever their last bit, are all drawn

# The index comes first (faststart), so that a browser plays the file while it loads.
_H264 = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
# A GIF is made from a lossless file, which is read twice: its 256 colours are those of all frames.
_LOSSLESS = ["-c:v", "libx264rgb", "-qp", "0", "-preset", "ultrafast"]
_COLOURS = "palettegen=stats_mode=full"
_COLOURED = "paletteuse=dither=bayer:bayer_scale=4:diff_mode=rectangle"


def frame_stride(control_timestep: float, most: float = _MAX_FRAME_RATES[".mp4"]) -> int:
    """The number of control steps from one frame to the next.

    Args:
      control_timestep: seconds.
      most: the highest number of frames per second.
    """
    return max(1, math.ceil(1.0 / (control_timestep * most) - _ROUND_OFF))


def mosaic(pictures: np.ndarray | Sequence[np.ndarray], columns: int | None = None) -> np.ndarray:
    """Pictures joined into one, row by row from the upper left; the rest is black.

    Args:
      pictures: (n, height, width, 3), n of at least 1.
      columns: number of pictures side by side; by default that of the rows, or one more.

    Returns:
      (rows * height, columns * width, 3).

    Raises:
      ValueError: there are no pictures, they differ in size, or `columns` is less than 1.
    """
    sizes = sorted({np.shape(picture) for picture in pictures})
    if len(sizes) != 1 or len(sizes[0]) != 3:
        raise ValueError(f"pictures of shapes {sizes}; expected one shape (height, width, 3)")
    if columns is None:
        columns = math.ceil(math.sqrt(len(pictures)))
    if columns < 1:
        raise ValueError(f"columns is {columns}; expected at least 1")
    height, width, channels = sizes[0]
    rows = math.ceil(len(pictures) / columns)
    stacked = np.asarray(pictures)
    tiles = np.zeros((rows * columns, height, width, channels), stacked.dtype)
    tiles[: len(stacked)] = stacked
    tiles = tiles.reshape(rows, columns, height, width, channels).swapaxes(1, 2)
    return tiles.reshape(rows * height, columns * width, channels)


class Writer:
    """A video of frames that are drawn already; its file appears when it is finished."""

    def __init__(self, path: Path, height: int, width: int, frame_rate: float) -> None:
        """Begins a video; nothing is written yet.

        Args:
          path: of the file; it ends in .mp4 or .gif.
          height: pixels; even in an MP4, as the format demands.
          width: pixels; even in an MP4.
          frame_rate: frames per second.

        Raises:
          ImportError: imageio-ffmpeg is not installed.
          ValueError: the path has another ending, or the height or width is odd.
        """
        self._ending = _ending(path)
        if self._ending == ".mp4" and (height % 2 or width % 2):
            raise ValueError(f"a film of {height}x{width} pixels: H.264 needs even numbers")
        self._ffmpeg = find_ffmpeg()
        self._path = path
        self._partial: Partial | None = None
        self._lossless: Partial | None = None  # of a GIF's frames
        self._shape = height, width, 3
        self._frame_rate = fractions.Fraction(float(frame_rate)).limit_denominator(1000)
        self._encoder: subprocess.Popen[bytes] | None = None
        # A file, because a full pipe would block the encoder.
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `discard`)

    def write(self, frame: np.ndarray) -> None:
        """Adds a frame, (height, width, 3) uint8.

        Raises:
          OSError: the video cannot be written.
          ValueError: the frame is of another shape or dtype.
        """
        if frame.shape != self._shape or frame.dtype != np.uint8:
            raise ValueError(
                f"a frame of shape {frame.shape} and dtype {frame.dtype}; expected {self._shape} "
                "and uint8"
            )
        if self._encoder is None:
            self._encoder = self._start_encoder()
        assert self._encoder.stdin is not None
        try:
            self._encoder.stdin.write(frame.tobytes())
        except BrokenPipeError:
            self._end_encoder()
            raise self._write_error() from None

    def finish(self) -> None:
        """Completes the file and moves it to its path.

        Raises:
          OSError: it cannot be written; nothing of it remains.
        """
        try:
            if self._end_encoder() != 0:
                raise self._write_error()
            if self._ending == ".gif" and self._write_gif() != 0:
                raise self._write_error()
            assert self._partial is not None
            self._partial.finish()
        finally:
            self.discard()

    def discard(self) -> None:
        """Ends the video and removes its file; does nothing to a finished one."""
        if self._encoder is not None and self._encoder.returncode is None:
            self._encoder.kill()
            self._end_encoder()
        self._complaints.close()
        for partial in (self._partial, self._lossless):
            if partial is not None:
                partial.discard()

    def _start_encoder(self) -> "subprocess.Popen[bytes]":
        height, width, _ = self._shape
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
        raw += ["-r", str(self._frame_rate), "-i", "-", "-an"]
        is_gif = self._ending == ".gif"
        try:
            self._partial = written = Partial(self._path)
            if is_gif:
                self._lossless = written = Partial(self._path, ".mkv")
        except OSError as error:
            raise OSError(f"{self._path} cannot be written: {error.strerror}") from error
        coded = [*(_LOSSLESS if is_gif else _H264), _address(written.path)]
        return subprocess.Popen(
            [self._ffmpeg, "-y", "-v", "error", *raw, *coded],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._complaints,
            start_new_session=True,  # Ctrl-C is handled by this process alone
        )

    def _end_encoder(self) -> int:
        """The encoder's exit status, after it has written all of its frames."""
        if self._encoder is None:
            return 1
        assert self._encoder.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it ended early; its exit status says so
            self._encoder.stdin.close()
        return self._encoder.wait()

    def _write_gif(self) -> int:
        """Makes a GIF of the lossless file; returns the exit status."""
        assert self._partial is not None
        assert self._lossless is not None
        frames = ["-i", _address(self._lossless.path)]
        file = _address(self._partial.path)
        graph = ["-filter_complex", f"[0:v]{_COLOURS}[colours];[1:v][colours]{_COLOURED}"]
        return subprocess.run(
            [self._ffmpeg, "-y", "-v", "error", *frames, *frames, *graph, file],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._complaints,
            start_new_session=True,
            check=False,
        ).returncode

    def _write_error(self) -> OSError:
        self._complaints.seek(0)
        why = self._complaints.read().decode(errors="replace").strip()
        if self._encoder is None:
            why = "it has no frames"
        elif not why:
            why = _ending_of(self._encoder.returncode)
        return OSError(f"{self._path} cannot be written: {why}")


class Rendered(Protocol):
    """An object that can be drawn, such as `limberjack.mujoco.Physics`."""

    def render(self, height: int, width: int, camera_id: int | str) -> np.ndarray:
        """A picture, (height, width, 3) uint8."""
        ...


class _HasCameras(Protocol):
    """A model, such as `mujoco.MjModel`."""

    ncam: int


def first_camera(model: _HasCameras) -> int:
    """The number of a model's first camera; that of the free camera, -1, if it has none."""
    return 0 if model.ncam else -1


class Film(Writer):
    """A film of a running simulation; its file appears when it is finished."""

    def __init__(
        self,
        path: Path,
        control_timestep: float,
        camera: int | str = 0,
        height: int = SIZE[0],
        width: int = SIZE[1],
    ) -> None:
        """Begins a film; nothing is drawn or written yet.

        Args:
          path: of the file; it ends in .mp4 or .gif.
          control_timestep: seconds between two calls of `add`.
          camera: number or name of a camera of the model.
          height: pixels; even in an MP4, as the format demands.
          width: pixels; even in an MP4.

        Raises:
          ImportError: imageio-ffmpeg is not installed.
          ValueError: the path has another ending, or the height or width is odd.
        """
        self._stride = frame_stride(control_timestep, _MAX_FRAME_RATES[_ending(path)])
        frame_rate = 1.0 / (control_timestep * self._stride)
        super().__init__(path, height, width, frame_rate)
        self._height, self._width, self._camera = height, width, camera
        self._steps = 0

    def add(self, physics: Rendered) -> None:
        """Draws the present state, if the film has a frame of this step.

        Raises:
          RenderingError: OpenGL is not available.
          OSError: the film cannot be written.
        """
        self.add_picture(lambda: physics.render(self._height, self._width, self._camera))

    def add_picture(self, draw: Callable[[], np.ndarray]) -> None:
        """Adds the picture that `draw` returns, which is called only if this step has a frame."""
        if self._steps % self._stride == 0:
            self.write(draw())
        self._steps += 1


def _ending(path: Path) -> str:
    """The ending of a film's name, in lower case."""
    ending = path.suffix.lower()
    if ending not in _MAX_FRAME_RATES:
        raise ValueError(f"a film called {path.name!r}; expected a name that ends in .mp4 or .gif")
    return ending


def _ending_of(status: int) -> str:
    """A description of the exit status of an encoder that printed no error."""
    if status < 0:  # a signal, such as that of a limit on the size of files
        return f"ffmpeg was ended: {signal.strsignal(-status)}"
    return f"ffmpeg ended with status {status}"


def _address(path: Path) -> str:
    """The file's address for ffmpeg, which would read `12:30.mp4` as a protocol."""
    return f"file:{path}"
