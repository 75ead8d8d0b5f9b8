"""Line charts as HTML and SVG, which a page shows without loading anything.

    html = line_chart("Reward", seconds, [Line("reward", rewards)], low=0.0, high=1.0)

The lines stretch with the page; the text beside them is HTML and does not. Colours and sizes are
the page's (`page.html`). Lines of many samples are thinned to the resolution of a screen, and keep
their peaks. Where lines lie on top of each other, the page shows the one alone whose name the
pointer is at.
"""

import html
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

__all__ = ["Line", "line_chart", "steps_of", "thinned"]

_WIDTH, _HEIGHT = 1000.0, 100.0  # of the drawing, which is stretched to the page
_BUCKETS = 200  # pairs of a line's points; a chart has about as many pixels on a phone
_ALL_BUCKETS = 16_000  # of all lines of a chart, which keeps a page of many episodes small
_FEWEST_BUCKETS = 10
_X_INTERVALS, _Y_INTERVALS = 5, 4  # between ticks, about
_COLOURS = 8  # of the page; more lines are drawn in shades
_MOST_NAMED = 64  # lines in a legend; more than these cannot be distinguished
_MARGIN = 0.05  # of the range, above and below the lines
_LARGEST, _NARROWEST = 1e300, 1e-300  # of values and of ranges, whose ticks are numbers


class Line(NamedTuple):
    """A quantity over time; points that are not finite, or beyond 1e300, are left out."""

    name: str
    values: np.ndarray  # (n,)
    at: np.ndarray | None = None  # (n,), ascending; None for the chart's


