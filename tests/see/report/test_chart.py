"""Line charts: what is drawn, and where."""

import re

import numpy as np
import pytest

from limberjack.see.report.chart import Line, line_chart, steps_of, thinned


def test_thinning_keeps_the_peaks_and_drops_values_that_are_not_finite() -> None:
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


def test_the_ticks_of_a_small_range_are_at_their_values() -> None:
    chart = line_chart("x", np.arange(2.0), [Line("x", np.array([0.0, 1e-14]))])
    found = re.findall(r'<span style="bottom: ([\d.-]+)%">([^<]*)', chart)
    assert found[0] == ("4.55", "0")
    assert [text for _, text in found] == ["0", "2e-15", "4e-15", "6e-15", "8e-15", "1e-14"]
    assert found[-1] == ("95.45", "1e-14")


def test_a_chart_of_a_constant_and_one_of_nothing_can_be_drawn() -> None:
    for value in (3.0, 0.0, -1e-9, 1e12, np.nan):
        chart = line_chart("x", np.arange(3.0), [Line("x", np.full(3, value))])
        assert "nan" not in chart.replace(" without values", "")
        assert "inf" not in chart


@pytest.mark.parametrize(
    "values", [[1e17, 1e17], [-1.7e308, 1.7e308], [-1e300, 1e300], [0.0, 5e-324], [np.inf, np.nan]]
)
def test_a_chart_of_extreme_values_can_be_drawn(values: list[float]) -> None:
    html = line_chart("extreme", np.array([0.0, 1.0]), [Line("one", np.array(values))])
    assert "<svg" in html


def test_lines_have_names_unless_they_are_very_many() -> None:
    seconds = np.arange(5.0)
    lines = [Line(f"line {i}", seconds + i) for i in range(65)]
    assert line_chart("few", seconds, lines[:3]).count('<li class="c') == 3
    chart = line_chart("many", seconds, lines[:30])
    assert chart.count('<li class="shade"') == 30
    # A name has the colour of its line.
    hues = re.findall(r"(<li|<polyline)[^>]*--hue: (\d+)", chart)
    assert len({hue for _, hue in hues}) == 30
    assert sorted(hue for tag, hue in hues if tag == "<li") == sorted(
        hue for tag, hue in hues if tag == "<polyline"
    )
    assert "<li " not in line_chart("very many", seconds, lines)


def test_lines_of_different_samples_are_drawn_at_their_own() -> None:
    ends = np.array([0.0, 100.0])
    few, many = steps_of("few", [0.0, 0.0]), steps_of("many", [0.0] * 4)
    upper, lower = _points(line_chart("x", ends, [many, few]))
    assert [x for x, _ in upper] == [0, 500, 500, 1000]
    assert [x for x, _ in lower] == [0, 250, 250, 500, 500, 750, 750, 1000]


def test_steps_show_each_value_over_its_share() -> None:
    line = steps_of("return", [3.0, 1.0])
    assert line.at is not None
    assert list(zip(line.at, line.values, strict=True)) == [(0, 1), (50, 1), (50, 3), (100, 3)]


def test_a_chart_of_very_many_lines_is_small() -> None:
    seconds = np.arange(1000.0)
    lines = [Line(str(i), np.random.RandomState(i).uniform(size=1000)) for i in range(1000)]
    assert len(line_chart("many", seconds, lines)) < 500_000
