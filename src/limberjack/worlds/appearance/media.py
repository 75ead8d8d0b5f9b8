"""Pictures and videos in files, as backgrounds.

    clips = find("images", "davis", count=4)      # the first four folders of pictures
    clips = find("video", "film.mp4", count=None)
    clips[0].length                               # frames
    clips[0].frame(7)                             # (256, 256, 3) uint8

Every frame is scaled to a square, as the side of a sky is. No other file imports Pillow, which
reads pictures; videos are read by ffmpeg. Decoded frames are shared by all environments of the
process, up to a limit of memory, and decoded again if a file's size or its time of change is
another.
"""

import collections
import functools
import hashlib
import re
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from limberjack.utils.ffmpeg import find_ffmpeg
from limberjack.utils.requirements import missing_extra

__all__ = ["SIDE", "Clip", "MediaError", "find", "fingerprint", "resized"]

SIDE = 256  # pixels of a frame: that of DMC-GB2's videos; a picture of 84 shows half of it

_IMAGES = (".bmp", ".jpeg", ".jpg", ".png", ".webp")
_VIDEOS = (".avi", ".gif", ".m4v", ".mkv", ".mov", ".mp4", ".webm")
_MOST_BYTES = 2**29  # of decoded videos
_MOST_IMAGES = 1024  # decoded pictures: 200 MB
_FRAME_BYTES = SIDE * SIDE * 3

# The path, size and time of change of a file.
_Version = tuple[Path, int, int]


class MediaError(OSError, ValueError):
    """A picture or video cannot be read."""


class Clip:
    """Frames in the order of time, of pictures in files or of a video."""

    def __init__(self, files: Sequence[Path], is_video: bool) -> None:
        """Takes the files; reads nothing yet."""
        self.files = tuple(files)
        self._is_video = is_video

    @property
    def length(self) -> int:
        """The number of frames; a video is read for it, as in `frame`."""
        return len(_videos.frames(_version(self.files[0]))) if self._is_video else len(self.files)

    def frame(self, number: int) -> np.ndarray:
        """A frame, (SIDE, SIDE, 3) uint8.

        Raises:
          MediaError: the file cannot be read.
          ImportError: a package to read it with is missing.
        """
        if self._is_video:
            return _videos.frames(_version(self.files[0]))[number]
        return _image(_version(self.files[number]))


def find(kind: str, path: str, count: int | None) -> list[Clip]:
    """The first clips of a folder, by name, or that of a file.

    Args:
      kind: 'images': a folder of pictures, or of folders of them. 'video': a file, or a folder.
      path: of the folder or file.
      count: the most clips; None for all.

    Raises:
      ValueError: there are none.
      MediaError: the first one cannot be read.
      ImportError: a package to read it with is missing.
    """
    where = Path(path)
    if kind == "video":
        files = [where] if where.is_file() else _files(where, _VIDEOS)
        clips = [Clip([file], is_video=True) for file in files]
    else:
        files = _files(where, _IMAGES)
        folders = [] if files or not where.is_dir() else sorted(where.iterdir(), key=_in_order)
        groups = [files] if files else [_files(folder, _IMAGES) for folder in folders]
        clips = [Clip(group, is_video=False) for group in groups if group]
    if not clips:
        endings = _VIDEOS if kind == "video" else _IMAGES
        what = "no video" if kind == "video" else "no picture"
        found = f"has {what}" if where.is_dir() else "is no folder"
        if not where.exists():
            found = "does not exist"
        raise ValueError(
            f"appearance's background is {kind}:{path}, which {found}; expected "
            f"{'a file or ' if kind == 'video' else ''}a folder of files that end in "
            f"{', '.join(endings)}"
        )
    clips = clips[:count]
    clips[0].frame(0)
    return clips


def fingerprint(clips: Sequence[Clip]) -> str:
    """SHA-256 of the bytes of all files, in order."""
    digest = hashlib.sha256()
    for clip in clips:
        for file in clip.files:
            digest.update(_hash(_version(file)))
        digest.update(b"clip")
    return digest.hexdigest()


