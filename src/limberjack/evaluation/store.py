"""Finished episodes in a file that only grows, so that a run goes on where it was killed.

    store = Store(Path("out"), identity)
    store.add("random", score)
    store.scores["random"][score.seed]

The file is episodes.jsonl: a line says whose results these are, and each other line is one episode
of one policy. A line that a kill left unfinished is dropped; its episode is played again.
"""

import collections
import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from limberjack.evaluation.statistics import Score

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
          ValueError: the directory holds the results of something else; it is left as it is.
          OSError: it cannot be read or written.
        """
        self.scores: dict[str, dict[int, Score]] = collections.defaultdict(dict)
        self._file: BinaryIO | None = None
        if directory is None:
            return
        path = directory / EPISODES
        if path.exists():
            self._read(path, identity)
        elif (directory / RESULT).exists():
            raise ValueError(
                f"{directory} holds a {RESULT} but no {EPISODES}, so the results of something "
                "else: choose another folder"
            )
        directory.mkdir(parents=True, exist_ok=True)
        has_episodes = any(self.scores.values())
        # Unbuffered: each line reaches the system in one piece, whatever then kills the process.
        self._file = path.open("ab" if has_episodes else "wb", buffering=0)
        if not has_episodes:
            self._write(identity)

    def add(self, policy: str, score: Score) -> None:
        """Keeps an episode."""
        self.scores[policy][score.seed] = score
        self._write({"policy": policy, **dataclasses.asdict(score)})

    def close(self) -> None:
        """Closes the file; closing twice is fine."""
        if self._file is not None:
            self._file.close()

    def _write(self, entry: Mapping[str, Any]) -> None:
        if self._file is not None:
            self._file.write(json.dumps(entry).encode() + b"\n")

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
