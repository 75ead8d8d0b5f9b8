"""The files of a run: what is written, what is left out and why, and what an earlier run left."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.episodes import Episode
from limberjack.mujoco.camera import RenderingError
from limberjack.see import report
from limberjack.see.report import Step

_EPISODES = [Episode(0, None, np.array([0.25, 0.5]))]


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> Any:
    """An environment that cannot be drawn."""
    env = suite.load("humanoid", "stand", {"random": 0, "time_limit": 0.05})
    env.reset()

    def fail(*_: Any, **__: Any) -> None:
        raise RenderingError("no\n  OpenGL")

    monkeypatch.setattr(type(env.physics), "render", fail)
    return env


def _about(env: Any) -> dict[str, Any]:
    return {
        "domain": "humanoid",
        "task": "stand",
        "policy": "zero",
        "time_limit": 0.05,
        "control_timestep": env.control_timestep(),
        "episodes_asked_for": 1,
    }


_RUN = {"domain": "humanoid", "task": "stand", "policy": "random"}


def _played(recorder: report.Recorder, env: Any) -> None:
    recorder.begin(env)
    recorder.add_step(Step(0, 0.0, env.reset(), None))
    total = 0.0
    for number in (1, 2):
        action = np.zeros(21)
        time_step = env.step(action)
        total += time_step.reward
        recorder.add_step(Step(number, total, time_step, action))


def test_an_episode_that_cannot_be_filmed_is_reported_in_one_line_and_the_rest_is_written(
    environment: Any, tmp_path: Path
) -> None:
    out = tmp_path / "new" / "out"
    recorder = report.Recorder(out, _about(environment), "limberjack run humanoid stand")
    _played(recorder, environment)
    recorder.write(_about(environment), _EPISODES, "abc")
    assert recorder.left_out == ["no video.mp4: no OpenGL"]
    names = ["result.json", "return.png", "report.html"]
    assert [path.name for path in recorder.written] == names
    assert sorted(path.name for path in out.iterdir()) == sorted(names)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "<code>limberjack run humanoid stand</code>" in page
    assert "There is no video: no OpenGL" in page


def test_files_of_an_earlier_run_that_this_run_lacks_are_removed(
    environment: Any, tmp_path: Path
) -> None:
    for name in ("video.mp4", "return.png", "report.html", "notes.txt"):
        (tmp_path / name).write_text("old")
    (tmp_path / "result.json").write_text(json.dumps(_about(environment)))
    recorder = report.Recorder(tmp_path, _about(environment))
    recorder.write(_about(environment), [], "abc")  # no episode ended
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "result.json"]
    assert json.loads((tmp_path / "result.json").read_text())["episodes"] == []


def test_without_the_extra_film_and_plot_share_a_reason(
    environment: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    recorder = report.Recorder(tmp_path, _about(environment))
    _played(recorder, environment)
    recorder.write(_about(environment), _EPISODES, "abc")
    (line,) = recorder.left_out
    assert line.startswith("no video.mp4 and no return.png: ")
    assert [path.name for path in recorder.written] == ["result.json", "report.html"]


def test_a_result_that_cannot_be_written_is_the_callers_error(
    environment: Any, tmp_path: Path
) -> None:
    recorder = report.Recorder(tmp_path, _about(environment))
    (tmp_path / "result.json").mkdir()
    with pytest.raises(OSError, match=r"result\.json"):
        recorder.write(_about(environment), _EPISODES, "abc")
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


class _Film:
    """A film that is not drawn."""

    def __init__(self, path: Path, control_timestep: float, camera: int) -> None:
        self._path = path

    def add(self, physics: object) -> None:
        pass

    def finish(self) -> None:
        self._path.write_text("new")

    def discard(self) -> None:
        pass


def test_a_film_is_put_beside_the_result_that_it_belongs_to(
    environment: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.see.report.recorder.Film", _Film)
    film = tmp_path / "video.mp4"
    for before in (None, "old"):
        if before is not None:
            film.write_text(before)
        with report.Recorder(tmp_path, _about(environment)) as recorder:
            _played(recorder, environment)
            # A run that is killed in a later episode leaves the folder as it was.
            assert (film.read_text() if film.exists() else None) == before
            recorder.write(_about(environment), _EPISODES, "abc")
            assert film.read_text() == "new"
            names = ["result.json", "return.png", "video.mp4", "report.html"]
            assert [path.name for path in recorder.written] == names


def test_files_are_written_where_they_were_asked_for_though_the_policy_moves(
    environment: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with report.Recorder(Path("out"), _about(environment)) as recorder:
        monkeypatch.chdir("/")
        _played(recorder, environment)
        recorder.write(_about(environment), _EPISODES, "abc")
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs Linux's /proc")
def test_a_directory_that_cannot_be_written_is_refused_at_once() -> None:
    with pytest.raises(OSError, match=r"/proc/self"):
        report.Recorder(Path("/proc/self"), _RUN)


def test_a_directory_is_one_recorders_and_of_one_task_and_policy(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    with report.Recorder(tmp_path, _RUN) as first:
        with pytest.raises(ValueError, match="another process writes to"):
            report.Recorder(tmp_path, _RUN)
        first.write(_RUN, [], "abc")
    for name, other in (("domain", "stacker"), ("task", "run"), ("policy", "zero")):
        with pytest.raises(ValueError, match=f"holds results with {name} '{_RUN[name]}', and"):
            report.Recorder(tmp_path, _RUN | {name: other})
    report.Recorder(tmp_path, _RUN | {"time_limit": 1.0}).close()
    (tmp_path / "episodes.jsonl").touch()
    with pytest.raises(ValueError, match="holds an evaluation: choose another folder"):
        report.Recorder(tmp_path, _RUN)
