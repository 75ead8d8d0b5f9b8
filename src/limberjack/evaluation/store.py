"""Finished episodes in a file that only grows, so that a killed run can continue.

    store = Store(Path("out"), identity)
    store.add("random", [score])
    store.scores["random"][score.seed]

The file is episodes.jsonl: the first line identifies the evaluation, and each other line is one
episode of one policy. An unfinished last line, as a kill leaves it, is dropped, and its episode is
played again. Added episodes are flushed to the disk and survive a power loss. Where the system has
file locks, one process at a time may write; others are refused.

An evaluation continues with other patch versions, which give the same numbers if the model's
fingerprint is equal; a line then records the versions that played the episodes after it. Another
major or minor version, or another fingerprint, is refused.
"""

import collections
import dataclasses
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import BinaryIO

from limberjack.evaluation.statistics import Score
from limberjack.report import Facts
from limberjack.utils.files import Hold, flush_folder

__all__ = ["EPISODES", "RESULT", "Store"]

EPISODES = "episodes.jsonl"
RESULT = "result.json"

_VERSIONS = "versions"


class Store:
    """The episodes of one evaluation, by policy and seed.

    Attributes:
      scores: by policy and seed.
      versions: those that played the episodes, in the order of their first use.
    """

    def __init__(self, directory: Path | None, identity: Mapping[str, object]) -> None:
        """Opens the file in a directory, and creates both if needed.

        Args:
          directory: None keeps the episodes in memory only.
          identity: everything that an episode depends on except its seed, as JSON values, including
            'versions'.

        Raises:
          ValueError: the directory holds other results, or another process writes to it; nothing in
            it was changed.
          OSError: the file cannot be read or written.
        """
        self.scores: dict[str, dict[int, Score]] = collections.defaultdict(dict)
        self.versions: list[object] = []
        self._file: BinaryIO | None = None
        self._hold: Hold | None = None
        self._present: object = identity[_VERSIONS]
        if directory is None:
            return
        path = directory / EPISODES
        if (directory / RESULT).exists() and not path.exists():
            raise ValueError(
                f"{directory} holds a {RESULT} but no {EPISODES}, so its results are not those of "
                "an evaluation: choose another folder"
            )
        directory.mkdir(parents=True, exist_ok=True)
        self._path = path
        try:
            self._hold = Hold(directory)
            # Unbuffered: a line reaches the system in one piece, even if a kill follows.
            self._file = path.open("ab", buffering=0)
            self._read(path, identity)
            if not any(self.scores.values()):
                self._file.truncate(0)
                self._write(identity)
                self.versions = [self._present]
            flush_folder(directory)
        except BaseException:
            self.close()
            raise

    def add(self, policy: str, scores: Iterable[Score]) -> None:
        """Saves episodes that have just ended: they are on the disk when this returns."""
        if self.versions[-1:] != [self._present]:
            if self.versions:
                self._write({_VERSIONS: self._present})
            self.versions.append(self._present)
        for score in scores:
            self._write({"policy": policy, **dataclasses.asdict(score)})
            self.scores[policy][score.seed] = score
        if self._file is not None:
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Closes the file; may be called twice."""
        if self._file is not None:
            self._file.close()
        if self._hold is not None:
            self._hold.release()

    def _write(self, entry: Mapping[str, object]) -> None:
        if self._file is None:
            return
        left = json.dumps(entry).encode() + b"\n"
        try:
            while left:  # a nearly full disk takes a part and raises at the next write
                left = left[self._file.write(left) :]
        except OSError as error:
            error.filename = str(self._path)
            raise

    def _read(self, path: Path, identity: Mapping[str, object]) -> None:
        """Reads the episodes in the file, and drops an unfinished last line."""
        content = path.read_bytes()
        complete = content[: content.rfind(b"\n") + 1]
        head, *lines = complete.splitlines() or [b""]
        if lines:  # a file without episodes may be taken over by any evaluation
            first = _parsed(path, 1, head)
            _check_identity(path, first, identity)
            self.versions.append(first[_VERSIONS])
        for number, line in enumerate(lines, start=2):
            entry = _parsed(path, number, line)
            if entry.keys() == {_VERSIONS}:
                self.versions.append(entry[_VERSIONS])
                continue
            try:
                policy = entry.pop("policy")
                score = Score(**entry)
            except (KeyError, TypeError):
                raise _damaged(path, number) from None
            self.scores[policy].setdefault(score.seed, score)
        if len(complete) < len(content):
            os.truncate(path, len(complete))


def _parsed(path: Path, number: int, line: bytes) -> Facts:
    try:
        entry = json.loads(line)
    except ValueError:
        entry = None
    if not isinstance(entry, dict):
        raise _damaged(path, number)
    return entry


def _damaged(path: Path, number: int) -> ValueError:
    return ValueError(
        f"{path}: line {number} is no episode: remove that line to play the episode again, or "
        "choose another folder"
    )


def _check_identity(path: Path, there: Facts, here: Mapping[str, object]) -> None:
    """Raises ValueError if the file belongs to another evaluation."""
    for name, expected in here.items():
        found = there.get(name)
        if name == _VERSIONS:
            found, expected = _differing(found, expected)
        if found != expected:
            raise ValueError(
                f"{path.parent} holds an evaluation with {name} {found!r}, and this one "
                f"has {expected!r}: choose another folder, or remove that one"
            )


def _differing(found: object, expected: object) -> tuple[object, object]:
    """The entries of two tables of versions that differ in more than their patch numbers."""
    if not (isinstance(found, dict) and isinstance(expected, dict)):
        return found, expected
    names = [n for n in {**found, **expected} if _series(found.get(n)) != _series(expected.get(n))]
    return {n: found.get(n) for n in names}, {n: expected.get(n) for n in names}


def _series(version: object) -> list[str]:
    """The major and the minor number of a version."""
    return str(version).split(".")[:2]
