"""Finished episodes in a file that only grows, so that a killed run can continue.

    store = Store(Path("out"), identity)
    store.add("random", [score])
    store.scores["random"][score.seed]

The file is episodes.jsonl: the first line identifies the evaluation, and each other line is one
episode of one policy. An unfinished last line, as a kill leaves it, is dropped, and its episode is
played again. Added episodes are flushed to the disk and survive a power loss.

Nothing is written before all files of the folder have been read and found to be those of this
evaluation. A file of anything else, of one line or without an end of line too, is refused.

A shard writes a file of its own, episodes-2-of-8.jsonl. Without a shard, the store reads the files
of all shards and copies episodes that it lacks. Each file has one writer at a time: others are
refused by a lock, or where the file system has none, as soon as a second one has written.

An evaluation continues with other patch versions, which give the same numbers if the model's
fingerprint is equal; a line then records the versions that played the episodes after it. Another
major or minor version, another fingerprint, or a processor that rounds differently, is refused.
"""

import collections
import dataclasses
import itertools
import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import BinaryIO, TypeGuard

from limberjack.episodes.manifest import MANIFEST
from limberjack.episodes.statistics import Score
from limberjack.policies import PolicyError
from limberjack.policies.entries import entry_of, shown
from limberjack.utils.files import Hold, appending, flush_folder, read_regular
from limberjack.utils.seeds import SEEDS
from limberjack.workers.identity import advice_on, first_mismatch, processor

__all__ = ["EPISODES", "PAGE", "PICTURE", "RESULT", "SUMMARY", "Store", "check_folder"]

EPISODES = "episodes.jsonl"
RESULT = "result.json"
PAGE = "report.html"
PICTURE = "returns.png"
SUMMARY = "set.json"  # the results of a set of tasks, each in a folder of its own

_SHARD = "episodes-{}-of-{}.jsonl"
_VERSIONS = "versions"
_CANARY = "canary"

