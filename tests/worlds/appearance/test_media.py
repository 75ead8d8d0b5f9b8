"""Tests of limberjack.worlds.appearance.media."""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from limberjack.see.video import Writer
from limberjack.utils import png
from limberjack.worlds.appearance import media
from limberjack.worlds.appearance.media import SIDE, find, fingerprint, resized


def _picture(path: Path, value: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png.encode(np.full((6, 8, 3), value, np.uint8)))


def _video(path: Path, values: list[int]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = Writer(path, 32, 48, 10.0)
    for value in values:
        writer.write(np.full((32, 48, 3), value, np.uint8))
    writer.finish()


def test_a_folder_of_pictures_is_one_clip_in_the_order_of_numbers(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        _picture(tmp_path / f"p{number}.png", number)
    (tmp_path / "notes.txt").write_text("none", encoding="utf-8")
    (tmp_path / "._p2.png").write_bytes(b"of macOS")
    (clip,) = find("images", str(tmp_path), None)
    assert clip.length == 3
    frames = [clip.frame(number) for number in range(3)]
    assert [frame[0, 0, 0] for frame in frames] == [1, 2, 10]
    assert frames[0].shape == (SIDE, SIDE, 3)
    assert frames[0].dtype == np.uint8


def test_a_folder_of_folders_is_a_clip_of_each_as_davis_has_them(tmp_path: Path) -> None:
    for name, value in (("bear", 1), ("boat", 2), ("bus", 3)):
        for number in range(value):
            _picture(tmp_path / name / f"{number:05d}.png", value)
    (tmp_path / "empty").mkdir()
    assert [clip.length for clip in find("images", str(tmp_path), None)] == [1, 2, 3]
    assert [clip.length for clip in find("images", str(tmp_path), 2)] == [1, 2]


def test_a_video_is_read_frame_by_frame(tmp_path: Path) -> None:
    file = tmp_path / "12:30.mp4"
    _video(file, [20, 120, 220])
    (clip,) = find("video", str(file), None)
    assert clip.length == 3
    # H.264 is lossy, and a grey of 20 may come back as 19.
    values = [int(clip.frame(number)[9, 9, 1]) for number in range(3)]
    np.testing.assert_allclose(values, [20, 120, 220], atol=3)
    assert clip.frame(0).shape == (SIDE, SIDE, 3)


def test_a_folder_of_videos_is_a_clip_of_each_of_the_first_ones(tmp_path: Path) -> None:
    for number in (10, 2):
        _video(tmp_path / f"video{number}.mp4", [number * 10] * 2)
    clips = find("video", str(tmp_path), None)
    assert [clip.files[0].name for clip in clips] == ["video2.mp4", "video10.mp4"]
    assert len(find("video", str(tmp_path), 1)) == 1


def test_videos_are_decoded_once_and_dropped_beyond_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[Path] = []

    def decode(file: Path) -> np.ndarray:
        decoded.append(file)
        return np.zeros((2, SIDE, SIDE, 3), np.uint8)

    monkeypatch.setattr(media, "_decoded", decode)
    monkeypatch.setattr(media, "_MOST_BYTES", 5 * SIDE * SIDE * 3)
    files = [tmp_path / f"{name}.mp4" for name in "abc"]
    for file in files:
        file.touch()
    clips = [media.Clip([file], is_video=True) for file in files]
    for number in (0, 1, 0, 2, 0, 1):
        clips[number].frame(0)
    assert decoded == [files[0], files[1], files[2], files[1]]


@pytest.mark.parametrize(
    ("kind", "made", "message"),
    [
        ("images", None, "does not exist; expected a folder of files that end in .bmp"),
        ("images", "file", "is no folder; expected a folder of files"),
        ("images", "folder", "has no picture; expected a folder of files"),
        ("video", None, "does not exist; expected a file or a folder of files that end in .avi"),
        ("video", "folder", "has no video"),
        ("video", "file", r"the video .* cannot be read: \S+"),
        ("images", "damaged", "the picture .*damaged.png cannot be read: "),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_line(
    tmp_path: Path, kind: str, made: str | None, message: str
) -> None:
    path = tmp_path / "background"
    if made == "file":
        path.write_text("no video", encoding="utf-8")
    elif made is not None:
        path.mkdir()
        if made == "damaged":
            (path / "damaged.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(ValueError, match=message) as raised:
        find(kind, str(path), None)
    assert "\n" not in str(raised.value)


def test_a_picture_of_too_many_pixels_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _picture(tmp_path / "huge.png", 7)
    monkeypatch.setattr("PIL.Image.MAX_IMAGE_PIXELS", 1)
    with pytest.raises(ValueError, match=r"the picture .*huge\.png cannot be read: .* exceeds"):
        find("images", str(tmp_path), None)


def test_a_file_that_has_changed_is_read_again_and_one_that_is_gone_is_named(
    tmp_path: Path,
) -> None:
    picture, video = tmp_path / "1.png", tmp_path / "1.mp4"
    _picture(picture, 7)
    _video(video, [20])
    (pictures,), (frames,) = find("images", str(tmp_path), 1), find("video", str(video), 1)
    _picture(picture, 9)
    _video(video, [20, 20])
    assert pictures.frame(0)[0, 0, 0] == 9
    assert frames.length == 2
    picture.unlink()
    with pytest.raises(ValueError, match=r"1\.png cannot be read: No such file"):
        pictures.frame(0)


def test_without_its_packages_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _picture(tmp_path / "new.png", 7)
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(ImportError, match=r"needs the extra 'video': pip install .*pillow"):
        find("images", str(tmp_path), None)


def test_a_fingerprint_changes_with_the_files_and_not_with_their_place(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        _picture(tmp_path / folder / "x" / "1.png", 1)
        _picture(tmp_path / folder / "x" / "2.png", 2)
        _picture(tmp_path / folder / "y" / "1.png", 3)

    def of(folder: str, count: int | None = None) -> str:
        return fingerprint(find("images", str(tmp_path / folder), count))

    assert of("a") == of("b")
    assert of("a", 1) != of("a")
    _picture(tmp_path / "b" / "y" / "1.png", 4)
    assert of("a") != of("b")
    assert of("a", 1) == of("b", 1)


def test_a_frame_is_resized_by_interpolation() -> None:
    frame = np.zeros((4, 4, 3), np.uint8)
    frame[:, 2:] = 100
    assert_array_equal(resized(frame, 4, 4), frame)
    wide = resized(frame, 2, 8)[..., 0]
    assert_array_equal(wide, [[0, 0, 0, 25, 75, 100, 100, 100]] * 2)
    assert_array_equal(resized(frame, 2, 2)[0, :, 0], [0, 100])
