"""Films: their frames and speed, and errors in writing them."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.see.video import Film, Writer, first_camera, frame_stride, mosaic
from tests.programs import run

_HEIGHT, _WIDTH = 48, 64


@pytest.fixture
def environment(pictures: None) -> Any:
    """An environment that can be drawn."""
    environment = suite.load("humanoid", "walk", task_kwargs={"random": 0, "time_limit": 1.0})
    environment.reset()
    return environment


def _film(path: Path, environment: Any) -> Film:
    return Film(path, environment.control_timestep(), height=_HEIGHT, width=_WIDTH)


def _read(path: Path) -> tuple[str, np.ndarray]:
    """ffmpeg's description of a video, and its frames."""
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
    [
        *((0.025, 1), (0.02, 1), (0.01, 2), (0.001, 20), (0.03, 1), (1, 1)),
        *((0.02 * (1 - 2**-52), 1), (0.01 * (1 - 2**-52), 2)),  # the last bit does not matter
    ],
)
def test_a_frame_is_drawn_up_to_fifty_times_a_second(control_timestep: float, stride: int) -> None:
    assert frame_stride(control_timestep) == stride


def test_a_model_without_cameras_is_seen_from_the_free_one() -> None:
    for world, expected in (("", -1), ("<camera/>", 0)):
        text = f"<mujoco><worldbody>{world}</worldbody></mujoco>"
        assert first_camera(mujoco.MjModel.from_xml_string(text)) == expected


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


def test_a_film_shows_the_rendered_pictures(tmp_path: Path, environment: Any) -> None:
    path = tmp_path / "video.mp4"
    film = _film(path, environment)
    drawn = environment.physics.render(height=_HEIGHT, width=_WIDTH, camera_id=0)
    film.add(environment.physics)
    film.finish()
    _, frames = _read(path)
    # H.264 loses detail, and colour at half the resolution: a few grey levels on average.
    assert np.abs(frames[0].astype(int) - drawn.astype(int)).mean() < 8


@pytest.mark.usefixtures("pictures")
def test_short_steps_are_drawn_in_part(tmp_path: Path) -> None:
    path = tmp_path / "video.mp4"
    arm = suite.load("stacker", "stack_2", task_kwargs={"random": 0})
    arm.reset()
    film = Film(path, arm.control_timestep(), height=_HEIGHT, width=_WIDTH)
    for _ in range(10):
        film.add(arm.physics)
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
    with pytest.raises(ValueError, match=r"32x63 pixels: H\.264 needs even numbers"):
        Film(tmp_path / "film.mp4", 0.02, height=32, width=63)
    with pytest.raises(ValueError, match=r"31x64 pixels: H\.264 needs even numbers"):
        Film(tmp_path / "video.mp4", 0.02, height=31, width=64)


def test_without_ffmpeg_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"pip install imageio-ffmpeg matplotlib pillow"):
        Film(tmp_path / "video.mp4", 0.02)


def _moving_frames(count: int) -> np.ndarray:
    """A square that moves over a gradient, (count, height, width, 3)."""
    frames = np.zeros((count, _HEIGHT, _WIDTH, 3), np.uint8)
    frames[...] = np.linspace(0, 200, _WIDTH, dtype=np.uint8)[:, None]
    for number, frame in enumerate(frames):
        frame[10:20, number : number + 10] = 255, 40, 0
    return frames


def test_a_gif_shows_its_frames_in_real_time(tmp_path: Path) -> None:
    path, frames = tmp_path / "film.GIF", _moving_frames(30)
    writer = Writer(path, _HEIGHT, _WIDTH, 20.0)
    for frame in frames:
        writer.write(frame)
    assert not path.exists()
    writer.finish()
    facts, seen = _read(path)
    assert facts.startswith("gif")
    assert " 20 fps" in facts
    assert seen.shape == frames.shape
    assert np.abs(seen.astype(int) - frames).mean() < 4  # of 256 colours
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("size", [(47, 63), (1, 1), (200, 3)])
def test_a_gif_may_have_any_size_and_a_single_frame(tmp_path: Path, size: tuple[int, int]) -> None:
    path = tmp_path / "film.gif"
    writer = Writer(path, *size, 20.0)
    writer.write(np.full((*size, 3), 100, np.uint8))
    writer.finish()
    assert path.read_bytes().startswith(b"GIF89a")