# Versions, policy and score.
_Line = tuple[object, str | None, Score | None]


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
        self._head: dict[str, object] = {
            **identity,
            **({} if canary is None else {_CANARY: canary}),
        }
        self._step_limit = _step_limit(identity)
        self._any_processor = any_processor
        self.processor = processor() if any_processor else None
        if directory is None:
            return
        self.path = directory / (EPISODES if shard is None else _SHARD.format(*shard))
        check_folder(directory)
        directory.mkdir(parents=True, exist_ok=True)
        try:
            self._open(self.path, directory if shard is None else self.path, shard is None)
            self._check_source(identity)
            flush_folder(directory)
        except BaseException:
            self.close()
            raise

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

    def _check_source(self, identity: Mapping[str, object]) -> None:
        """Raises ValueError if there are episodes that may be those of another policy."""
        policy, sha256 = str(identity["policy"]), identity["policy_sha256"]
        if sha256 is None and self.scores[policy]:
            assert self.path is not None
            raise ValueError(
                f"{self.path.parent} holds episodes of {policy!r}, whose source is unknown here, "
                "so another policy of that name may have played them: choose another folder, or "
                "define the policy in a file"
            )

    def _open(self, path: Path, held: Path, joins: bool) -> None:
        """Locks and reads the files, and then opens this store's and writes what it lacks.

        Args:
          path: of the file to write.
          held: the file or folder to lock.
          joins: copy the episodes of shards that are not there yet.
        """
        self._hold = Hold(held)
        content = _content(path)
        lines = self._lines(path, content)
        joined = [self._lines(shard, _content(shard)) for shard in _shards(path)] if joins else []
        for versions, policy, score in lines:
            if self.versions[-1:] != [versions]:
                self.versions.append(versions)
            if policy is not None and score is not None:
                self.scores[policy].setdefault(score.seed, score)
        # Unbuffered: a line reaches the system in one piece, even if a kill follows.
        self._file = appending(path)
        if os.fstat(self._file.fileno()).st_size != len(content):
            raise self._other_writer()
        complete = content.rfind(b"\n") + 1
        if complete < len(content):
            os.truncate(self._file.fileno(), complete)
        if not any(self.scores.values()):
            self._file.truncate(0)
            self._write(self._head)
            self.versions = [self._present]
        self._file.seek(0, os.SEEK_END)  # so that its position is the length of the file
        self._join(joined)

    def _join(self, shards: Iterable[Iterable[_Line]]) -> None:
        """Copies the episodes of shards that are not there yet."""
        before = sum(map(len, self.scores.values()))
        for versions, policy, score in itertools.chain.from_iterable(shards):
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
                raise PolicyError(
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
        left = _line(entry)
        try:
            while left:  # a nearly full disk takes a part and raises at the next write
                left = left[self._file.write(left) :]
        except OSError as error:
            error.filename = str(self.path)
            raise

    def _check_alone(self) -> None:
        """Raises OSError if the file has grown by another's episodes."""
        if self._file is not None and os.fstat(self._file.fileno()).st_size != self._file.tell():
            raise self._other_writer()

    def _other_writer(self) -> OSError:
        return OSError(
            f"another process writes to {self.path}: end one of the two, or choose another folder"
        )

    def _flush(self) -> None:
        if self._file is not None:
            os.fsync(self._file.fileno())

    def _lines(self, path: Path, content: bytes) -> list[_Line]:
        """The versions, the policy and the score of each line; without the last two of the first.

        An unfinished last line is left out. A file without episodes may be that of any evaluation.

        Raises:
          ValueError: the file is not one of a store, or is that of another evaluation, or has an
            episode that cannot be.
        """
        complete = content[: content.rfind(b"\n") + 1]
        if not complete:
            # A kill may leave the beginning of the first line.
            if not _line(self._head).startswith(content):
                raise _foreign(path)
            return []
        head, *lines = complete.splitlines()
        first = _entry(head)
        if not self._is_head(first, has_episodes=bool(lines)):
            raise _foreign(path)
        if not lines:
            return []
        self._check_head(path, first)
        versions = first[_VERSIONS]
        found: list[_Line] = [(versions, None, None)]
        for number, line in enumerate(lines, start=2):
            entry = _entry(line)
            if entry is not None and entry.keys() == {_VERSIONS}:
                versions = entry[_VERSIONS]
                if not _are_versions(versions):
                    why = f"versions is {shown(versions)}; expected names with their versions"
                    raise _damaged(f"{path}: line {number}", why)
                self._check_head(path, {**first, _VERSIONS: versions})
                found.append((versions, None, None))
                continue
            policy, score = self._episode(entry, f"{path}: line {number}")
            found.append((versions, policy, score))
        return found

    def _is_head(
        self, entry: dict[str, object] | None, *, has_episodes: bool
    ) -> TypeGuard[dict[str, object]]:
        """Whether a line is the first one of a store: that of any evaluation, without episodes.

        With episodes, a line that names versions is one, and `_check_head` finds what differs.
        """
        if entry is None or not _are_versions(entry.get(_VERSIONS)):
            return False
        if has_episodes:
            return True
        return {*entry} - {_CANARY} == {*self._head} - {_CANARY}

    def _episode(self, entry: dict[str, object] | None, where: str) -> tuple[str, Score]:
        """The policy and the score of a line; raises ValueError if it is no episode."""
        try:
            if entry is None:
                raise ValueError("it is not the JSON of a dictionary")
            policy = entry.pop("policy", None)
            if not isinstance(policy, str):
                raise ValueError(f"policy is {shown(policy)}; expected a name")
            score = entry_of(Score, entry)
            if score.seed >= SEEDS:
                raise ValueError(f"seed is {shown(score.seed)}; expected a number below {SEEDS}")
            if not 1 <= score.length <= self._step_limit:
                raise ValueError(
                    f"length is {shown(score.length)}; expected from 1 to {self._step_limit}, the "
                    "steps of the time limit"
                )
        except ValueError as error:
            raise _damaged(where, str(error)) from None
        return policy, score

    def _check_head(self, path: Path, there: Mapping[str, object]) -> None:
        """Raises ValueError if a file belongs to another evaluation."""
        mismatch = first_mismatch(self._head, there, self._any_processor)
        if mismatch is not None:
            name, expected, found = mismatch
            raise ValueError(
                f"{path.parent} holds an evaluation with {name} {found!r}, and this one "
                f"has {expected!r}: choose another folder, or remove that one"
                f"{advice_on(name)}"
            )


def check_folder(directory: Path) -> None:
    """Raises ValueError if an evaluation here would replace a result, page or picture of others."""
    others = [name for name in (RESULT, PAGE, PICTURE) if os.path.lexists(directory / name)]
    if os.path.lexists(directory) and not directory.is_dir():
        raise ValueError(f"{directory} is no folder: choose another name")
    for name, what in ((MANIFEST, "a dataset"), (SUMMARY, "the results of a set")):
        if os.path.lexists(directory / name):
            raise ValueError(f"{directory} holds {what}, {name}: choose another folder")
    if others and not any(directory.glob("episodes*.jsonl")):
        raise ValueError(
            f"{directory} holds {others[0]} but no {EPISODES}, so it is not the folder of an "
            "evaluation: choose another folder"
        )


def _step_limit(identity: Mapping[str, object]) -> float:
    """The most steps of an episode; infinite if the identity does not have them."""
    seconds, timestep = identity.get("time_limit"), identity.get("control_timestep")
    if not isinstance(seconds, int | float) or not isinstance(timestep, int | float):
        return math.inf
    return round(seconds / timestep)


def _shards(path: Path) -> list[Path]:
    """The files of shards beside the one that joins them."""
    return sorted(path.parent.glob(_SHARD.format("*", "*")))


def _content(path: Path) -> bytes:
    """The content of a store's file; nothing without one.

    Raises:
      ValueError: it is a link, or not a regular file.
    """
    if path.is_symlink():
        raise ValueError(
            f"{path} is a link, which an evaluation never follows: name the folder of the file "
            "itself, or choose another one"
        )
    try:
        return read_regular(path)
    except FileNotFoundError:
        return b""


def _line(entry: Mapping[str, object]) -> bytes:
    """A line of a store."""
    return json.dumps(entry).encode() + b"\n"


def _entry(text: bytes) -> dict[str, object] | None:
    """The dictionary in a line, or None."""
    try:
        entry = json.loads(text)
    except (RecursionError, ValueError):
        return None
    return entry if isinstance(entry, dict) else None


def _are_versions(value: object) -> bool:
    """Whether a value has the form of `versions()`."""
    return isinstance(value, dict) and all(isinstance(one, str) for one in value.values())


def _foreign(path: Path) -> ValueError:
    return ValueError(
        f"{path} does not begin with the line of an evaluation, so something else wrote it: choose "
        "another folder, or remove that file"
    )


def _damaged(where: str, why: str) -> ValueError:
    return ValueError(
        f"{where} is no episode: remove that line to play the episode again, or choose another "
        f"folder ({why})"
    )
