"""Progress bars: what they show, and to whom."""

import re
import time

import pytest

from limberjack.cli import progress
from limberjack.workers import State


@pytest.fixture
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Standard error as a terminal."""
    monkeypatch.setattr(progress, "is_terminal", lambda stream: True)
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("COLUMNS", "120")


def _shown(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The states of a bar, without its colours."""
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().err)
    return [line.strip() for line in re.split(r"[\r\n]+", text) if line.strip()]


def test_without_a_terminal_nothing_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    with progress.show_parts() as show:
        show("a part", 1, 2)
    with progress.show_steps("training") as steps:
        steps.show(1, 2, 3.0)
    assert capsys.readouterr() == ("", "")


@pytest.mark.usefixtures("_terminal")
def test_a_bar_over_a_film_has_its_return_and_the_time_left(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress.show_steps("filming") as film:
        film.show(0, 10, 0.0)
        time.sleep(0.15)
        film.show(5, 10, 1.25)
        film.show(6, 10, 99.0)  # too soon to be shown
        time.sleep(0.15)
        film.show(10, 10, 7.5)  # the last one
    shown = _shown(capsys)
    assert shown[0].startswith("loading")
    assert any(line.startswith("filming") and "return 1.2" in line for line in shown)
    assert not any("return 99.0" in line for line in shown)
    assert shown[-1].endswith("return 7.5 0:00:00")


@pytest.mark.usefixtures("_terminal")
def test_a_bar_over_steps_has_the_last_return_and_the_time_left(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress.show_steps("training") as steps:
        assert steps.finished is None
        steps.show(500, 1000, 12.5)  # as a run that continues
        time.sleep(0.15)
        steps.show(600, 1000, 20.0)
        steps.show(700, 1000, 99.0)  # too soon to be shown
    assert (steps.finished, steps.steps) == (700, 1000)
    shown = _shown(capsys)
    assert shown[0].startswith("loading")
    assert any(line.startswith("training") and "60 % return 20.0" in line for line in shown)
    assert not any("return 99.0" in line for line in shown)
    # The time left does not count the steps of the earlier process.
    left = [int(line[-1]) for line in shown if re.search(r"return 20.0 0:00:0\d$", line)]
    assert all(seconds <= 1 for seconds in left)


@pytest.mark.usefixtures("_terminal")
def test_a_bar_over_parts_names_each_part_and_its_share(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress.show_parts() as show:
        show("the first part", 0, 4)
        time.sleep(0.01)
        show("the second part", 1, 4)
        time.sleep(0.01)
        show("the last part", 3, 4)
    shown = _shown(capsys)
    assert shown[0].startswith("starting")
    assert any(line.startswith("the first part") and line.endswith("0 %") for line in shown)
    assert any(line.startswith("the last part") and "75 % 0:00:0" in line for line in shown)


@pytest.mark.usefixtures("_terminal")
def test_units_are_shown_with_their_throughput_and_the_workers(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    with progress.show_units() as units:
        assert units.finished is None
        units.begin(300)
        units.show("random", 100)
        units.show_state(State(2, 1, starting=1))
        now += 10
        units.show("sb3:[red]walk.zip", 164)
        time.sleep(0.25)
        now += 118
        units.show("zero", 200)
        time.sleep(0.25)
        units.show_state(State(2, 1, note="node b was lost: its units are played again"))
    shown = _shown(capsys)
    assert (units.finished, units.episodes) == (200, 300)
    assert any("164/300 6.4 episodes/s" in line for line in shown)
    assert any(line.startswith("sb3:[red]walk.zip ") for line in shown)  # as it is
    assert any("1 of 2 workers playing, 1 starting" in line for line in shown)
    assert any("46.9 episodes/min" in line for line in shown)
    assert "limberjack: node b was lost: its units are played again" in shown


def test_an_event_is_a_line_without_a_terminal_too(capsys: pytest.CaptureFixture[str]) -> None:
    with progress.show_units() as units:
        units.show("random", 1, 0.5)
        units.show_state(State(2, 2))
        units.show_state(State(2, 1, note="node b was lost"))
    assert capsys.readouterr() == ("", "limberjack: node b was lost\n")
