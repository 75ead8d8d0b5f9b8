"""return.png: reward and return over time, one line per episode; returns.png: many returns.

The only module that imports matplotlib, and only while it draws a plot. It needs no display and
does not touch pyplot's global state.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from limberjack.see.report.result import Played
from limberjack.utils.files import replacing
from limberjack.utils.requirements import missing_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["write_distribution_plot", "write_return_plot"]

_LEGEND_ENTRIES = 8  # more do not fit beside the plot
_SIZE = (8.0, 5.0)  # inches
_DOTS_PER_INCH = 120
_MARGIN = 0.03  # of the range, above and below the lines


def write_return_plot(
    path: Path, title: str, episodes: Sequence[Played], control_timestep: float
) -> None:
    """Draw each episode's reward per step, and below it the return so far, over seconds.

    Raises:
      ImportError: matplotlib is not installed.
    """
    figure = _figure()
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
    top.set_ylim(*_limits([episode.rewards for episode in episodes]))
    bottom.set_ylabel("return so far")
    bottom.set_ylim(*_limits([episode.returns for episode in episodes]))
    bottom.set_xlabel("time [s]")
    for axes in (top, bottom):
        axes.margins(x=0.01)
        axes.grid(alpha=0.3)
    if len(episodes) <= _LEGEND_ENTRIES:
        bottom.legend(loc="best", fontsize="small")
    with replacing(path) as partial:
        figure.savefig(partial)


def write_distribution_plot(
    path: Path,
    title: str,
    by_policy: Mapping[str, Sequence[float]],
    by_start: Mapping[str, Sequence[float]],
) -> None:
    """Draw the returns of many episodes in order of size: a line per policy, and per start.

    Args:
      path: the PNG.
      title: of the picture.
      by_policy: the returns of each policy; the first is the one under evaluation.
      by_start: the returns of that policy by kind of start; a single kind is not drawn.

    Raises:
      ImportError: matplotlib is not installed.
    """
    figure = _figure()
    parts = [by_policy] if len(by_start) < 2 else [by_policy, by_start]
    panels = figure.subplots(1, len(parts), sharey=True, squeeze=False)[0]
    for axes, part in zip(panels, parts, strict=True):
        for number, (name, returns) in enumerate(part.items()):
            label = f"{name}: mean {np.mean(returns):.1f} of {len(returns)}"
            # A step per episode, so that a single one is also a line; the first line is on top.
            shares = np.linspace(0.0, 100.0, len(returns) + 1)
            heights, on_top = np.sort(returns), len(part) - number
            axes.stairs(heights, shares, baseline=None, zorder=2 + on_top, linewidth=2, label=label)
        axes.set_xlabel("share of episodes with less return [%]")
        axes.margins(x=0.01)
        axes.grid(alpha=0.3)
        axes.legend(loc="best", fontsize="small")
    panels[0].set_ylabel("return")
    figure.suptitle(title)
    with replacing(path) as partial:
        figure.savefig(partial)


def _limits(series: Sequence[np.ndarray]) -> tuple[float, float]:
    """Limits of an axis that shows all values, and 0 to 1, the range of the suite's rewards."""
    values = np.concatenate([*series, [0.0, 1.0]])
    values = values[np.isfinite(values)]
    margin = _MARGIN * (values.max() - values.min())
    return float(values.min() - margin), float(values.max() + margin)


def _figure() -> "Figure":
    """An empty figure.

    Raises:
      ImportError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise missing_extra("video") from error

    figure = Figure(figsize=_SIZE, dpi=_DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    return figure
