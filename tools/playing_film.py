"""Film tasks side by side, played by bundled policies and by the planner, for README.

    python tools/playing_film.py

A tile shows the first seconds of an episode: the bundled policy of the task plays it, or the
planner where there is none. The film is docs/images/playing.gif. Planning takes about five
core-minutes; the tiles of a task are kept in build/playing, and a later call plays only tasks that
are not there. The film need not be made again when the planner changes: it shows what the tasks
look like.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import tiles
import typer

from limberjack import policies
from limberjack.utils.files import replacing

__all__ = ["FILM", "TASKS", "main"]

_REPOSITORY = Path(__file__).parents[1]
FILM = _REPOSITORY / "docs" / "images" / "playing.gif"

# As on the sheet, row by row: planned ones of the hardest domains, and learned ones of the others.
TASKS = (
    *(("humanoid", "walk"), ("humanoid", "run"), ("manipulator", "bring_ball")),
    *(("manipulator", "insert_peg"), ("stacker", "stack_2"), ("stacker", "stack_4")),
    *(("walker", "walk"), ("fish", "upright"), ("ball_in_cup", "catch"), ("reacher", "hard")),
    *(("cartpole", "swingup"), ("cartpole", "two_poles"), ("pendulum", "swingup")),
    ("point_mass", "easy"),
)

_SECONDS = 8  # enough for the arm to stack four boxes
# The first seeds of the scores of policies, and of the episodes on which the planner was tuned.
_SEEDS = {"pretrained": 40_000, "planner": 1003}


def _film(domain: str, task: str, seconds: float) -> np.ndarray:
    """The tiles of a task, (frames, height, width, 3) uint8."""
    is_learned = (domain, task) in {(one.domain, one.task) for one in policies.bundled()}
    policy = "pretrained" if is_learned else "planner"
    title = tiles.caption(domain, task, "learned" if is_learned else "planned")
    frames = tiles.play(domain, task, policy, _SEEDS[policy], seconds)
    return np.stack([np.concatenate([draw(*tiles.PICTURE), title]) for draw in frames])


def _kept(path: Path, domain: str, task: str, seconds: float) -> np.ndarray:
    """The tiles of a task, played unless they are in a file."""
    if not path.exists():
        played = _film(domain, task, seconds)
        with replacing(path) as partial, partial.open("wb") as file:
            np.save(file, played)
    return np.load(path)


def main(
    out: Annotated[Path, typer.Option(metavar="FILE", help="The film.")] = FILM,
    work: Annotated[Path, typer.Option(metavar="DIR", help="For the tiles of each task.")] = (
        _REPOSITORY / "build" / "playing"
    ),
    seconds: Annotated[float, typer.Option(min=0.4, help="Of each episode.")] = _SECONDS,
) -> None:
    """Play the tasks and draw them."""
    work.mkdir(parents=True, exist_ok=True)
    films: list[Sequence[np.ndarray]] = []
    for domain, task in TASKS:
        films.append(list(_kept(work / f"{domain}-{task}.npy", domain, task, seconds)))
        typer.echo(f"{domain}-{task}", file=sys.stderr)
    tiles.write_film(out, films)


if __name__ == "__main__":
    typer.run(main)
