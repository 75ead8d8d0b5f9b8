"""The pictures of returns: over an episode, of many episodes, and of a run that learns."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.episodes import Episode
from limberjack.policies import Learning, LearningCurve
from limberjack.see import report
from limberjack.see.report import curve, write_distribution_plot, write_learning_plot

_POLICIES = {"mine": [1.0, 5.0, 3.0], "zero": [0.0, 0.0, 2.0]}


def _size(path: Path) -> tuple[int, int]:
    header = path.read_bytes()[:24]
    assert header.startswith(b"\x89PNG")
    return int.from_bytes(header[16:20], "big"), int.from_bytes(header[20:24], "big")


def test_returns_are_drawn_by_policy_and_by_start(tmp_path: Path) -> None:
    one, two = tmp_path / "one.png", tmp_path / "two.png"
    write_distribution_plot(one, "A task", _POLICIES, {"all": [1.0, 5.0, 3.0]})
    write_distribution_plot(two, "A task", _POLICIES, {"low": [1.0], "high": [5.0, 3.0]})
    assert _size(one) == _size(two) == (960, 600)
    assert one.read_bytes() != two.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.png", "two.png"]


def test_names_that_are_no_text_or_look_like_a_formula_are_drawn(tmp_path: Path) -> None:
    for name in ("mlp:\udcff.zip", "mlp:$\\frac$.zip"):
        path = tmp_path / "plot.png"
        write_distribution_plot(path, name, {name: [1.0], "zero": [0.0]}, {})
        report.write_return_plot(path, name, _EPISODES, 0.01)
    hidden = Learning("task", [_RUN._replace(name="_mine")], None, None)
    assert _written(tmp_path / "hidden.svg", [hidden]).count(" _mine: 650<") == 1
    name = "of $x^2$ \udcff"
    task = Learning(name, [_RUN._replace(name=name)], _OWN, (700.0, name))
    text = _written(tmp_path / "curve.svg", [task])
    assert text.count(r">of $x^2$ \udcff<") == 2  # over steps and over minutes
    assert r">of $x^2$ \udcff: 650<" in text
    assert r">of $x^2$ \udcff: 700<" in text


def test_without_matplotlib_the_error_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"needs the extra 'video': pip install"):
        write_distribution_plot(tmp_path / "plot.png", "A task", _POLICIES, {})
    assert list(tmp_path.iterdir()) == []


_EPISODES = [Episode(4, None, np.array([0.25, 0.5])), Episode(5, "in_hand", np.array([1.0]))]


def test_a_plot_is_drawn_without_touching_pyplot(tmp_path: Path) -> None:
    path = tmp_path / "return.png"
    code = (
        "import sys, numpy as np; from pathlib import Path\n"
        "from limberjack.see import report; from limberjack.episodes import Episode\n"
        "episode = Episode(0, None, np.ones(9))\n"
        f"report.write_return_plot(Path({str(path)!r}), 'title', [episode], 1.0)\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_a_plot_takes_any_number_of_episodes(tmp_path: Path) -> None:
    episodes = [Episode(seed, None, np.linspace(0, 1, 5 + seed)) for seed in range(30)]
    path = tmp_path / "return.png"
    report.write_return_plot(path, "many", episodes, 0.01)
    assert path.exists()


def test_a_plot_without_matplotlib_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"pip install imageio-ffmpeg matplotlib pillow"):
        report.write_return_plot(tmp_path / "return.png", "", _EPISODES, 0.01)


_STEPS = np.array([0.0, 500.0, 1000.0, 1500.0])
_RUN = LearningCurve("seed 0", _STEPS, _STEPS / 10, np.array([-9000.0, 10.0, 400.0, 650.0]))
_OWN = LearningCurve("mine", _STEPS, _STEPS / 5, np.array([0.0, 20.0, 300.0, 500.0]))


def _written(path: Path, tasks: list[Learning], description: str = "") -> str:
    write_learning_plot(path, tasks, description)
    return path.read_text(encoding="utf-8")


def test_a_learning_plot_names_its_curves_with_their_last_returns(tmp_path: Path) -> None:
    task = Learning("pendulum swingup", [_RUN], _OWN, (838.4, "published, somebody"))
    text = _written(tmp_path / "curve.svg", [task], "kept & read")
    for words in (
        *("seed 0: 650", "mine: 500", "published, somebody: 838", "pendulum swingup"),
        *("thousand control steps", "minutes of one processor core", "kept &amp; read"),
    ):
        assert f">{words}<" in text
    assert text.count(">pendulum swingup<") == 2  # over steps and over minutes
    assert _written(tmp_path / "again.svg", [task], "kept & read") == text


def test_a_learning_plot_of_many_tasks_has_a_panel_for_each(tmp_path: Path) -> None:
    tasks = [Learning(f"task {number}", [_RUN, _RUN]) for number in range(7)]
    text = _written(tmp_path / "curves.svg", tasks)
    for number in range(7):
        assert text.count(f">task {number}<") == 2
    assert "seed 0" not in text  # no legend


def test_the_returns_of_untrained_policies_do_not_squeeze_a_learning_plot() -> None:
    from matplotlib.figure import Figure  # which few processes of the tests need

    axes: Any = Figure().subplots()
    for over, most in ((curve._STEPS, 1.5), ("minutes of one processor core", 5.0)):
        axes.clear()
        curve._draw_learning(axes, Learning("a task", [_RUN], _OWN, (700.0, "best")), over)
        low, high = axes.get_ylim()
        assert -50 < low < 0
        assert 700 < high < 750
        shown = {tuple(line.get_ydata()) for line in axes.lines}
        assert {tuple(_RUN.returns), tuple(_OWN.returns), (700.0, 700.0)} == shown
        ends = [line.get_xdata()[-1] for line in axes.lines[:2]]
        assert max(ends) == pytest.approx(most)


def test_a_learning_plot_is_a_png_too_and_needs_matplotlib(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "curve.png"
    write_learning_plot(path, [Learning("a task", [], _OWN)])
    assert _size(path) == (960, 600)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"needs the extra 'video': pip install"):
        write_learning_plot(tmp_path / "none.png", [Learning("a task", [], _OWN)])
    assert list(tmp_path.iterdir()) == [path]
