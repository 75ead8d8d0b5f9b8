"""return.png: reward and return over time; returns.png: many returns; curve.png: a run that learns.

The only module that imports matplotlib, and only while it draws a plot. It needs no display and
does not touch pyplot's global state.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from limberjack.policies.learning import Learning
from limberjack.see.report.result import Played
from limberjack.utils.files import replacing
from limberjack.utils.requirements import missing_extra
from limberjack.utils.texts import encodable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["write_distribution_plot", "write_learning_plot", "write_return_plot"]

_LEGEND_ENTRIES = 8  # more do not fit beside the plot
_SIZE = (8.0, 5.0)  # inches
_DOTS_PER_INCH = 120
_MARGIN = 0.03  # of the range, above and below the lines
_MEASURES = _STEPS, _ = "thousand control steps", "minutes of one processor core"
_COLUMNS = 5  # of tasks in a plot of learning
_PANEL = (1.9, 1.5)  # inches, of one of many tasks
_COLOUR, _OWN_COLOUR, _PUBLISHED_COLOUR = "C0", "C3", "0.35"  # in matplotlib's notation


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
    top.set_title(_as_it_is(title))
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
            label = f"{_as_it_is(name)}: mean {np.mean(returns):.1f} of {len(returns)}"
            # A step per episode, so that a single one is also a line; the first line is on top.
            shares = np.linspace(0.0, 100.0, len(returns) + 1)
            heights, on_top = np.sort(returns), len(part) - number
            axes.stairs(heights, shares, baseline=None, zorder=2 + on_top, linewidth=2, label=label)
        axes.set_xlabel("share of episodes with less return [%]")
        axes.margins(x=0.01)
        axes.grid(alpha=0.3)
        axes.legend(loc="best", fontsize="small")
    panels[0].set_ylabel("return")
    figure.suptitle(_as_it_is(title))
    with replacing(path) as partial:
        figure.savefig(partial)


def write_learning_plot(path: Path, tasks: Sequence[Learning], description: str = "") -> None:
    """Draw returns over control steps, and below that over minutes of one processor core.

    Each task has a panel in both halves. Its runs have one colour, and its own is above them.
    Returns far below those of a run's second half are cut off: an untrained policy of lqr loses
    thousands.

    Args:
      path: ends in .png or .svg.
      tasks: at least one; a single one has a legend.
      description: a text that an SVG keeps.

    Raises:
      ImportError: matplotlib is not installed.
    """
    figure = _figure()
    from matplotlib import rc_context  # after the check that it is installed

    columns = min(len(tasks), _COLUMNS)
    rows = math.ceil(len(tasks) / columns)
    if len(tasks) > 1:
        figure.set_size_inches(columns * _PANEL[0], 2 * rows * _PANEL[1])
    grid = figure.add_gridspec(len(_MEASURES), 1)
    for number, over in enumerate(_MEASURES):
        half = figure.add_subfigure(grid[number])
        panels = half.subplots(rows, columns, squeeze=False).ravel()
        for axes, task in zip(panels, tasks, strict=False):
            _draw_learning(axes, task, over)
        for axes in panels[len(tasks) :]:
            axes.remove()
        half.supxlabel(over, fontsize="medium")
        half.supylabel("mean return", fontsize="medium")
    if len(tasks) == 1:
        figure.axes[0].legend(loc="lower right", fontsize="small")
    is_svg = path.suffix == ".svg"
    more = {"Date": None, "Description": description} if is_svg else None
    # Text stays text, and the same plot is the same file.
    same = rc_context({"svg.fonttype": "none", "svg.hashsalt": "limberjack"})
    with same, replacing(path) as partial:
        figure.savefig(partial, metadata=more)


def _as_it_is(name: str) -> str:
    """A name of anyone's, of which matplotlib draws each character: no formula, no lone surrogate.

    It takes text between dollars for a formula, and leaves labels that begin with an underscore out
    of legends.
    """
    text = encodable(name).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def _draw_learning(axes: "Axes", task: Learning, over: str) -> None:
    """Draws the curves of a task over one of the measures."""
    own = [] if task.own is None else [task.own]
    for number, curve in enumerate([*task.runs, *own]):
        is_own = number == len(task.runs)
        axes.plot(
            curve.steps / 1e3 if over == _STEPS else curve.seconds / 60,
            curve.returns,
            color=_OWN_COLOUR if is_own else _COLOUR,
            linewidth=2 if is_own else 1,
            label=f"{_as_it_is(curve.name)}: {curve.returns[-1]:.0f}",
        )
    if task.published is not None:
        level, name = task.published
        label = f"{_as_it_is(name)}: {level:.0f}"
        axes.axhline(level, color=_PUBLISHED_COLOUR, linewidth=1, linestyle="--", label=label)
    axes.set_title(_as_it_is(task.title), fontsize="small")
    axes.set_ylim(*_limits(list(_shown(task))))
    axes.set_xlim(left=0)
    axes.tick_params(labelsize="x-small")
    axes.grid(alpha=0.3)


def _shown(task: Learning) -> Iterator[np.ndarray]:
    """The returns that a panel has room for."""
    for curve in [*task.runs, *([] if task.own is None else [task.own])]:
        yield curve.returns[len(curve.returns) // 2 :]
    if task.published is not None:
        yield np.array([task.published[0]])


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