def _version(file: Path) -> _Version:
    try:
        facts = file.stat()
    except OSError as error:
        raise MediaError(f"{file} cannot be read: {error.strerror}") from error
    return file, facts.st_size, facts.st_mtime_ns


@functools.lru_cache(None)
def _hash(version: _Version) -> bytes:
    """SHA-256 of a file."""
    return hashlib.sha256(version[0].read_bytes()).digest()


def resized(frame: np.ndarray, height: int, width: int) -> np.ndarray:
    """A frame, (h, w, 3) uint8, in another size, by interpolation between four pixels."""
    rows, below, of_rows = _between(frame.shape[0], height)
    columns, right, of_columns = _between(frame.shape[1], width)
    values = frame.astype(np.float32)
    lines = values[rows] + of_rows[:, None, None] * (values[below] - values[rows])
    share = of_columns[None, :, None]
    return (lines[:, columns] + share * (lines[:, right] - lines[:, columns])).astype(np.uint8)


def _between(size: int, wanted: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each wanted pixel the two between which its centre lies, and the share of the second."""
    centres = np.clip((np.arange(wanted) + 0.5) * (size / wanted) - 0.5, 0, size - 1)
    first = centres.astype(int)
    return first, np.minimum(first + 1, size - 1), (centres - first).astype(np.float32)


def _files(folder: Path, endings: Sequence[str]) -> list[Path]:
    """The files of a folder with these endings, by name; none if it is no folder.

    Hidden ones are no pictures: macOS writes `._1.png` beside `1.png` on other systems' disks.
    """
    if not folder.is_dir():
        return []
    names = (one for one in folder.iterdir() if not one.name.startswith("."))
    found = [one for one in names if one.suffix.lower() in endings and one.is_file()]
    return sorted(found, key=_in_order)


def _in_order(path: Path) -> list[object]:
    """A key that sorts names with numbers by these, as video2 before video10."""
    parts = re.split(r"(\d+)", path.name)
    return [int(part) if number % 2 else part for number, part in enumerate(parts)]


@functools.lru_cache(_MOST_IMAGES)
def _image(version: _Version) -> np.ndarray:
    file = version[0]
    try:
        from PIL import Image
    except ImportError as error:
        raise missing_extra("video") from error
    try:
        with Image.open(file) as image:
            frame = np.asarray(image.convert("RGB").resize((SIDE, SIDE)))
    except (Image.DecompressionBombError, OSError, SyntaxError, ValueError) as error:
        raise MediaError(f"the picture {file} cannot be read: {error}") from error
    return frame


class _Videos:
    """Decoded videos, of which those used least recently are dropped."""

    def __init__(self) -> None:
        self._frames: collections.OrderedDict[_Version, np.ndarray] = collections.OrderedDict()
        self._lock = threading.Lock()

    def frames(self, version: _Version) -> np.ndarray:
        """All frames of a file, (n, SIDE, SIDE, 3) uint8."""
        with self._lock:
            if version not in self._frames:
                self._frames[version] = _decoded(version[0])
            self._frames.move_to_end(version)
            while len(self._frames) > 1 and self._nbytes > _MOST_BYTES:
                self._frames.popitem(last=False)
            return self._frames[version]

    @property
    def _nbytes(self) -> int:
        return sum(frames.nbytes for frames in self._frames.values())


_videos = _Videos()


def _decoded(file: Path) -> np.ndarray:
    # `file:`, because ffmpeg would read `12:30.mp4` as a protocol.
    source = [find_ffmpeg(), "-v", "error", "-nostdin", "-i", f"file:{file}"]
    scaled = ["-vf", f"scale={SIDE}:{SIDE}", "-fs", str(_MOST_BYTES)]
    form = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    made = subprocess.run([*source, *scaled, *form], capture_output=True, check=False)
    count = len(made.stdout) // _FRAME_BYTES
    if not count:
        said = made.stderr.decode(errors="replace").strip().splitlines()
        raise MediaError(f"the video {file} cannot be read: {said[-1] if said else 'no frames'}")
    frames = np.frombuffer(made.stdout, np.uint8, count * _FRAME_BYTES)
    return frames.reshape(count, SIDE, SIDE, 3)
