"""Films an episode into an MP4 (H.264, yuv420p) that browsers play, without a display.

    film = Film(Path("video.mp4"), environment.control_timestep())
    film.add(environment.physics)  # after the reset and after every step
    film.finish()

It plays in real time: every control step is a frame at up to 50 frames a second; of shorter steps
every second, third, ... is. The only file that imports imageio, and that when a film begins.
"""

import math
from pathlib import Path
from typing import Any

from limberjack.report.files import replacing

__all__ = ["Film", "frame_stride"]

_MAX_FRAME_RATE = 50.0  # frames per second; every screen shows it, and drawing more takes long
_ROUND_OFF = 1e-9  # so that steps of 0.02 s, whatever their last bit, are all drawn


def frame_stride(control_timestep: float) -> int:
    """How many control steps, of so many seconds, go into one frame."""
    return max(1, math.ceil(1.0 / (control_timestep * _MAX_FRAME_RATE) - _ROUND_OFF))


class Film:
    """A film under way; the file appears when it is finished."""

    def __init__(
        self,
        path: Path,
        control_timestep: float,
        camera: int | str = 0,
        height: int = 480,
        width: int = 640,
    ) -> None:
        """Begins a film.

        Args:
          path: of the MP4 file.
          control_timestep: seconds between two calls of `add`.
          camera: number or name of a camera of the model.
          height: pixels, an even number, as the format demands.
          width: pixels, an even number.

        Raises:
          ImportError: imageio or its ffmpeg is not installed.
        """
        try:
            import imageio.v2 as imageio
            import imageio_ffmpeg

            imageio_ffmpeg.get_ffmpeg_exe()
        except (ImportError, RuntimeError) as error:  # RuntimeError: a wheel without a program
            raise ImportError("needs the extra 'video': pip install 'limberjack[video]'") from error

        self._view = {"camera_id": camera, "height": height, "width": width}
        self._stride = frame_stride(control_timestep)
        self._steps = 0
        self._replacing = replacing(path)
        self._writer: Any = imageio.get_writer(  # Any: imageio has no types for its writers
            self._replacing.__enter__(),
            format="FFMPEG",  # type: ignore[arg-type]
            fps=1.0 / (control_timestep * self._stride),
            codec="libx264",
            pixelformat="yuv420p",
            macro_block_size=2,
            # The index comes first, so that a browser plays while it loads.
            output_params=["-movflags", "+faststart"],
            ffmpeg_log_level="error",
        )

    def add(self, physics: Any) -> None:
        """Draws the present state, if its turn has come.

        Raises:
          RenderingError: no OpenGL can be had.
          OSError: the film cannot be written.
        """
        if self._steps % self._stride == 0:
            self._writer.append_data(physics.render(**self._view))
        self._steps += 1

    def finish(self) -> None:
        """Ends the film and puts the file in its place."""
        try:
            self._writer.close()
        except BaseException as error:
            self._replacing.__exit__(type(error), error, error.__traceback__)
            raise
        self._replacing.__exit__(None, None, None)

    def discard(self) -> None:
        """Ends the film and removes what was written."""
