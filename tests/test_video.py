"""Films: what is written, how fast it plays, and what happens when it cannot be."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco.camera import RenderingError
from limberjack.video import Film, frame_stride

_HEIGHT, _WIDTH = 48, 64


@pytest.fixture
def environment() -> Any:
    """An environment that can be drawn."""
    environment = suite.load("humanoid", "walk", task_kwargs={"random": 0, "time_limit": 1.0})
    environment.reset()
    try:
        environment.physics.render(height=_HEIGHT, width=_WIDTH, camera_id=0)
    except RenderingError as error:
        pytest.skip(f"no OpenGL here: {error}")
    return environment


def _film(path: Path, environment: Any) -> Film:
    return Film(path, environment.control_timestep(), height=_HEIGHT, width=_WIDTH)


def _read(path: Path) -> tuple[str, np.ndarray]:
    """What ffmpeg says of a video's stream, and the frames."""
    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    raw = ["-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(
        [ffmpeg, "-i", path, *raw], stdin=subprocess.DEVNULL, capture_output=True, check=True
    )
    stream = re.search("Stream.* Video: (.*)", done.stderr.decode())
    assert stream is not None
    return stream[1], np.frombuffer(done.stdout, np.uint8).reshape(-1, _HEIGHT, _WIDTH, 3)


@pytest.mark.parametrize(
    ("control_timestep", "stride"),
    [(0.025, 1), (0.02, 1), (0.01, 2), (0.04 / 2, 1), (0.1 / 5, 1), (0.001, 20), (0.03, 1), (1, 1)],
)
def test_a_frame_is_drawn_up_to_fifty_times_a_second(control_timestep: float, stride: int) -> None:
    assert frame_stride(control_timestep) == stride


def test_a_film_is_h264_that_browsers_play_in_real_time(tmp_path: Path, environment: Any) -> None:
    path = tmp_path / "video.mp4"
    film = _film(path, environment)
    film.add(environment.physics)
    for _ in range(40):
        environment.step(np.zeros(21))
        film.add(environment.physics)
    assert not path.exists()
    film.finish()

    facts, frames = _read(path)
    assert facts.startswith("h264")
    assert " yuv420p" in facts
    assert f" {_WIDTH}x{_HEIGHT}" in facts
    assert " 40 fps" in facts  # a frame per control step of 0.025 s
    assert len(frames) == 41
    # The index stands before the pictures, so that a browser need not load the whole file first.
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")
    assert list(tmp_path.iterdir()) == [path]


def test_a_film_shows_what_is_rendered(tmp_path: Path, environment: Any) -> None:
    path = tmp_path / "video.mp4"
    film = _film(path, environment)
    drawn = environment.physics.render(height=_HEIGHT, width=_WIDTH, camera_id=0)
    film.add(environment.physics)
    film.finish()
    _, frames = _read(path)
    # H.264 loses detail, and colour at half the resolution: a few grey levels on average.
    assert np.abs(frames[0].astype(int) - drawn.astype(int)).mean() < 8


def test_short_steps_are_drawn_in_part(tmp_path: Path) -> None:
    path = tmp_path / "video.mp4"
    arm = suite.load("stacker", "stack_2", task_kwargs={"random": 0})
    arm.reset()
    film = Film(path, arm.control_timestep(), height=_HEIGHT, width=_WIDTH)
    try:
        for _ in range(10):
            film.add(arm.physics)
    except RenderingError as error:
        film.discard()
        pytest.skip(f"no OpenGL here: {error}")
    film.finish()
    facts, frames = _read(path)
    assert " 50 fps" in facts
    assert len(frames) == 5


def test_a_film_that_is_dropped_leaves_nothing(tmp_path: Path, environment: Any) -> None:
    film = _film(tmp_path / "video.mp4", environment)
    film.add(environment.physics)
    film.discard()
    film.discard()
    assert not list(tmp_path.iterdir())


def test_a_film_without_frames_is_an_error_and_leaves_nothing(
    tmp_path: Path, environment: Any
) -> None:
    film = _film(tmp_path / "video.mp4", environment)
    with pytest.raises(OSError, match="it has no frames"):
        film.finish()
    assert not list(tmp_path.iterdir())


def test_a_film_that_cannot_be_written_says_so(tmp_path: Path, environment: Any) -> None:
    path = tmp_path / "no such directory" / "video.mp4"
    film = _film(path, environment)
    with pytest.raises(OSError, match=r"video\.mp4 cannot be written: .*No such file"):  # noqa: PT012
        # How many frames go into the pipe before the encoder's end is noticed is up to the system.
        for _ in range(100):
            film.add(environment.physics)
        film.finish()
    film.discard()


def test_odd_sizes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"31x64 pixels: H\.264 needs even numbers"):
        Film(tmp_path / "video.mp4", 0.02, height=31, width=64)


def test_without_ffmpeg_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"pip install 'limberjack\[video\]'"):
        Film(tmp_path / "video.mp4", 0.02)
