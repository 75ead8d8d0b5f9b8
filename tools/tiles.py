"""A film of several tasks side by side, each in a tile with a caption.

    tile = np.concatenate([picture, caption("walker", "walk", "learned")])
    write_film(Path("film.gif"), [tiles_of_one_task, tiles_of_another])

`learned_pictures` and `playing_film` make their films of it.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pictures

from limberjack import policies, suite
from limberjack.rl import control
from limberjack.see.video import Writer, mosaic

__all__ = [
    "FRAME_RATE",
    "MOST_BYTES",
    "PICTURE",
    "STRIDES",
    "TILE",
    "caption",
    "columns_of",
    "play",
    "write_film",
]

MOST_BYTES = 4_000_000  # of a film, so that README loads quickly
TILE = 140, 128  # pixels of a task in a film, with its caption
PICTURE = 112, 128  # pixels of it without its caption
FRAME_RATE = 12.5  # a GIF counts in hundredths of a second
STRIDES = 1, 2, 3  # frames to the next one, more of them in a film that would be too large

_CAPTION = TILE[0] - PICTURE[0]  # pixels
_DOTS_PER_INCH = 100
_COLUMNS = 7


def columns_of(count: int) -> int:
    """The number of tasks side by side in a film."""
    return min(count, _COLUMNS)


def caption(domain: str, task: str, right: str) -> np.ndarray:
    """The names of a task, and a word or a number at their right, (_CAPTION, width, 3) uint8."""
    # Here, because `make docs` only reads the index, and does not install matplotlib.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size = TILE[1] / _DOTS_PER_INCH, _CAPTION / _DOTS_PER_INCH
    figure = Figure(figsize=size, dpi=_DOTS_PER_INCH, facecolor="black")
    canvas = FigureCanvasAgg(figure)
    for text, x, y, align in (
        (domain, 0.03, 0.55, "left"),
        (task, 0.03, 0.1, "left"),
        (right, 0.97, 0.55, "right"),
    ):
        figure.text(x, y, text, ha=align, va="bottom", color="white", fontsize=7)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def play(
    domain: str, task: str, policy: str, seed: int, seconds: float
) -> Iterator[Callable[[int, int], np.ndarray]]:
    """At each frame of a film of an episode, a function that draws a picture of (height, width).

    Args:
      domain: such as 'walker'.
      task: such as 'walk'.
      policy: the name of what acts, as of `--policy`.
      seed: of the episode.
      seconds: of the episode that are shown.
    """
    environment = suite.load(domain, task, {"random": seed})
    camera = pictures.camera_of(domain, task)
    time_step = environment.reset()
    act = policies.find(policy, environment).begin_alone(environment, seed)
    for steps in _steps(environment, seconds):
        for _ in range(steps):
            time_step = environment.step(act(time_step.observation))
        yield lambda height, width: environment.physics.render(height, width, camera)
    environment.close()


def _steps(environment: control.Environment, seconds: float) -> Iterator[int]:
    """The number of control steps before each frame."""
    done = 0
    for frame in range(round(seconds * FRAME_RATE)):
        due = int(np.ceil(frame / FRAME_RATE / environment.control_timestep() - 1e-9))
        yield due - done
        done = due


def write_film(path: Path, tiles: Sequence[Sequence[np.ndarray]], most: int = MOST_BYTES) -> None:
    """Writes a film of the tiles of all tasks, of fewer frames if it would be too large.

    Raises:
      ValueError: it is too large with the fewest frames; it is there.
    """
    columns = columns_of(len(tiles))
    frames = [mosaic(moment, columns) for moment in zip(*tiles, strict=True)]
    for stride in STRIDES:
        height, width, _ = frames[0].shape
        writer = Writer(path, height, width, FRAME_RATE / stride)
        for frame in frames[::stride]:
            writer.write(frame)
        writer.finish()
        if path.stat().st_size <= most:
            return
    raise ValueError(f"{path} has {path.stat().st_size} bytes; expected at most {most}")
