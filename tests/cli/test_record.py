"""`limberjack record`: films, and messages where there can be none."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
import typer.testing

from limberjack import data, policies, suite
from limberjack.cli import app
from limberjack.episodes.films import DepartedError
from limberjack.utils import png
from limberjack.utils.files import Hold
from tests.policies import saved_models

_SIZE = ["--height", "96", "--width", "128"]
_WALK = ["record", "humanoid", "walk", "--seconds", "0.5"]


def _invoke(*arguments: object) -> Any:
    return typer.testing.CliRunner().invoke(app, [str(argument) for argument in arguments])


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


@pytest.mark.usefixtures("pictures")
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


@pytest.mark.usefixtures("pictures")
def test_an_episode_is_filmed_as_gif_in_real_time(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    assert _invoke(*_WALK, *_SIZE, "--out", path).exit_code == 0
    facts, frames = _frames(path)
    assert facts.startswith("gif")
    assert " 20 fps" in facts
    assert frames.shape == (11, 96, 128, 3)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("pictures")
def test_rows_are_filmed_side_by_side(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    arguments = ["record", "manipulator", "bring_ball", "--seconds", "0.04", "--camera", "fixed"]
    done = _invoke(*arguments, *_SIZE, "--rows", 3, "--seed", 5, "--overlay", "--out", path)
    assert done.exit_code == 0, done.output
    _, frames = _frames(path)
    assert frames.shape == (2, 96, 128, 3)
    assert not frames[:, 48:, 64:].any()  # there is no fourth row


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize("where", [("humanoid", "walk"), ("manipulator", "bring_ball")])
@pytest.mark.parametrize("colours", [False, True])
def test_a_row_looks_as_the_single_environment_with_its_seed(
    where: tuple[str, str],
    colours: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    films: list[np.ndarray] = []

    class Frames:
        def __init__(self, path: Path, control_timestep: float, **size: int) -> None:
            pass

        def add_picture(self, draw: Callable[[], np.ndarray]) -> None:
            films.append(draw().copy())

        def finish(self) -> None:
            pass

        discard = finish

    monkeypatch.setattr("limberjack.episodes.films.Film", Frames)
    arguments = ["--rows", 4, "--seed", 7, "--out", tmp_path / "film.gif", "--policy", "random"]
    options = [*_SIZE, *(["--visualize-reward"] if colours else [])]
    step = suite.load(*where).control_timestep()
    done = _invoke("record", *where, *arguments, *options, "--seconds", 3 * step)
    assert done.exit_code == 0, done.output
    assert len(films) == 1 + 3
    for row, (top, left) in enumerate([(0, 0), (0, 64), (48, 0), (48, 64)]):
        env = suite.load(*where, {"random": 7 + row}, visualize_reward=colours)
        act = policies.find("random", env).begin_alone(env, 7 + row)
        time_step = env.reset()
        for picture in films:
            drawn = env.physics.render(48, 64, camera_id=0)
            np.testing.assert_array_equal(picture[top : top + 48, left : left + 64], drawn)
            time_step = env.step(act(time_step.observation))


@pytest.mark.usefixtures("pictures")
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


@pytest.mark.usefixtures("pictures")
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
        (["--rows", "10000"], "rows is 10000; expected at most 64 episodes side by side"),
        (["--rows", "60", "--height", "14"], "too small for 60 rows"),
        (["--action-repeat", "2", "--policy", "planner"], "'planner' acts at every control step"),
        (["--seconds", "0"], "seconds is 0.0; expected a positive number"),
        (["--seconds", "nan"], "seconds is nan"),
        (["--seconds", "inf"], "seconds is inf; expected a positive number"),
        (["--policy", "radnom"], "Did you mean 'random'?"),
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


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize("rows", [1, 2])
def test_a_film_may_be_larger_than_the_models_own_pictures(tmp_path: Path, rows: int) -> None:
    path = tmp_path / "film.mp4"
    size = ["--height", 720, "--width", 1300]
    done = _invoke(*_WALK[:3], "--seconds", "0.025", *size, "--rows", rows, "--out", path)
    assert done.exit_code == 0, done.output
    assert _frames(path)[1].shape == (2, 720, 1300, 3)


@pytest.mark.usefixtures("pictures")
def test_a_directory_is_refused_before_anything_is_filmed(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    path.mkdir()
    done = _invoke(*_WALK, *_SIZE, "--out", path)
    assert done.exit_code == 2
    assert done.stderr == f"limberjack: the film is {path}, a directory; expected a file's name\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("pictures")
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


@pytest.mark.usefixtures("pictures")
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
    assert done.stderr.endswith("; film.mp4 is not written\n")
    assert "MUJOCO_GL" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("pictures")
def test_without_ffmpeg_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    done = _invoke(*_WALK, *_SIZE, "--out", tmp_path / "film.gif")
    assert done.exit_code == 1
    assert "needs the extra 'video': pip install imageio-ffmpeg matplotlib pillow" in done.stderr


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


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize(
    ("policy", "rows", "status"), [("Interrupted", "1", 130), ("Terminated", "2", 143)]
)
def test_a_film_that_is_interrupted_leaves_nothing_of_itself(
    policy: str, rows: str, status: int, tmp_path: Path
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
    assert "limberjack: interrupted: film.mp4 is not written" in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["policies_of_mine.py"]


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize("rows", [1, 2])
def test_a_film_of_a_policy_that_fails_leaves_nothing_of_itself(
    rows: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "policies_that_fail.py").write_text(_POLICY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    film = tmp_path / "film.mp4"
    policy = ["--rows", rows, "--policy", "policies_that_fail:wrong"]
    done = _invoke(*_WALK, *_SIZE, *policy, "--out", film)
    assert done.exit_code == 1
    assert "returned nan at index" in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["policies_that_fail.py"]


@pytest.mark.usefixtures("pictures")
def test_a_damaged_picture_of_the_background_is_named_in_one_line(tmp_path: Path) -> None:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    (pictures / "1.png").write_bytes(png.encode(np.full((6, 8, 3), 7, np.uint8)))
    (pictures / "2.png").write_bytes((pictures / "1.png").read_bytes()[:50])
    appearance = json.dumps({"background": f"images:{pictures}", "dynamic": ["background"]})
    done = _invoke(*_WALK, *_SIZE, "--appearance", appearance, "--out", tmp_path / "film.gif")
    assert done.exit_code == 1
    assert re.fullmatch(
        r"limberjack: the picture .*2\.png cannot be .*; .*film\.gif is not written\n", done.stderr
    )
    assert list(tmp_path.iterdir()) == [pictures]


@pytest.mark.usefixtures("pictures")
def test_an_episode_of_a_dataset_is_filmed(tmp_path: Path) -> None:
    data.collect("pendulum", "swingup", "random", range(2), out=tmp_path, time_limit=0.1)
    film = tmp_path / "film.gif"
    result = _invoke("record", "--from", tmp_path, "--seed", "1", *_SIZE, "--out", film)
    assert (result.exit_code, result.stdout) == (0, f"{film}\n")
    assert film.read_bytes().startswith(b"GIF89a")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            [],
            "got no task; expected DOMAIN TASK, or --env MODULE:FUNCTION",
        ),
        (
            ["pendulum", "--from", "data"],
            "got DOMAIN beside --from data, which has the episode: leave it out",
        ),
        (["--from", "data", "--action-repeat", "1"], "got --action-repeat beside --from data"),
        (["--from", "data", "--rows", "2"], "got --rows beside --from data"),
        (["--from", "data", "--seconds", "2"], "got --seconds beside --from data"),
        (["--from", "data", "--policy", "random"], "got --policy beside --from data"),
        (["--from", "data", "--faults", "easy"], "got --faults beside --from data"),
        (["--from", "data", "--appearance", "color_easy"], "got --appearance beside --from data"),
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


@pytest.mark.usefixtures("pictures")
def test_the_planner_is_filmed_in_rows_each_planning_for_itself(tmp_path: Path) -> None:
    film = tmp_path / "film.gif"
    task = ["record", "manipulator", "bring_ball", "--seconds", "0.04", "--policy", "planner"]
    assert _invoke(*task, *_SIZE, "--rows", 2, "--out", film).exit_code == 0
    assert _frames(film)[1].shape == (2, 96, 128, 3)


@pytest.mark.usefixtures("pictures")
def test_an_episode_of_a_dataset_that_is_another_one_here_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def departed(*arguments: object, **others: object) -> None:
        raise DepartedError("the episode has other rewards")

    monkeypatch.setattr("limberjack.episodes.films._check_same", departed)
    data.collect("pendulum", "swingup", "random", range(1), out=tmp_path, time_limit=0.1)
    film = tmp_path / "film.gif"
    result = _invoke("record", "--from", tmp_path, *_SIZE, "--out", film)
    assert result.exit_code == 1
    assert result.stderr == f"limberjack: the episode has other rewards; {film} is not written\n"


@pytest.mark.usefixtures("pictures")
def test_the_datasets_of_run_and_solve_are_filmed(tmp_path: Path) -> None:
    for command, more in (("run", ["--policy", "random"]), ("solve", ["--threads", "1"])):
        out, film = tmp_path / command, tmp_path / f"{command}.gif"
        made = _invoke(command, "pendulum", "swingup", "--time-limit", 0.1, *more, "--out", out)
        assert made.exit_code == 0, made.output
        result = _invoke("record", "--from", out, *_SIZE, "--out", film)
        assert (result.exit_code, result.stdout) == (0, f"{film}\n"), result.output
        assert len(_frames(film)[1]) == 3  # of 6, at 25 a second
