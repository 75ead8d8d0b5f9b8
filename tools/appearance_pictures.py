"""Draw the start of three tasks in each appearance, side by side, for docs/appearance.md.

    python tools/appearance_pictures.py                    # all
    python tools/appearance_pictures.py color_hard camera  # some, by name

The pictures are written into docs/images/appearance. Noise stands for the videos, which a user
brings. It takes a minute.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import pictures
import typer

from limberjack import suite
from limberjack.see.video import mosaic

__all__ = ["APPEARANCES", "FOLDER", "draw", "main"]

FOLDER = Path(__file__).parents[1] / "docs" / "images" / "appearance"

_TASKS = ("walker", "walk"), ("cartpole", "swingup"), ("reacher", "easy")
_SIZE = 84  # pixels, as agents see them
_SEED = 3
_NOISE = {"background": "noise"}
# By the name of the file; with the options that the page gives beside it.
APPEARANCES: dict[str, str | Mapping[str, object] | None] = {
    "original": None,
    "colors": {"colors": "hard"},
    "camera": {"camera": "hard"},
    "background": _NOISE,
    "color_easy": "color_easy",
    "color_hard": "color_hard",
    "video_easy": {"preset": "video_easy", **_NOISE},
    "video_hard": {"preset": "video_hard", **_NOISE},
    "video_easy_scene": {"preset": "video_easy_scene", **_NOISE},
    "video_hard_scene": {"preset": "video_hard_scene", **_NOISE},
    "color_video_easy": {"preset": "color_video_easy", **_NOISE},
    "color_video_hard": {"preset": "color_video_hard", **_NOISE},
    "rotate_easy": "rotate_easy",
    "rotate_hard": "rotate_hard",
    "shift_easy": "shift_easy",
    "shift_hard": "shift_hard",
    "rotate_shift_easy": "rotate_shift_easy",
    "rotate_shift_hard": "rotate_shift_hard",
    "distracting_cs": {"preset": "distracting_cs", "intensity": 0.2, **_NOISE},
}


def draw(name: str) -> np.ndarray:
    """The starts of the tasks in an appearance, (84, 3 * 84, 3) uint8."""
    drawn = []
    for task in _TASKS:
        options = {"appearance": APPEARANCES[name]}
        env = suite.load(*task, {"random": _SEED}, options)
        env.reset()
        drawn.append(env.physics.render(_SIZE, _SIZE, 0))
        env.close()
    return mosaic(drawn, columns=len(_TASKS))


def main(
    names: Annotated[
        list[str] | None, typer.Argument(help="Names of pictures; all by default.")
    ] = None,
) -> None:
    """Draw the pictures of docs/appearance.md."""
    for name in names or APPEARANCES:
        pictures.write(FOLDER, name, draw(name))
        typer.echo(f"{name}.png")


if __name__ == "__main__":
    typer.run(main)
