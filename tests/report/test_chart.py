"""Line charts: what is drawn, and where."""

import re

import numpy as np
import pytest

from limberjack.report.chart import Line, line_chart, thinned


def test_thinning_keeps_the_peaks_and_what_is_finite() -> None:
    values = np.zeros(10_000)
    values[1234], values[5678], values[9999] = 5.0, -7.0, np.nan
    kept = thinned(values, 100)
    assert len(kept) <= 200
    assert {1234, 5678} <= set(kept.tolist())
    assert 9999 not in kept
    assert (np.diff(kept) > 0).all()
    assert thinned(np.array([1.0, np.inf, 2.0])).tolist() == [0, 2]
    assert thinned(np.full(3, np.nan)).tolist() == []


def _points(chart: str) -> list[list[tuple[float, ...]]]:
    lines = re.findall(r'points="([^"]*)"', chart)
    return [[tuple(map(float, p.split(","))) for p in line.split()] for line in lines]


def test_a_chart_is_drawn_to_scale() -> None:
    values = np.array([np.nan, 0.0, 1.0, 0.5])
    chart = line_chart("Reward", np.arange(4) * 0.5, [Line("reward", values)], 0.0, 1.0)
    ((first, second, third),) = _points(chart)
    assert [first[0], second[0], third[0]] == pytest.approx([333.3, 666.7, 1000.0], abs=0.1)
    # The range is 0 to 1 and a margin of 5 % above and below.
    assert [first[1], second[1], third[1]] == pytest.approx([95.45, 4.55, 50.0], abs=0.01)
    assert re.findall(r'<span style="left: ([\d.]+)%">([\d.]+)', chart)[:2] == [
        ("0.00", "0"),
        ("13.33", "0.2"),
    ]
    assert 'aria-label="Reward: reward from 0 to 1"' in chart


def test_a_chart_of_a_constant_and_one_of_nothing_can_be_drawn() -> None:
    for value in (3.0, 0.0, -1e-9, 1e12, np.nan):
        chart = line_chart("x", np.arange(3.0), [Line("x", np.full(3, value))])
        assert "nan" not in chart.replace(" without values", "")
        assert "inf" not in chart


def test_few_lines_have_names_and_many_have_shades() -> None:
    seconds = np.arange(5.0)
    few = [Line(f"line {i}", seconds) for i in range(3)]
    many = [Line(f"line {i}", seconds) for i in range(30)]
    assert line_chart("few", seconds, few).count("<li class=") == 3
    chart = line_chart("many", seconds, many)
    assert "<li " not in chart
    assert len(set(re.findall(r"--hue: \d+", chart))) == 30
