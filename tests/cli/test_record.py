"""`limberjack record`: films, and messages where there can be none."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
import typer.testing

from limberjack import data, suite
from limberjack.cli import app
from limberjack.episodes.films import _Stage
from limberjack.mujoco.camera import RenderingError
from limberjack.utils.files import Hold
from limberjack.workers.factories import factory_of
from tests.policies import saved_models

_SIZE = ["--height", "96", "--width", "128"]
_WALK = ["record", "humanoid", "walk", "--seconds", "0.5"]


def _invoke(*arguments: object) -> Any:
    return typer.testing.CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def _drawing() -> None:
    try:
        suite.load("humanoid", "stand").physics.render(height=8, width=8)
    except RenderingError as error:
        pytest.skip(f"no OpenGL here: {error}")


def _frames(path: Path) -> tuple[str, np.ndarray]:
    """ffmpeg's description of a video, and its frames, (n, height, width, 3)."""
    raw = ["-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-i", path, *raw],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=True,
    )
    facts = re.search(r"Stream.* Video: (.*)", done.stderr.decode())
    assert facts is not None
    size = re.search(r", (\d+)x(\d+)", facts[1])
    assert size is not None
    pixels = np.frombuffer(done.stdout, np.uint8)
    return facts[1], pixels.reshape(-1, int(size[2]), int(size[1]), 3)