@pytest.mark.parametrize("name", ["12:30.mp4", "12:30.gif", "run:1/film.mp4", "100%d '?.gif"])
def test_a_film_may_have_any_name(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # an absolute path is never taken for an address
    path = Path(name)
    path.parent.mkdir(exist_ok=True)
    writer = Writer(path, 16, 16, 20.0)
    writer.write(np.zeros((16, 16, 3), np.uint8))
    writer.finish()
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_video_that_cannot_be_written_names_itself_and_leaves_nothing(
    tmp_path: Path, name: str
) -> None:
    # A file may have no more than this, as on a full disk; in a process of its own, for good.
    program = f"""
        import resource
        from pathlib import Path
        import numpy as np
        from limberjack.see.video import Writer
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
        writer = Writer(Path({str(tmp_path / name)!r}), 240, 320, 20.0)
        random = np.random.RandomState(0)
        try:
            for _ in range(40):
                writer.write(random.randint(256, size=(240, 320, 3)).astype(np.uint8))
            writer.finish()
        except OSError as error:
            print(error)
        writer.discard()
    """
    assert f"{name} cannot be written: ffmpeg was ended: File size limit" in run(program)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_on_a_full_disk_a_video_names_itself_and_leaves_nothing(tmp_path: Path, name: str) -> None:
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", tmp_path],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.strip()}")
    try:
        writer = Writer(tmp_path / name, 240, 320, 20.0)
        random = np.random.RandomState(0)
        with pytest.raises(OSError, match=rf"{name} cannot be written: .*No space left"):  # noqa: PT012
            for _ in range(60):
                writer.write(random.randint(256, size=(240, 320, 3)).astype(np.uint8))
            writer.finish()
        writer.discard()
        assert not list(tmp_path.iterdir())
    finally:
        subprocess.run(["umount", tmp_path], check=True)


def test_a_video_takes_frames_of_its_size_only(tmp_path: Path) -> None:
    writer = Writer(tmp_path / "film.mp4", _HEIGHT, _WIDTH, 20.0)
    for wrong in (np.zeros((_WIDTH, _HEIGHT, 3), np.uint8), np.zeros((_HEIGHT, _WIDTH, 3))):
        with pytest.raises(ValueError, match=r"expected \(48, 64, 3\) and uint8"):
            writer.write(wrong)
    writer.discard()


@pytest.mark.parametrize("name", ["film.avi", "film", ".mp4"])
def test_other_kinds_of_video_are_refused(tmp_path: Path, name: str) -> None:
    for begin in (lambda path: Film(path, 0.02), lambda path: Writer(path, 48, 64, 20.0)):
        with pytest.raises(ValueError, match=r"expected a name that ends in \.mp4 or \.gif"):
            begin(tmp_path / name)


def test_a_mosaic_has_pictures_row_by_row() -> None:
    pictures = np.arange(1, 6, dtype=np.uint8)[:, None, None, None] * np.ones((2, 3, 3), np.uint8)
    shown = mosaic(pictures)
    assert shown.shape == (4, 9, 3)
    assert shown.dtype == np.uint8
    assert shown[::2, ::3, 0].tolist() == [[1, 2, 3], [4, 5, 0]]
    assert mosaic(list(pictures), columns=1)[::2, 0, 0].tolist() == [1, 2, 3, 4, 5]
    assert mosaic(pictures, columns=7).shape == (2, 21, 3)
    np.testing.assert_array_equal(mosaic(pictures[:1]), pictures[0])


def test_a_mosaic_of_one_size_only() -> None:
    picture = np.zeros((2, 3, 3), np.uint8)
    with pytest.raises(ValueError, match=r"pictures of shapes \[\]; expected one shape"):
        mosaic([])
    with pytest.raises(ValueError, match=r"shapes \[\(2, 3, 3\), \(4, 3, 3\)\]"):
        mosaic([picture, np.zeros((4, 3, 3), np.uint8)])
    with pytest.raises(ValueError, match="columns is 0; expected at least 1"):
        mosaic([picture], columns=0)
