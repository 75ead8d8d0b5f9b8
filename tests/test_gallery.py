"""Pictures of all tasks."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer.testing
from PIL import Image

from limberjack import gallery, suite
from limberjack.cli import app
from limberjack.mujoco.camera import RenderingError
from tests import plain_domain

_COMMITTED = Path(__file__).parents[1] / "docs" / "images" / "suite.png"
_MOST_BYTES = 1_000_000  # so that a page with the sheet loads quickly


def _drawn(directory: Path) -> Path:
    """The pictures drawn by the command, in a process of its own: OpenGL keeps about 1 GB."""
    out = directory / "new"
    command = [sys.executable, "-m", "limberjack", "gallery", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    names = [f"{domain}-{task}.png" for domain, task in suite.ALL_TASKS]
    assert done.stdout.splitlines() == [str(out / name) for name in [*names, "suite.png"]]
    return out


def _read(path: Path) -> np.ndarray:
    """A picture, with colours between 0 and 1."""
    return np.asarray(Image.open(path)) / 255


def _assert_committed(drawn: np.ndarray, committed: np.ndarray) -> None:
    # Other drivers draw edges and text otherwise.
    assert np.abs(drawn - committed).mean() < 0.02


# Each task has a model of its own to draw: together they take a quarter of a minute. What is drawn
# of the others changes with their models, which tests/oracle compares number by number.
@pytest.mark.slow
@pytest.mark.usefixtures("pictures")
def test_each_task_has_a_picture_that_is_not_blank_and_the_sheet_is_committed(
    tmp_path: Path,
) -> None:
    directory = _drawn(tmp_path)
    for domain, task in suite.ALL_TASKS:
        picture = _read(directory / f"{domain}-{task}.png")
        assert picture.shape == (480, 480, 3)
        assert picture.std() > 0.02
    drawn = _read(directory / "suite.png")
    committed = _read(_COMMITTED)
    assert drawn.shape == committed.shape
    _assert_committed(drawn, committed)


@pytest.mark.usefixtures("pictures")
def test_the_committed_sheet_has_the_pictures_that_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sheet = _read(_COMMITTED)
    assert sheet.shape == (960, 1440, 3)
    assert _COMMITTED.stat().st_size < _MOST_BYTES
    chosen = (("acrobot", "swingup"), ("humanoid", "walk"), ("stacker", "stack_4"))
    monkeypatch.setattr(suite, "tasks", lambda: chosen)
    *paths, small = gallery.write(tmp_path)
    drawn = _read(small)
    for number, ((domain, task), path) in enumerate(zip(chosen, paths, strict=True)):
        assert path.name == f"{domain}-{task}.png"
        picture = _read(path)
        assert picture.shape == (480, 480, 3)
        assert picture.std() > 0.02
        row, column = divmod(suite.ALL_TASKS.index((domain, task)), 9)
        tile = sheet[160 * row : 160 * (row + 1), 160 * column : 160 * (column + 1)]
        _assert_committed(drawn[:160, 160 * number : 160 * (number + 1)], tile)


@pytest.mark.usefixtures("pictures")
def test_the_same_picture_comes_each_time() -> None:
    first, again = (gallery.draw("stacker", "stack_2", 60, 80) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert first.shape == (60, 80, 3)


@pytest.mark.usefixtures("pictures")
def test_a_domain_without_a_camera_is_drawn_by_the_free_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    without = re.sub("<camera.*>", "", plain_domain._MODEL)
    monkeypatch.setattr(plain_domain, "_MODEL", without)
    suite.register("plain", plain_domain)
    try:
        assert gallery.draw("plain", "push", 60, 80).shape == (60, 80, 3)
    finally:
        suite.unregister("plain")


def test_progress_is_reported_before_each_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dots = [np.zeros((2, 2, 3), np.uint8)] * 2
    monkeypatch.setattr(gallery, "_draw_sizes", lambda *arguments: dots)
    reported: list[tuple[str, str, int, int]] = []
    gallery.write(tmp_path, on_progress=lambda *now: reported.append(now))
    count = len(suite.ALL_TASKS)
    expected = [(*task, drawn, count) for drawn, task in enumerate(suite.ALL_TASKS)]
    assert reported == expected


def test_a_sheet_without_columns_is_refused_before_anything_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gallery, "_draw_sizes", lambda *task: pytest.fail("drawn"))
    with pytest.raises(ValueError, match="columns is 0; expected at least 1"):
        gallery.write(tmp_path / "out", columns=0)
    assert not (tmp_path / "out").exists()


def test_a_gallery_that_cannot_be_written_is_status_2_after_one_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []

    def draw(*task: object) -> list[np.ndarray]:
        drawn.append(task)
        return [np.zeros((2, 2, 3), np.uint8)] * 2

    monkeypatch.setattr(gallery, "_draw_sizes", draw)
    (tmp_path / "file").write_bytes(b"")
    out = tmp_path / "file" / "below"
    done = typer.testing.CliRunner().invoke(app, ["gallery", "--out", str(out)])
    assert done.exit_code == 2
    assert done.stderr.startswith("limberjack: ")
    assert "Not a directory" in done.stderr
    assert len(drawn) == 1


def test_without_opengl_it_is_one_line_and_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise RenderingError("no OpenGL can be had")

    monkeypatch.setattr("limberjack.mujoco.Physics.render", refuse)
    done = typer.testing.CliRunner().invoke(app, ["gallery", "--out", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert done.stderr == "limberjack: no pictures: no OpenGL can be had\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["suite.png", "humanoid-walk.png"])
def test_a_picture_of_ones_own_is_not_replaced(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"hours of work")
    done = typer.testing.CliRunner().invoke(app, ["gallery", "--out", str(tmp_path)])
    assert done.exit_code == 2
    assert f"{name} is not a picture that an earlier call wrote: choose" in done.stderr
    assert (tmp_path / name).read_bytes() == b"hours of work"
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_pictures_of_an_earlier_call_are_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(suite, "tasks", lambda: (("cartpole", "balance"),))
    size = np.zeros((8, 8, 3), np.uint8)
    monkeypatch.setattr(gallery, "_draw_sizes", lambda *task: [size, size])
    for _ in range(2):
        gallery.write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"cartpole-balance.png", "suite.png"}