@pytest.mark.usefixtures("_drawing")
def test_an_episode_is_filmed_as_mp4(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    done = _invoke(*_WALK, *_SIZE, "--out", path, "--policy", "random", "--camera", "side")
    assert done.exit_code == 0, done.output
    assert done.stdout == f"{path}\n"
    facts, frames = _frames(path)
    assert facts.startswith("h264")
    assert " 40 fps" in facts
    assert frames.shape == (21, 96, 128, 3)
    assert list(tmp_path.iterdir()) == [path]

    env = suite.load("humanoid", "walk", {"random": 0})
    env.reset()
    start = env.physics.render(96, 128, camera_id="side")
    assert np.abs(frames[0].astype(int) - start.astype(int)).mean() < 8  # H.264 loses detail


@pytest.mark.usefixtures("_drawing")
def test_an_episode_is_filmed_as_gif_in_real_time(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    assert _invoke(*_WALK, *_SIZE, "--out", path).exit_code == 0
    facts, frames = _frames(path)
    assert facts.startswith("gif")
    assert " 20 fps" in facts
    assert frames.shape == (11, 96, 128, 3)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("_drawing")
def test_rows_are_filmed_side_by_side(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    arguments = ["record", "manipulator", "bring_ball", "--seconds", "0.04", "--camera", "fixed"]
    done = _invoke(*arguments, *_SIZE, "--rows", 3, "--seed", 5, "--overlay", "--out", path)
    assert done.exit_code == 0, done.output
    _, frames = _frames(path)
    assert frames.shape == (2, 96, 128, 3)
    assert not frames[:, 48:, 64:].any()  # there is no fourth row


@pytest.mark.usefixtures("_drawing")
@pytest.mark.parametrize("where", [("humanoid", "walk"), ("manipulator", "bring_ball")])
@pytest.mark.parametrize("colours", [False, True])
def test_a_row_looks_as_the_single_environment_with_its_seed(
    where: tuple[str, str], colours: bool
) -> None:
    stage = _Stage(factory_of(*where), 7, 1.0, colours)
    assert stage._environment.task.visualize_reward == colours
    stage.set_view(0, 96, 128, 4, overlay=False)
    batch = suite.load_batch(*where, num_envs=4, seed=7)
    singles = [suite.load(*where, {"random": 7 + i}, visualize_reward=colours) for i in range(4)]
    time_step = batch.reset()
    for env in singles:
        env.reset()
    for step in range(3):
        for row, env in enumerate(singles):
            picture = stage._row(batch, row, step, time_step, np.zeros(4))
            drawn = env.physics.render(48, 64, camera_id=0)
            np.testing.assert_array_equal(picture, drawn)
            env.step(np.full(env.action_spec().shape, 0.5))
        time_step = batch.step(np.full(batch.action_spec().shape, 0.5))


@pytest.mark.usefixtures("_drawing")
def test_time_and_reward_are_drawn_in_a_corner_and_colours_change(tmp_path: Path) -> None:
    films = {}
    for name, options in {
        "plain": [],
        "text": ["--overlay"],
        "red": ["--visualize-reward"],
    }.items():
        path = tmp_path / f"{name}.gif"
        arguments = ["record", "stacker", "stack_2", "--seconds", "0.04", "--out", path]
        assert _invoke(*arguments, "--height", 240, "--width", 320, *options).exit_code == 0
        films[name] = _frames(path)[1].astype(int)
    changed = np.abs(films["text"] - films["plain"]).max(axis=(0, -1)) > 50
    assert changed[160:, :120].any()  # bottom left
    assert not changed[:120].any()


@pytest.mark.usefixtures("_drawing")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "film.avi"], "a film called 'film.avi'; expected a name that ends in .mp4 or"),
        (["--out", "film"], "expected a name that ends in .mp4 or .gif"),
        (["--out", "nowhere/film.mp4"], "there is no directory nowhere"),
        (["--rows", "3", "--seed", str(2**32 - 2)], "last row's seed is 4294967296; expected"),
        (["--camera", "sied"], "sied"),
        (["--camera", "7"], "camera_id is 7"),
        (["--height", "99"], "H.264 needs even numbers"),
        (["--height", "20000"], "image height 20000 > 2160"),
        (["--rows", "10000"], "too small for 10000 rows"),
        (["--seconds", "0"], "seconds is 0.0; expected a positive number"),
        (["--seconds", "nan"], "seconds is nan"),
        (["--seconds", "inf"], "seconds is inf; expected a positive number"),
        (["--policy", "radnom"], "Did you mean 'random'?"),
        (["--policy", "planner", "--rows", "2"], "policy 'planner' acts in one environment; leave"),
    ],
)
def test_a_mistake_is_one_line_and_status_2_and_leaves_nothing(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))  # the command adds the working directory
    done = _invoke(*_WALK, *_SIZE, "--out", "film.mp4", *arguments)
    assert done.exit_code == 2, done.output
    assert message in done.stderr
    assert done.stderr.startswith("limberjack: ")
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("_drawing")
@pytest.mark.parametrize("rows", [1, 2])
def test_a_film_may_be_larger_than_the_models_own_pictures(tmp_path: Path, rows: int) -> None:
    path = tmp_path / "film.mp4"
    size = ["--height", 720, "--width", 1300]
    done = _invoke(*_WALK[:3], "--seconds", "0.025", *size, "--rows", rows, "--out", path)
    assert done.exit_code == 0, done.output
    assert _frames(path)[1].shape == (2, 720, 1300, 3)


