"""Draw the pictures of the site's first page: those of its steps 2 to 5.

    python tools/first_pictures.py

They show what the page's code does: an episode of the bundled policy of walker walk, the rows of a
batch after its reset, the learning curves of cartpole swingup that come with the package, and the
returns of the bundled policy over the seeds of its scores. It takes a minute of one core.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import pictures
import typer

from limberjack import policies, suite
from limberjack.evaluation import evaluate
from limberjack.see.report import write_distribution_plot, write_learning_plot
from limberjack.see.video import mosaic

__all__ = ["FOLDER", "STEPS", "draw_batch", "draw_step", "main"]

FOLDER = Path(__file__).parents[1] / "docs" / "images" / "first"
STEPS = 0, 20, 40, 60  # of the walker's episode, which are drawn

_TASK = "walker", "walk"
_LEARNED = "cartpole", "swingup"  # of the page's command
_NUM_ENVS = 64
_ROW = 75, 100  # pixels, of a row of the batch
_PICTURE = 180, 240  # pixels, of a step
_SEEDS = range(40_000, 40_100)  # those of the bundled policies' scores


def draw_step() -> np.ndarray:
    """The episode of seed 0 after some of its steps, side by side."""
    environment = suite.load(*_TASK, {"random": 0})
    act = policies.find("pretrained", environment).begin_alone(environment, 0)
    time_step, drawn = environment.reset(), []
    for step in range(STEPS[-1] + 1):
        if step in STEPS:
            drawn.append(environment.physics.render(*_PICTURE, "side"))
        time_step = environment.step(act(time_step.observation))
    return mosaic(drawn, len(STEPS))


def draw_batch() -> np.ndarray:
    """The rows of a batch after their reset."""
    batch = suite.load_batch(*_TASK, _NUM_ENVS, seed=0)
    batch.reset()
    return mosaic(batch.render(height=_ROW[0], width=_ROW[1], camera_id="side"))


def main(
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder of the pictures.")] = FOLDER,
) -> None:
    """Draw the pictures."""
    pictures.write(out, "step", draw_step())
    pictures.write(out, "batch", draw_batch())
    write_learning_plot(out / "train.png", [policies.learning_of(*_LEARNED)])
    scores = evaluate(*_TASK, "pretrained", _SEEDS).scores
    returns = {name: [episode.total for episode in played] for name, played in scores.items()}
    title = f"{' '.join(_TASK)}, seeds {_SEEDS.start}:{_SEEDS.stop}"
    write_distribution_plot(out / "evaluate.png", title, returns, {})


if __name__ == "__main__":
    typer.run(main)
