"""Film the bundled policies, for README and the domains' pages.

    python tools/learned_pictures.py

Each policy plays the first seconds of an episode with a seed that training has not seen. Written
are docs/images/learned.gif, a film of all tasks side by side with their mean returns;
docs/images/learned/DOMAIN.png, with four pictures of each task of a domain; and, beside these,
episodes.json: which policies they show. Call it again when a policy has been bundled. Drawing takes
a few minutes with a software renderer.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import picture_index
import typer

from limberjack import policies, suite
from limberjack.see.video import Writer, mosaic
from limberjack.suite import base
from limberjack.utils import png
from limberjack.utils.files import replacing

__all__ = ["FILM", "FOLDER", "MOST_BYTES", "TILE", "Episode", "columns_of", "episodes", "main"]

FOLDER = Path(__file__).parents[1] / "docs" / "images" / "learned"
FILM = FOLDER.with_suffix(".gif")
MOST_BYTES = 4_000_000  # of the film, so that README loads quickly
TILE = 140, 128  # pixels of a task in the film, with its caption
PICTURE = 120, 160  # pixels of a task's picture, of which there are four side by side

_CAPTION = 28  # pixels
_DOTS_PER_INCH = 100
_COLUMNS = 7
_SEED = 40_000  # the first one of the scores
_SECONDS = 5  # enough for a pendulum to swing up, and for a few steps of a walker
_FRAME_RATE = 12.5  # a GIF counts in hundredths of a second
_PICTURES = 4
_STRIDES = 1, 2, 3  # frames to the next one, more of them in a film that would be too large


class Episode(NamedTuple):
    """Facts about the pictures of a task."""

    sha256: str  # of the policy's file
    seed: int
    seconds: list[float]  # of each picture
    mean: float  # return over the seeds of the policy's scores


def episodes(folder: Path = FOLDER) -> dict[str, Episode]:
    """The facts of all pictures in a folder, by 'domain-task'; empty if there are none."""
    return picture_index.read(folder, Episode)


def columns_of(count: int) -> int:
    """The number of tasks side by side in a film."""
    return min(count, _COLUMNS)


def _played(bundled: policies.Bundled, seconds: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Tiles of an episode for the film, and four pictures side by side."""
    domain, task = bundled.domain, bundled.task
    environment = suite.load(domain, task, {"random": _SEED})
    shown = getattr(suite.module_of(domain), "PICTURES", {}).get(task, base.Picture())
    time_step = environment.reset()
    act = policies.find("pretrained", environment).begin_alone(environment, _SEED)
    caption = _caption(domain, task, _mean(bundled))
    frames = round(seconds * _FRAME_RATE)
    drawn = _drawn_frames(frames)
    tiles, pictures, steps = [], [], 0
    for frame in range(frames):
        while steps * environment.control_timestep() < frame / _FRAME_RATE - 1e-9:
            time_step = environment.step(act(time_step.observation))
            steps += 1
        tile = environment.physics.render(TILE[0] - _CAPTION, TILE[1], shown.camera)
        tiles.append(np.concatenate([tile, caption]))
        if frame in drawn:
            pictures.append(environment.physics.render(*PICTURE, shown.camera))
    environment.close()
    return tiles, mosaic(pictures, _PICTURES)


def _drawn_frames(frames: int) -> list[int]:
    """The frames of a film that are pictures too."""
    return np.linspace(0, frames - 1, _PICTURES).round().astype(int).tolist()


def _mean(bundled: policies.Bundled) -> float:
    assert bundled.card.scores is not None
    return bundled.card.scores.mean


def _caption(domain: str, task: str, mean: float) -> np.ndarray:
    """The names of a task and the mean return, (_CAPTION, width, 3) uint8."""
    # Here, because `make docs` only reads the index, and does not install matplotlib.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size = TILE[1] / _DOTS_PER_INCH, _CAPTION / _DOTS_PER_INCH
    figure = Figure(figsize=size, dpi=_DOTS_PER_INCH, facecolor="black")
    canvas = FigureCanvasAgg(figure)
    for text, x, y, align in (
        (domain, 0.03, 0.55, "left"),
        (task, 0.03, 0.1, "left"),
        (f"{mean:.0f}", 0.97, 0.55, "right"),
    ):
        figure.text(x, y, text, ha=align, va="bottom", color="white", fontsize=7)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _write_film(path: Path, tiles: Sequence[Sequence[np.ndarray]], most: int = MOST_BYTES) -> None:
    """Writes a film of the tiles of all tasks, of fewer frames if it would be too large.

    Raises:
      ValueError: it is too large with the fewest frames; it is there.
    """
    columns = columns_of(len(tiles))
    frames = [mosaic(moment, columns) for moment in zip(*tiles, strict=True)]
    for stride in _STRIDES:
        height, width, _ = frames[0].shape
        writer = Writer(path, height, width, _FRAME_RATE / stride)
        for frame in frames[::stride]:
            writer.write(frame)
        writer.finish()
        if path.stat().st_size <= most:
            return
    raise ValueError(f"{path} has {path.stat().st_size} bytes; expected at most {most}")


def _by_domain(bundled: Sequence[policies.Bundled]) -> Iterator[tuple[str, list[int]]]:
    """Each domain, with the places of its policies."""
    for domain in dict.fromkeys(one.domain for one in bundled):
        yield domain, [i for i, one in enumerate(bundled) if one.domain == domain]


def main(
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder of the pictures.")] = FOLDER,
    seconds: Annotated[float, typer.Option(min=0.4, help="Of each episode.")] = _SECONDS,
) -> None:
    """Play the bundled policies and draw them; the film is beside the folder of the pictures."""
    bundled = policies.bundled()
    out.mkdir(parents=True, exist_ok=True)
    tiles, strips, index = [], [], {}
    times = [frame / _FRAME_RATE for frame in _drawn_frames(round(seconds * _FRAME_RATE))]
    for one in bundled:
        name = f"{one.domain}-{one.task}"
        film, strip = _played(one, seconds)
        tiles.append(film)
        strips.append(strip)
        index[name] = Episode(one.sha256, _SEED, times, round(_mean(one), 1))
        typer.echo(name, file=sys.stderr)
    for domain, places in _by_domain(bundled):
        with replacing(out / f"{domain}.png") as partial:
            partial.write_bytes(png.encode(np.concatenate([strips[i] for i in places])))
    _write_film(out.with_suffix(".gif"), tiles)
    picture_index.write(out, index)


if __name__ == "__main__":
    typer.run(main)