@pytest.mark.usefixtures("_drawing")
def test_a_directory_is_refused_before_anything_is_filmed(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    path.mkdir()
    done = _invoke(*_WALK, *_SIZE, "--out", path)
    assert done.exit_code == 2
    assert done.stderr == f"limberjack: the film is {path}, a directory; expected a file's name\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("_drawing")
def test_a_saved_model_is_filmed_alone_and_in_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = saved_models.install(monkeypatch, tmp_path)
    films = {}
    for rows in (1, 2):
        path = tmp_path / f"{rows}.gif"
        arguments = [*_WALK[:3], "--seconds", "0.1", *_SIZE, "--out", path, "--rows", rows]
        done = _invoke(*arguments, "--policy", name, "--seed", 63)
        assert done.exit_code == 0, done.output
        films[rows] = _frames(path)[1]
    assert len(films[1]) == len(films[2]) == 3
    assert (films[1][0] != films[1][-1]).any()
    wrong = _invoke("record", "stacker/stack_2", "--out", tmp_path / "3.gif", "--policy", name)
    assert wrong.exit_code == 2
    assert "the model's actions have shape (21,)" in wrong.stderr


@pytest.mark.usefixtures("_drawing")
def test_the_film_of_a_run_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "video.mp4"
    (tmp_path / "result.json").write_text("{}")
    done = _invoke(*_WALK, *_SIZE, "--out", path)
    assert done.exit_code == 2
    assert done.stderr == (
        f"limberjack: the film is {path}, and that folder's result.json belongs to its present "
        "video.mp4: choose another name or folder\n"
    )
    assert not path.exists()
    other = _invoke(*_WALK[:3], "--seconds", "0.025", *_SIZE, "--out", tmp_path / "other.mp4")
    assert other.exit_code == 0, other.output


def test_a_folder_that_a_run_writes_to_is_refused_for_its_film(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    with Hold(tmp_path):
        done = _invoke(*_WALK, *_SIZE, "--out", tmp_path / "video.mp4")
    assert done.exit_code == 2
    assert f"another process writes to {tmp_path}" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("task", [["humanid", "walk"], ["humanoid", "wlak"]])
def test_an_unknown_task_is_status_2_with_a_suggestion(task: list[str], tmp_path: Path) -> None:
    done = _invoke("record", *task, "--out", tmp_path / "film.mp4")
    assert done.exit_code == 2
    assert "Did you mean" in done.stderr


def test_without_opengl_it_is_one_line_and_status_1(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "limberjack", *_WALK, "--out", "film.mp4"],
        cwd=tmp_path,
        env=os.environ | {"MUJOCO_GL": "disable"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("limberjack: no film.mp4: ")
    assert "MUJOCO_GL" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("_drawing")
def test_without_ffmpeg_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    done = _invoke(*_WALK, *_SIZE, "--out", tmp_path / "film.gif")
    assert done.exit_code == 1
    assert "needs the extra 'video': pip install imageio-ffmpeg matplotlib" in done.stderr


_POLICY = """
import os, signal
import numpy as np

class Interrupted:
    signal = signal.SIGINT

    def reset(self):
        self.step = 0

    def act(self, observation):
        self.step += 1
        if self.step == 5:
            os.kill(os.getpid(), self.signal)
        return np.zeros(21)

class Terminated(Interrupted):
    signal = signal.SIGTERM

def wrong(observation):
    return np.full(21, np.nan)
"""


@pytest.mark.usefixtures("_drawing")
@pytest.mark.parametrize("rows", ["1", "2"])
@pytest.mark.parametrize(
    ("policy", "status", "message"),
    [
        ("Interrupted", 130, "limberjack: interrupted: film.mp4 is not written"),
        ("Terminated", 143, "limberjack: interrupted: film.mp4 is not written"),
        ("wrong", 1, "returned nan at index"),
    ],
)
def test_a_film_that_is_cut_short_leaves_nothing_of_itself(
    policy: str, status: int, message: str, rows: str, tmp_path: Path
) -> None:
    (tmp_path / "policies_of_mine.py").write_text(_POLICY)
    arguments = [*_WALK, *_SIZE, "--rows", rows, "--policy", f"policies_of_mine:{policy}"]
    done = subprocess.run(
        [sys.executable, "-B", "-m", "limberjack", *arguments, "--out", "film.mp4"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == status, done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["policies_of_mine.py"]


@pytest.mark.usefixtures("_drawing")
def test_an_episode_of_a_dataset_is_filmed(tmp_path: Path) -> None:
    data.collect("pendulum", "swingup", "random", range(2), out=tmp_path, time_limit=0.1)
    film = tmp_path / "film.gif"
    result = _invoke("record", "--from", tmp_path, "--seed", "1", *_SIZE, "--out", film)
    assert (result.exit_code, result.stdout) == (0, f"{film}\n")
    assert film.read_bytes().startswith(b"GIF89a")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "got no task; expected DOMAIN TASK, or --from DIR of a dataset"),
        (["pendulum", "--from", "data"], "leave out DOMAIN TASK, --policy, --seconds and --rows"),
        (["--from", "data", "--rows", "2"], "leave out DOMAIN TASK"),
        (["--from", "data"], "data is no folder"),
    ],
)
def test_a_film_is_of_a_task_or_of_a_dataset(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = _invoke("record", "--out", "film.gif", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
