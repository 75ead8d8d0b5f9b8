"""return.png: reward and return over time, one line per episode.

The only file that imports matplotlib, and that when a plot is asked for. It draws without a
display and leaves pyplot's global state alone.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from limberjack.rollout import Episode
from limberjack.utils.files import replacing

__all__ = ["write_return_plot"]

_LEGEND_ENTRIES = 8  # more do not fit beside the plot
_SIZE = (8.0, 5.0)  # inches
_DOTS_PER_INCH = 120


def write_return_plot(
    path: Path, title: str, episodes: Sequence[Episode], control_timestep: float
) -> None:
    """Draws each episode's reward per step, and below it the return so far, over seconds.

    Raises:
      ImportError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("needs the extra 'video': pip install 'limberjack[video]'") from error

    figure = Figure(figsize=_SIZE, dpi=_DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 1, sharex=True)
    opacity = 1.0 if len(episodes) <= _LEGEND_ENTRIES else 0.4
    for episode in episodes:
        # The reward of a step is earned when the step ends.
        seconds = control_timestep * np.arange(episode.length + 1)
        label = f"seed {episode.seed}: {episode.total:.3f}"
        top.plot(seconds[1:], episode.rewards, linewidth=1, alpha=opacity)
        bottom.plot(seconds, [0.0, *episode.returns], linewidth=1.5, alpha=opacity, label=label)
    top.set_title(title)
    top.set_ylabel("reward")
    top.set_ylim(-0.03, 1.03)  # rewards of the suite lie between 0 and 1
    bottom.set_ylabel("return so far")
    bottom.set_ylim(-0.03, max(1.03, *(1.03 * episode.total for episode in episodes)))
    bottom.set_xlabel("time [s]")
    for axes in (top, bottom):
        axes.margins(x=0.01)
        axes.grid(alpha=0.3)
    if len(episodes) <= _LEGEND_ENTRIES:
        bottom.legend(loc="best", fontsize="small")
    with replacing(path) as partial:
        figure.savefig(partial)