def thinned(values: np.ndarray, buckets: int = _BUCKETS) -> np.ndarray:
    """The indices of the samples to draw: the least and the greatest of each of many short spans.

    Args:
      values: (n,); those that are not finite are not drawn.
      buckets: the number of spans.

    Returns:
      Sorted indices, at most twice as many as there are spans.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) <= 2 * buckets:
        return finite
    spans = np.array_split(finite, buckets)
    ends = [(span[values[span].argmin()], span[values[span].argmax()]) for span in spans]
    return np.unique(ends)


def steps_of(name: str, values: Sequence[float]) -> Line:
    """Values in ascending order over 0 to 100 percent of them, a step for each."""
    ascending = np.sort(np.asarray(values, float))
    shares = np.linspace(0.0, 100.0, len(ascending) + 1)
    return Line(name, np.repeat(ascending, 2), np.repeat(shares, 2)[1:-1])


def line_chart(
    title: str,
    at: np.ndarray,
    lines: Sequence[Line],
    low: float | None = None,
    high: float | None = None,
    axis: str = "seconds",
) -> str:
    """A chart of lines over time or another quantity, as HTML.

    Args:
      title: the caption.
      at: (n,), ascending from 0: the times of the lines' values.
      lines: each has an entry in the legend unless there are very many.
      low: the bottom of the chart at most; by default the least value.
      high: the top of the chart at least.
      axis: the quantity from left to right; charts of the same one show the same moment.
    """
    lines = [line._replace(values=_drawable(line.values)) for line in lines]
    low, high = _range(lines, low, high)
    until = float(max([at[-1], *(line.at[-1] for line in lines if line.at is not None)])) or 1.0
    x_ticks = [(tick / until, f"{tick:g}") for tick in _ticks(0.0, until, _X_INTERVALS)]
    y_ticks = [
        ((tick - low) / (high - low), f"{tick:g}") for tick in _ticks(low, high, _Y_INTERVALS)
    ]
    grid = "".join(
        f'<line x2="{_WIDTH:g}" y1="{y:.2f}" y2="{y:.2f}"/>'
        for y in (_HEIGHT * (1 - height) for height, _ in y_ticks)
    )
    return (
        f'<figure class="chart" data-axis="{html.escape(axis)}" data-until="{until!r}">'
        f"<figcaption>{html.escape(title)}"
        f"</figcaption>\n<div class=plot><div class=y>{_labels(y_ticks, 'bottom')}</div>\n"
        f'<div class=area><svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" preserveAspectRatio="none" '
        f'role=img aria-label="{html.escape(_summary(title, lines))}" data-low="{low!r}" '
        f'data-high="{high!r}"><g class=grid>{grid}</g>\n{_drawn(at, until, lines, low, high)}'
        f"</svg><div class=cursor></div></div>\n"
        f"<div class=x>{_labels(x_ticks, 'left')}</div></div>\n{_legend(lines)}</figure>\n"
    )


def _drawable(values: np.ndarray) -> np.ndarray:
    """The values, with NaN in the place of those whose differences might be infinite."""
    return np.where(abs(values) <= _LARGEST, values, np.nan)


def _range(lines: Sequence[Line], low: float | None, high: float | None) -> tuple[float, float]:
    """The values at the bottom and at the top of the chart, a little beyond those of the lines."""
    values = np.concatenate([line.values for line in lines])
    values = values[np.isfinite(values)]
    ends = [end for end in (low, high) if end is not None]
    least, most = (float(f([*values, *ends])) if len(values) or ends else 0.0 for f in (min, max))
    if most - least < _NARROWEST:
        half = max(0.5, _MARGIN * abs(most))
        least, most = least - half, most + half
    margin = _MARGIN * (most - least)
    return least - margin, most + margin


def _drawn(at: np.ndarray, until: float, lines: Sequence[Line], low: float, high: float) -> str:
    """The polylines over `at`, of which `until` is at the right.

    The first line is the one that matters: it is drawn last, above the others.
    """
    buckets = max(_FEWEST_BUCKETS, min(_BUCKETS, _ALL_BUCKETS // max(len(lines), 1)))
    drawn = []
    for number, line in enumerate(lines):
        kept = thinned(line.values, buckets)
        x = (at if line.at is None else line.at)[kept] / until
        heights = (line.values[kept] - low) / (high - low)
        # Values are read off lines with names, so these are drawn more finely.
        digits = 2 if len(lines) <= _MOST_NAMED else 1
        points = [
            f"{_WIDTH * a:.1f},{_HEIGHT * (1 - b):.{digits}f}"
            for a, b in zip(x, heights, strict=True)
        ]
        drawn.append(f'<polyline {_look(number, len(lines))} points="{" ".join(points)}"/>\n')
    return "".join(reversed(drawn))


def _look(number: int, count: int) -> str:
    """The attributes that give a line, or its entry in the legend, its colour."""
    if count <= _COLOURS:
        return f'class="c{number}"'
    return f'class="shade" style="--hue: {round(300 * number / count)}"'


def _ticks(low: float, high: float, intervals: int) -> Iterator[float]:
    """Round numbers from low to high."""
    rough = (high - low) / intervals
    power = 10.0 ** math.floor(math.log10(rough))
    step = min((m * power for m in (1, 2, 5, 10)), key=lambda s: abs(math.log(s / rough)))
    for count in range(math.ceil(low / step), math.floor(high / step) + 1):
        yield float(f"{count * step:.12g}")


def _labels(ticks: Sequence[tuple[float, str]], side: str) -> str:
    return "".join(f'<span style="{side}: {100 * at:.2f}%">{text}</span>' for at, text in ticks)


def _legend(lines: Sequence[Line]) -> str:
    """The names of the lines, with room for the values at the cursor; none for very many lines."""
    if len(lines) > _MOST_NAMED:
        return ""
    entries = (
        f"<li {_look(i, len(lines))} tabindex=0>{html.escape(line.name)} <output></output></li>"
        for i, line in enumerate(lines)
    )
    return f"<ul class=legend>{''.join(entries)}</ul>"


def _summary(title: str, lines: Sequence[Line]) -> str:
    """The chart in words, as a text alternative."""
    if len(lines) > _COLOURS:
        values = np.concatenate([line.values for line in lines])
        return f"{title}: {len(lines)} lines; {_extent(values)}"
    return f"{title}: " + "; ".join(f"{line.name} {_extent(line.values)}" for line in lines)


def _extent(values: np.ndarray) -> str:
    values = values[np.isfinite(values)]
    return f"from {values.min():.3g} to {values.max():.3g}" if len(values) else "without values"
