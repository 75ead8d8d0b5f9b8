"""The picture and the film of the median episode, which no file of episodes depends on."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from limberjack.data import collect, load
from limberjack.episodes import illustrating
from limberjack.episodes.card import median_seed, names_of
from limberjack.episodes.manifest import Manifest
from limberjack.episodes.places import place_of, read
from limberjack.mujoco.rendering import RenderingError
from tests import plain_domain

from .collected import PENDULUM, hashes, whole_hashes


def _collect(out: "Path | str", seeds: range = range(5), **how: Any) -> None:
    domain, task, seconds = PENDULUM
    how = {"film": True, **how}
    collect(domain, task, "random", seeds, out=out, time_limit=seconds, num_threads=1, **how)


def _names(out: Path) -> tuple[str, str]:
    """The names of the picture and the film of a dataset's median episode."""
    manifest = Manifest.read(out / "dataset.json")
    assert manifest is not None
    return names_of(median_seed(manifest, [shard.figures() for shard in load(out).shards]))


def _drawn(out: Path) -> dict[str, int]:
    """Times of writing of what is drawn, by name."""
    return {path.name: path.stat().st_mtime_ns for path in sorted(out.glob("median-*"))}


@pytest.mark.usefixtures("pictures")
def test_the_median_episode_is_drawn_once_and_changes_no_file_of_episodes(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra 'video'")
    for shard in ((1, 2), (2, 2)):
        _collect(tmp_path / "drawn", shard=shard)
        assert _drawn(tmp_path / "drawn") == {}
    _collect(tmp_path / "drawn")
    _collect(tmp_path / "plain", film=False)
    assert hashes(tmp_path / "drawn") == hashes(tmp_path / "plain")
    whole_hashes(tmp_path / "plain")  # it has nothing else
    picture, film = _names(tmp_path / "drawn")
    before = _drawn(tmp_path / "drawn")
    assert [*before] == [film, picture]
    card = (tmp_path / "drawn" / "README.md").read_text()
    assert f"({picture})]({film})" in card
    shown = np.asarray(Image.open(tmp_path / "drawn" / picture))
    assert shown.shape == (240, 320, 3)
    assert shown.std() > 10
    assert (tmp_path / "drawn" / film).read_bytes()[4:8] == b"ftyp"
    unchanged: list[dict[str, Any]] = [{}, {"film": False}]
    for how in unchanged:
        _collect(tmp_path / "drawn", **how)
        assert _drawn(tmp_path / "drawn") == before
    assert (tmp_path / "drawn" / "README.md").read_text() == card


@pytest.fixture
def drawings(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The seeds whose episodes are drawn, in files of one byte, without OpenGL."""
    seeds: list[int] = []

    def draw(dataset: object, seed: int, make: object) -> bytes:
        seeds.append(seed)
        return b"1"

    monkeypatch.setattr(illustrating, "_first_picture", draw)
    monkeypatch.setattr(illustrating, "_film", draw)
    return seeds


def test_with_more_episodes_the_new_median_is_drawn_in_place_of_the_old_one(
    drawings: list[int], tmp_path: Path
) -> None:
    _collect(tmp_path)
    first = _names(tmp_path)
    _collect(tmp_path, range(5, 40), film=False)
    second = _names(tmp_path)
    assert first != second
    assert "There is no picture" in (tmp_path / "README.md").read_text()
    (tmp_path / "median-of-mine.mp4").write_text("a user's own")
    _collect(tmp_path, range(40))
    assert [*_drawn(tmp_path)] == sorted([*second, "median-of-mine.mp4"])
    assert second[1] in (tmp_path / "README.md").read_text()
    assert len(drawings) == 4


def test_a_dataset_at_a_url_has_them_too(drawings: list[int]) -> None:
    fsspec = pytest.importorskip("fsspec", reason="needs the extra 'data'")
    try:
        _collect("memory://drawn")
        picture, film = names_of(drawings[0])
        folder = place_of("memory://drawn")
        assert read(folder / picture) == read(folder / film) == b"1"
        assert f"({picture})]({film})".encode() in read(folder / "README.md")
    finally:
        fsspec.filesystem("memory").rm("/drawn", recursive=True)


@pytest.mark.parametrize(
    ("fails", "is_there"),
    [("_first_picture", "There is no picture"), ("_film", "The picture is of")],
)
def test_what_cannot_be_drawn_is_logged_and_left_out(
    fails: str,
    is_there: str,
    drawings: list[int],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def failing(*arguments: object) -> None:
        raise RenderingError("no OpenGL here")

    monkeypatch.setattr(illustrating, fails, failing)
    with caplog.at_level(logging.WARNING, "limberjack"):
        _collect(tmp_path)
    name = _names(tmp_path)[fails == "_film"]
    assert caplog.messages == [f"{tmp_path} is complete, without {name}: no OpenGL here"]
    assert is_there in (tmp_path / "README.md").read_text()
    assert len(load(tmp_path)) == 5


@pytest.mark.usefixtures("pictures")
def test_episodes_of_a_function_are_drawn_with_it(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra 'video'")
    collect(plain_domain.make, None, "random", range(3), out=tmp_path, film=True)
    assert [*_drawn(tmp_path)] == sorted(_names(tmp_path))
