"""`Folder`: the files of one run, from which the same command continues after a kill.

    training.json       what identifies the run, and the versions and the command that began it
    curve.csv           one line for each evaluation
    tensorboard/        events for TensorBoard
    checkpoint/         state and transitions, until the run has finished
    policy.safetensors  the final policy, once the run has finished

Each file is written whole or not at all. A checkpoint first writes the transitions since the last
one into a file of their own, and then replaces the state, which has their number. Transitions
beyond that number belong to a checkpoint that was interrupted. The state is a pickle, because a
task may remember any object: continue only runs of people whom you trust.
"""

import contextlib
import itertools
import json
import pickle
import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from limberjack.utils.facts import Facts
from limberjack.utils.files import Hold, replacing
from limberjack.utils.regular import read_regular
from limberjack.workers.identity import first_difference

__all__ = ["POLICY", "Folder"]

POLICY = "policy.safetensors"
_IDENTITY = "training.json"
_UNFINISHED = re.compile(r"\.\w+\.[0-9a-f]{16}\.\w+")  # see `utils.files.Partial`
_FIRST = re.compile(r"transitions-(\d{12})\.npz")

_Rows = Mapping[str, np.ndarray]


class Folder:
    """See the module's docstring. It is locked until `close`.

    Attributes:
      policy, curve, events: paths.
    """

    def __init__(self, directory: Path, identity: Facts, more: Facts) -> None:
        """Opens the folder of a run, or makes one.

        Args:
          directory: its path.
          identity: what must be equal for the run to continue, as values of JSON.
          more: what is written beside it when the run begins.

        Raises:
          ValueError: it has another run or other files, or another process writes there; nothing
            was changed.
          OSError: it cannot be read or written.
        """
        self.policy = directory / POLICY
        self.curve = directory / "curve.csv"
        self.events = directory / "tensorboard"
        self._directory = directory
        self._checkpoint = directory / "checkpoint"
        self._state = self._checkpoint / "state.pickle"
        directory.mkdir(parents=True, exist_ok=True)
        self._hold = Hold(directory)
        try:
            self._check(json.loads(json.dumps(identity)))
            for path in [*directory.glob(".*"), *self._checkpoint.glob(".*")]:
                if _UNFINISHED.fullmatch(path.name):  # of a process that was killed
                    path.unlink()
            if not (directory / _IDENTITY).exists():
                self.write(directory / _IDENTITY, json.dumps({**identity, **more}, indent=2))
        except BaseException:
            self._hold.release()
            raise

    def _check(self, identity: Facts) -> None:
        """Raises ValueError unless the folder is empty or has this run."""
        path = self._directory / _IDENTITY
        if not path.exists():
            others = [one.name for one in self._directory.iterdir() if one.name[0] != "."]
            if others:
                raise ValueError(
                    f"{self._directory} has other files, such as {min(others)}: choose a new folder"
                )
            return
        try:
            found = json.loads(read_regular(path))
            kept = {name: found[name] for name in identity}
        except (ValueError, KeyError, TypeError):
            raise ValueError(f"{path} is damaged: choose another folder") from None
        difference = first_difference(identity, kept)
        if difference is not None:
            name, here, there = difference
            raise ValueError(
                f"{self._directory} has a run whose {name} is {there!r}, not {here!r}: choose "
                "another folder"
            )

    @property
    def is_finished(self) -> bool:
        """Whether the final policy is here."""
        return self.policy.exists()

    def write(self, path: Path, text: str) -> None:
        """Writes a file of the folder."""
        with replacing(path) as partial:
            partial.write_text(f"{text.rstrip()}\n", encoding="utf-8")

    def save(self, state: Mapping[str, object], kept: int, first: int, rows: _Rows) -> None:
        """Writes a checkpoint.

        Args:
          state: whatever `load` is to return, which can be pickled.
          kept: the number of steps whose transitions were kept.
          first: the number of the first step that no checkpoint has.
          rows: the transitions of the steps from `first` on.
        """
        self._checkpoint.mkdir(exist_ok=True)
        if kept > first:
            with replacing(self._checkpoint / f"transitions-{first:012d}.npz") as partial:
                np.savez(partial, **rows)
        with replacing(self._state) as partial, partial.open("wb") as file:
            pickle.dump({**state, "kept": kept}, file)

    def forget(self, before: int) -> None:
        """Removes transitions of steps that have all been overwritten."""
        files = sorted(self._files().items())
        for (_, path), (following, _) in itertools.pairwise(files):
            if following <= before:
                path.unlink()

    def load(self) -> dict[str, Any] | None:  # Any: as given to `save`
        """The state of the last checkpoint, with the number `kept`; None without one.

        Raises:
          ValueError: it is damaged.
        """
        if not self._state.exists():
            return None
        with self._damage_named():
            return pickle.loads(read_regular(self._state))

    def transitions(self, kept: int) -> Iterator[tuple[int, _Rows]]:
        """The transitions of the last checkpoint, each with the number of its first step.

        Raises:
          ValueError: they are damaged.
        """
        for first, path in sorted(self._files().items()):
            if first >= kept:
                path.unlink()  # of a checkpoint that was interrupted
                continue
            with self._damage_named():
                rows = dict(np.load(path, allow_pickle=False))
            yield first, rows

    def finish(self) -> None:
        """Removes the checkpoint, once the policy has been written."""
        shutil.rmtree(self._checkpoint, ignore_errors=True)

    def close(self) -> None:
        """Lets other processes write here."""
        self._hold.release()

    def _files(self) -> dict[int, Path]:
        """The files of transitions by the number of their first step."""
        found = {}
        for path in self._checkpoint.glob("transitions-*.npz"):
            name = _FIRST.fullmatch(path.name)
            if name is not None:
                found[int(name[1])] = path
        return found

    @contextlib.contextmanager
    def _damage_named(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # pickle and zipfile raise errors of any class
            raise ValueError(
                f"{self._checkpoint} is damaged ({error}): remove it to begin again"
            ) from error
