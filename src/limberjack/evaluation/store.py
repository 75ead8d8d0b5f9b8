"""Finished episodes in a file that only grows, so that a killed run can continue.

    store = Store(Path("out"), identity)
    store.add("random", [score])
    store.scores["random"][score.seed]

The file is episodes.jsonl: the first line identifies the evaluation, and each other line is one
episode of one policy. An unfinished last line, as a kill leaves it, is dropped, and its episode is
played again. Added episodes are flushed to the disk and survive a power loss.

A shard writes a file of its own, episodes-2-of-8.jsonl. Without a shard, the store reads the files
of all shards and copies episodes that it lacks. Each file has one writer at a time: others are
refused by a lock, or where the file system has none, as soon as a second one has written.

An evaluation continues with other patch versions, which give the same numbers if the model's
fingerprint is equal; a line then records the versions that played the episodes after it. Another
major or minor version, another fingerprint, or a processor that rounds differently, is refused.
"""

import collections
import dataclasses
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from limberjack.evaluation.statistics import Score
from limberjack.policies.actors import Found
from limberjack.report import Facts
from limberjack.report.folder import RECORDINGS
from limberjack.utils.files import Hold, flush_folder
from limberjack.workers.identity import advice_on, first_mismatch, processor

__all__ = ["EPISODES", "PAGE", "PICTURE", "RESULT", "Store"]

EPISODES = "episodes.jsonl"
RESULT = "result.json"
PAGE = "report.html"
PICTURE = "returns.png"

_SHARD = "episodes-{}-of-{}.jsonl"
_VERSIONS = "versions"
# What entries of a line must be.
_KINDS: dict[str, type | tuple[type, ...]] = {
    "policy": str,
    "seed": int,
    "total": float,
    "length": int,
    "final_reward": float,
    "diverged": bool,
    "start": (str, type(None)),
    "processor": (str, type(None)),
}


