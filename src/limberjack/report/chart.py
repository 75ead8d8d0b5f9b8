"""Line charts as HTML and SVG: text that a page shows as it stands, with nothing to load.

    html = line_chart("Reward", seconds, [Line("reward", rewards)], low=0.0, high=1.0)

The lines stretch with the page, and the text beside them does not: it is HTML. Colours and sizes
are the page's (`page.html`). Lines of many samples are thinned to what a screen can show, and keep
their peaks.
"""

import html
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

__all__ = ["Line", "line_chart", "thinned"]

_WIDTH, _HEIGHT = 1000.0, 100.0  # of the drawing, which is stretched to the page
_BUCKETS = 200  # pairs of a line's points; a chart has about as many pixels on a phone
_X_INTERVALS, _Y_INTERVALS = 5, 4  # between ticks, about
_NAMED_LINES = 8  # as many as the page has colours; more are drawn in shades, without names
_MARGIN = 0.05  # of the range, above and below the lines


class Line(NamedTuple):
    """A quantity over time; points that are not finite are left out."""

    name: str
    values: np.ndarray  # (n,)


def thinned(values: np.ndarray, buckets: int = _BUCKETS) -> np.ndarray:
    """Which samples to draw: of each of many short spans the least and the greatest.

    Args:
      values: (n,); those that are not finite are not drawn.
      buckets: the number of spans.

    Returns:
      Sorted numbers of samples, no more than twice as many as there are spans.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) <= 2 * buckets:
        return finite
    spans = np.array_split(finite, buckets)
    ends = [(span[values[span].argmin()], span[values[span].argmax()]) for span in spans]
    return np.unique(ends)


def line_chart(
    title: str,
    seconds: np.ndarray,
    lines: Sequence[Line],
    low: float | None = None,
    high: float | None = None,
) -> str:
    """A chart of lines over time, as HTML.

    Args:
      title: what is shown.
      seconds: (n,), ascending.
      lines: the first few have names and colours of their own; many are drawn in shades.
      low: the bottom of the chart at most; by default the least value.
      high: the top of the chart at least.
    """
    low, high = _range(lines, low, high)
    until = float(seconds[-1]) or 1.0
    # The first line is the one that matters: it is drawn last, above the others.
    numbered = reversed(list(enumerate(lines)))
    drawn = "".join(
        _polyline(line, seconds / until, low, high, i, len(lines)) for i, line in numbered
    )
    x_ticks = [(tick / until, f"{tick:g}") for tick in _ticks(0.0, until, _X_INTERVALS)]
    y_ticks = [
        ((tick - low) / (high - low), f"{tick:g}") for tick in _ticks(low, high, _Y_INTERVALS)
    ]
    grid = "".join(
        f'<line x2="{_WIDTH:g}" y1="{y:.2f}" y2="{y:.2f}"/>'
        for y in (_HEIGHT * (1 - where) for where, _ in y_ticks)
    )
    return (
        f'<figure class="chart" data-until="{until!r}"><figcaption>{html.escape(title)}'
        f"</figcaption>\n<div class=plot><div class=y>{_labels(y_ticks, 'bottom')}</div>\n"
        f'<div class=area><svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" preserveAspectRatio="none" '
        f'role=img aria-label="{html.escape(_summary(title, lines))}" data-low="{low!r}" '
        f'data-high="{high!r}"><g class=grid>{grid}</g>\n{drawn}</svg><div class=cursor></div>'
        f"</div>\n<div class=x>{_labels(x_ticks, 'left')}</div></div>\n{_legend(lines)}</figure>\n"
    )


def _range(lines: Sequence[Line], low: float | None, high: float | None) -> tuple[float, float]:
    """What the chart's height stands for: a little more than there is to show."""
    values = np.concatenate([line.values for line in lines])
    values = values[np.isfinite(values)]
    ends = [end for end in (low, high) if end is not None]
    least, most = (float(f([*values, *ends])) if len(values) or ends else 0.0 for f in (min, max))
    if least == most:
        least, most = least - 0.5, most + 0.5
    margin = _MARGIN * (most - least)
    return least - margin, most + margin


def _polyline(line: Line, where: np.ndarray, low: float, high: float, number: int, of: int) -> str:
    """A line of the drawing; `where` is 0 to 1 from left to right."""
    kept = thinned(line.values)
    y = _HEIGHT * (high - line.values[kept]) / (high - low)
    # Values are read off the lines that have names, so these are drawn more finely.
    look, digits = f"class=c{number}", 2
    if of > _NAMED_LINES:
        look, digits = f'class=shade style="--hue: {round(300 * number / of)}"', 1
    x = _WIDTH * where[kept]
    points = " ".join(f"{a:.1f},{b:.{digits}f}" for a, b in zip(x, y, strict=True))
    return f'<polyline {look} points="{points}"/>\n'


def _ticks(low: float, high: float, intervals: int) -> Iterator[float]:
    """Round numbers from low to high."""
    rough = (high - low) / intervals
    power = 10.0 ** math.floor(math.log10(rough))
    step = min((m * power for m in (1, 2, 5, 10)), key=lambda s: abs(math.log(s / rough)))
    for count in range(math.ceil(low / step), math.floor(high / step) + 1):
        yield round(count * step, 12)


def _labels(ticks: Sequence[tuple[float, str]], side: str) -> str:
    return "".join(f'<span style="{side}: {100 * at:.2f}%">{text}</span>' for at, text in ticks)


def _legend(lines: Sequence[Line]) -> str:
    """Names of the lines, with room for the values at the cursor; none for many lines."""
    if len(lines) > _NAMED_LINES:
        return ""
    entries = (
        f"<li class=c{i}>{html.escape(line.name)} <output></output></li>"
        for i, line in enumerate(lines)
    )
    return f"<ul class=legend>{''.join(entries)}</ul>"


def _summary(title: str, lines: Sequence[Line]) -> str:
    """The chart in words, for those who do not see it."""
    if len(lines) > _NAMED_LINES:
        values = np.concatenate([line.values for line in lines])
        return f"{title}: {len(lines)} lines; {_extent(values)}"
    return f"{title}: " + "; ".join(f"{line.name} {_extent(line.values)}" for line in lines)


def _extent(values: np.ndarray) -> str:
    values = values[np.isfinite(values)]
    return f"from {values.min():.3g} to {values.max():.3g}" if len(values) else "without values"
