"""Film the bundled policies, for their page and the domains' pages.

    python tools/learned_pictures.py

Each policy plays the first seconds of an episode with a seed that training has not seen. Written
are docs/images/learned.gif, a film of all tasks side by side with their mean returns;
docs/images/learned/DOMAIN.png, with four pictures of each task of a domain; and, beside these,
episodes.json: which policies they show. Call it again when a policy has been bundled. Drawing takes
a few minutes with a software renderer.
"""

import sys
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import pictures
import tiles
import typer

from limberjack import policies
from limberjack.see.video import mosaic

__all__ = ["FILM", "FOLDER", "PICTURE", "Episode", "episodes", "main"]

FOLDER = Path(__file__).parents[1] / "docs" / "images" / "learned"
FILM = FOLDER.with_suffix(".gif")
PICTURE = 120, 160  # pixels of a task's picture, of which there are four side by side

_SEED = 40_000  # the first one of the scores
_SECONDS = 5  # enough for a pendulum to swing up, and for a few steps of a walker
_PICTURES = 4


class Episode(NamedTuple):
    """Facts about the pictures of a task."""

    sha256: str  # of the policy's file
    seed: int
    seconds: list[float]  # of each picture
    mean: float  # return over the seeds of the policy's scores


def episodes(folder: Path = FOLDER) -> dict[str, Episode]:
    """The facts of all pictures in a folder, by 'domain-task'; empty if there are none."""
    return pictures.facts(folder, Episode)


def _played(bundled: policies.Bundled, seconds: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Tiles of an episode for the film, and four pictures side by side."""
    domain, task = bundled.domain, bundled.task
    title = tiles.caption(domain, task, f"{_mean(bundled):.0f}")
    drawn, film, strip = _drawn_frames(seconds), [], []
    for frame, draw in enumerate(tiles.play(domain, task, "pretrained", _SEED, seconds)):
        film.append(np.concatenate([draw(*tiles.PICTURE), title]))
        if frame in drawn:
            strip.append(draw(*PICTURE))
    return film, mosaic(strip, _PICTURES)


def _drawn_frames(seconds: float) -> list[int]:
    """The frames of a film that are pictures too."""
    last = round(seconds * tiles.FRAME_RATE) - 1
    return np.linspace(0, last, _PICTURES).round().astype(int).tolist()


def _mean(bundled: policies.Bundled) -> float:
    assert bundled.card.scores is not None
    return bundled.card.scores.mean


def main(
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder of the pictures.")] = FOLDER,
    seconds: Annotated[float, typer.Option(min=0.4, help="Of each episode.")] = _SECONDS,
) -> None:
    """Play the bundled policies and draw them; the film is beside the folder of the pictures."""
    bundled = policies.bundled()
    films, strips, index = [], {}, {}
    times = [frame / tiles.FRAME_RATE for frame in _drawn_frames(seconds)]
    for one in bundled:
        name = f"{one.domain}-{one.task}"
        film, strip = _played(one, seconds)
        films.append(film)
        strips.setdefault(one.domain, []).append(strip)
        index[name] = Episode(one.sha256, _SEED, times, round(_mean(one), 1))
        typer.echo(name, file=sys.stderr)
    for domain, of_tasks in strips.items():
        pictures.write(out, domain, np.concatenate(of_tasks))
    tiles.write_film(out.with_suffix(".gif"), films)
    pictures.write_facts(out, index)


if __name__ == "__main__":
    typer.run(main)