class Store:
    """The episodes of one evaluation, by policy and seed.

    Attributes:
      scores: by policy and seed.
      versions: those that played the episodes, in the order of their first use.
      path: the file that is written; None if episodes are kept in memory only.
      processor: of this machine, for scores to name; None unless any processor may play.
    """

    def __init__(
        self,
        directory: Path | None,
        identity: Mapping[str, object],
        *,
        canary: str | None = None,
        shard: tuple[int, int] | None = None,
        any_processor: bool = False,
    ) -> None:
        """Opens the file in a directory, and creates both if needed.

        Args:
          directory: None keeps the episodes in memory only.
          identity: everything that an episode depends on except its seed, as JSON values, including
            'versions'.
          canary: see `workers.identity.canary_of`; None if it is not known.
          shard: its number and that of all shards.
          any_processor: accept episodes with another fingerprint or canary.

        Raises:
          ValueError: the directory holds other results, or another process writes to it; nothing in
            it was changed.
          OSError: the file cannot be read or written.
        """
        self.scores: dict[str, dict[int, Score]] = collections.defaultdict(dict)
        self.versions: list[object] = []
        self.path: Path | None = None
        self._file: BinaryIO | None = None
        self._hold: Hold | None = None
        self._present: object = identity[_VERSIONS]
        self._head: Facts = {**identity, **({} if canary is None else {"canary": canary})}
        self._any_processor = any_processor
        self.processor = processor() if any_processor else None
        if directory is None:
            return
        self.path = directory / (EPISODES if shard is None else _SHARD.format(*shard))
        patterns = (RESULT, PAGE, PICTURE, RECORDINGS)
        others = [path.name for pattern in patterns for path in directory.glob(pattern)]
        if others and not any(directory.glob("episodes*.jsonl")):
            raise ValueError(
                f"{directory} holds {others[0]} but no {EPISODES}, so it is not the folder of an "
                "evaluation: choose another folder"
            )
        directory.mkdir(parents=True, exist_ok=True)
        try:
            self._open(self.path, directory if shard is None else self.path)
            if shard is None:
                self._join(directory)
            flush_folder(directory)
        except BaseException:
            self.close()
            raise

    def check_source(self, found: Found) -> None:
        """Raises ValueError if there are episodes that may be those of another policy."""
        if found.sha256 is None and self.scores[found.name]:
            assert self.path is not None
            raise ValueError(
                f"{self.path.parent} holds episodes of {found.name!r}, whose source is unknown "
                "here, so another policy of that name may have played them: choose another "
                "folder, or define the policy in a file"
            )

    def add(self, policy: str, scores: Iterable[Score]) -> None:
        """Saves episodes that have just ended: they are on the disk when this returns.

        Raises:
          ValueError: a return is not a finite number.
          OSError: the file cannot be written, or another process has written to it.
        """
        self._check_alone()
        self._append(self._present, policy, scores)
        self._flush()

    def close(self) -> None:
        """Closes the file; may be called twice."""
        if self._file is not None:
            self._file.close()
        if self._hold is not None:
            self._hold.release()

    def _open(self, path: Path, held: Path) -> None:
        """Opens the file, reads it, and begins it if it has no episode."""
        self._hold = Hold(held)
        # Unbuffered: a line reaches the system in one piece, even if a kill follows.
        self._file = path.open("ab", buffering=0)
        content = path.read_bytes()
        for versions, policy, score in self._episodes(path, content):
            if self.versions[-1:] != [versions]:
                self.versions.append(versions)
            if policy is not None and score is not None:
                self.scores[policy].setdefault(score.seed, score)
        complete = content.rfind(b"\n") + 1
        if complete < len(content):
            os.truncate(path, complete)
        if not any(self.scores.values()):
            self._file.truncate(0)
            self._write(self._head)
            self.versions = [self._present]
        self._file.seek(0, os.SEEK_END)  # so that its position is the length of the file

    def _join(self, directory: Path) -> None:
        """Copies the episodes of shards that are not there yet."""
        before = sum(map(len, self.scores.values()))
        for path in sorted(directory.glob(_SHARD.format("*", "*"))):
            for versions, policy, score in self._episodes(path, path.read_bytes()):
                if policy is None or score is None or score.seed in self.scores[policy]:
                    continue
                self._append(versions, policy, [score])
        if sum(map(len, self.scores.values())) > before:
            self._flush()

    def _append(self, versions: object, policy: str, scores: Iterable[Score]) -> None:
        if self.versions[-1:] != [versions]:
            if self.versions:
                self._write({_VERSIONS: versions})
            self.versions.append(versions)
        for score in scores:
            if not math.isfinite(score.total):
                raise ValueError(
                    f"policy {policy!r}: the return of the episode with seed {score.seed} is "
                    f"{score.total}; expected a task whose rewards are finite numbers"
                )
            entry = {"policy": policy, **dataclasses.asdict(score)}
            if score.processor is None:
                del entry["processor"]
            self._write(entry)
            self.scores[policy][score.seed] = score

    def _write(self, entry: Mapping[str, object]) -> None:
        if self._file is None:
            return
        left = json.dumps(entry).encode() + b"\n"
        try:
            while left:  # a nearly full disk takes a part and raises at the next write
                left = left[self._file.write(left) :]
        except OSError as error:
            error.filename = str(self.path)
            raise

    def _check_alone(self) -> None:
        """Raises OSError if the file has grown by another's episodes."""
        if self._file is not None and os.fstat(self._file.fileno()).st_size != self._file.tell():
            raise OSError(
                f"another process writes to {self.path}: end one of the two, or choose another "
                "folder"
            )

    def _flush(self) -> None:
        if self._file is not None:
            os.fsync(self._file.fileno())

    def _episodes(
        self, path: Path, content: bytes
    ) -> Iterator[tuple[object, str | None, Score | None]]:
        """The versions, the policy and the score of each line; without the last two of the first.

        An unfinished last line is left out. A file without episodes may be that of any evaluation.
        """
        complete = content[: content.rfind(b"\n") + 1]
        head, *lines = complete.splitlines() or [b""]
        if not lines:
            return
        first = _parsed(path, 1, head)
        self._check_head(path, first)
        versions = first[_VERSIONS]
        yield versions, None, None
        for number, line in enumerate(lines, start=2):
            entry = _parsed(path, number, line)
            if entry.keys() == {_VERSIONS}:
                versions = entry[_VERSIONS]
                yield versions, None, None
                continue
            try:
                _check_kinds(entry)
                policy, score = entry.pop("policy"), Score(**entry)
            except (KeyError, TypeError):
                raise _damaged(path, number) from None
            yield versions, policy, score

    def _check_head(self, path: Path, there: Facts) -> None:
        """Raises ValueError if a file belongs to another evaluation."""
        mismatch = first_mismatch(self._head, there, self._any_processor)
        if mismatch is not None:
            name, expected, found = mismatch
            raise ValueError(
                f"{path.parent} holds an evaluation with {name} {found!r}, and this one "
                f"has {expected!r}: choose another folder, or remove that one"
                f"{advice_on(name)}"
            )


def _check_kinds(entry: Facts) -> None:
    """Raises TypeError if a value is of another kind than `add` writes."""
    for name, value in entry.items():
        kind = _KINDS.get(name, object)
        is_number = not isinstance(value, float) or math.isfinite(value)
        if (
            not isinstance(value, kind)
            or (kind is int and isinstance(value, bool))
            or not is_number
        ):
            raise TypeError(name)


def _parsed(path: Path, number: int, line: bytes) -> Facts:
    try:
        entry = json.loads(line)
    except (RecursionError, ValueError):
        entry = None
    if not isinstance(entry, dict):
        raise _damaged(path, number)
    return entry


def _damaged(path: Path, number: int) -> ValueError:
    return ValueError(
        f"{path}: line {number} is no episode: remove that line to play the episode again, or "
        "choose another folder"
    )
