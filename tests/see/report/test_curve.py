"""The pictures of returns: one line per episode, and many returns in order of size."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from limberjack.episodes import Episode
from limberjack.see import report
from limberjack.see.report import write_distribution_plot

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
    with pytest.raises(ImportError, match=r"pip install imageio-ffmpeg matplotlib"):
        report.write_return_plot(tmp_path / "return.png", "", _EPISODES, 0.01)
