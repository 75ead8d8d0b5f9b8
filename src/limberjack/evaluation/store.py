"""Finished episodes in a file that only grows, so that a run goes on where it was killed.

    store = Store(Path("out"), identity)
    store.add("random", score)
    store.scores["random"][score.seed]

The file is episodes.jsonl: a line says whose results these are, and each other line is one episode
of one policy. A line that a kill left unfinished is dropped; its episode is played again. One
process at a time may write: others are refused, where the system knows locks.
"""

import collections
import contextlib
import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from limberjack.evaluation.statistics import Score

try:
    import fcntl
except ImportError:  # Windows has none
    fcntl = None

__all__ = ["EPISODES", "RESULT", "Store"]

EPISODES = "episodes.jsonl"
RESULT = "result.json"


class Store:
    """The episodes of one evaluation, by policy and seed."""

    def __init__(self, directory: Path | None, identity: Mapping[str, Any]) -> None:
        """Opens the directory's file, or makes both.

        Args:
          directory: None keeps the episodes in memory only.
          identity: all that an episode depends on but its seed, as JSON has it.

        Raises:
          ValueError: the directory holds the results of something else, or another process writes
            there; it is left as it is.
          OSError: it cannot be read or written.
        """
        self.scores: dict[str, dict[int, Score]] = collections.defaultdict(dict)
        self._file: BinaryIO | None = None
        if directory is None:
            return
        path = directory / EPISODES
        if (directory / RESULT).exists() and not path.exists():
            raise ValueError(
                f"{directory} holds a {RESULT} but no {EPISODES}, so the results of something "
                "else: choose another folder"
            )
        directory.mkdir(parents=True, exist_ok=True)
        self._path = path
        # Unbuffered: each line reaches the system in one piece, whatever then kills the process.
        self._file = path.open("ab", buffering=0)
        try:
            _lock(self._file, directory)
            self._read(path, identity)
            if not any(self.scores.values()):
                self._file.truncate(0)
                self._write(identity)
        except BaseException:
            self.close()
            raise

    def add(self, policy: str, score: Score) -> None:
        """Keeps an episode."""
        self._write({"policy": policy, **dataclasses.asdict(score)})
        self.scores[policy][score.seed] = score

    def close(self) -> None:
        """Closes the file; closing twice is fine."""
        if self._file is not None:
            self._file.close()

    def _write(self, entry: Mapping[str, Any]) -> None:
        if self._file is None:
            return
        left = json.dumps(entry).encode() + b"\n"
        try:
            while left:  # a disk that is nearly full takes a part, and says so the next time
                left = left[self._file.write(left) :]
        except OSError as error:
            error.filename = str(self._path)
            raise

    def _read(self, path: Path, identity: Mapping[str, Any]) -> None:
        """Reads what is there, and drops a line that has no end."""
        content = path.read_bytes()
        complete = content[: content.rfind(b"\n") + 1]
        head, *lines = complete.splitlines() or [b""]
        if lines:  # without episodes there is nothing that could be mixed up
            _check_identity(path, _parsed(path, 1, head), identity)
        for number, line in enumerate(lines, start=2):
            entry = _parsed(path, number, line)
            try:
                policy = entry.pop("policy")
                score = Score(**entry)
            except (KeyError, TypeError):
                raise _damaged(path, number) from None
            self.scores[policy].setdefault(score.seed, score)
        if len(complete) < len(content):
            os.truncate(path, len(complete))


def _lock(file: BinaryIO, directory: Path) -> None:
    """Keeps other processes from writing until the file is closed; raises if one does."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError):  # some network file systems have no locks
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"another process evaluates in {directory}: wait for it, or choose another folder"
            ) from None


def _parsed(path: Path, number: int, line: bytes) -> dict[str, Any]:
    try:
        entry = json.loads(line)
    except ValueError:
        entry = None
    if not isinstance(entry, dict):
        raise _damaged(path, number)
    return entry


def _damaged(path: Path, number: int) -> ValueError:
    return ValueError(
        f"{path}: line {number} is no episode: remove that line to have it played again, or choose "
        "another folder"
    )


def _check_identity(path: Path, there: dict[str, Any], here: Mapping[str, Any]) -> None:
    """Raises if the file is that of another evaluation."""
    for name, expected in here.items():
        if there.get(name) != expected:
            raise ValueError(
                f"{path.parent} holds an evaluation with {name} {there.get(name)!r}, and this one "
                f"has {expected!r}: choose another folder, or remove that one"
            )
