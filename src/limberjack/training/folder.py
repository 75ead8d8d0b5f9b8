"""`opened`: the files of one run, from which the same command continues after a kill.

    training.json       what identifies the run, and the versions and the command that began it
    curve.csv           one line for each evaluation
    curve.png           the same as a picture, once the run has finished
    tensorboard/        events for TensorBoard
    checkpoint.pickle   all that the run depends on, until it has finished
    policy.safetensors  the final policy, once the run has finished

Each file is written whole or not at all. The checkpoint is a pickle, because a task may remember
any object: continue only runs of people whom you trust.
"""

import contextlib
import json
import pickle
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from limberjack.utils.files import Hold, open_regular, read_regular, replacing
from limberjack.workers.identity import first_difference, first_mismatch

__all__ = ["POLICY", "Folder", "opened"]

POLICY = "policy.safetensors"
_IDENTITY = "training.json"
_UNFINISHED = re.compile(r"\.\w+\.[0-9a-f]{16}\.\w+")  # see `utils.files.Partial`


class Folder:
    """See the module's docstring.

    Attributes:
      policy, curve, picture, events: paths.
    """

    def __init__(self, directory: Path) -> None:
        """Takes the path of an existing folder."""
        self.policy = directory / POLICY
        self.curve = directory / "curve.csv"
        self.picture = directory / "curve.png"
        self.events = directory / "tensorboard"
        self._checkpoint = directory / "checkpoint.pickle"

    def write_curve(self, columns: Sequence[str], numbers: np.ndarray) -> None:
        """Writes curve.csv, with all digits."""
        with replacing(self.curve) as partial:
            np.savetxt(partial, numbers, "%.17g", ",", header=",".join(columns), comments="")

    def save(self, state: Mapping[str, object]) -> None:
        """Writes a checkpoint, which replaces the last one."""
        with replacing(self._checkpoint) as partial, partial.open("wb") as file:
            pickle.dump(state, file, protocol=pickle.HIGHEST_PROTOCOL)

    def load(self) -> dict[str, Any] | None:  # Any: as given to `save`
        """The last checkpoint; None without one.

        Raises:
          ValueError: it is damaged, or does not fit into memory.
          OSError: it cannot be read.
        """
        if not self._checkpoint.exists():
            return None
        try:
            with open_regular(self._checkpoint) as file:
                return pickle.load(file)
        except OSError:  # of a file that may be whole
            raise
        except MemoryError as error:
            raise ValueError(
                f"{self._checkpoint} does not fit into the free memory, or is damaged: free memory "
                "and continue, or remove it to begin again"
            ) from error
        except Exception as error:  # pickle raises errors of any class
            raise self.damaged(error) from error

    def damaged(self, error: Exception) -> ValueError:
        """The error of a checkpoint that cannot be used."""
        return ValueError(f"{self._checkpoint} is damaged ({error!r}): remove it to begin again")

    def finish(self) -> None:
        """Removes the checkpoint, once the policy has been written."""
        if self._checkpoint.exists():  # a finished run may be in a folder that cannot be written
            self._checkpoint.unlink()


@contextlib.contextmanager
def opened(
    directory: Path, identity: Mapping[str, object], more: Mapping[str, object]
) -> Iterator[Folder]:
    """The folder of a run, which is made if there is none; other processes cannot write there.

    Args:
      directory: its path.
      identity: what must be equal for the run to continue, as values of JSON.
      more: what is written beside it when the run begins.

    Raises:
      ValueError: it has another run or other files, or another process writes there; nothing was
        changed.
      OSError: it cannot be read or written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    with Hold(directory):
        path = directory / _IDENTITY
        _check(path, json.loads(json.dumps(identity)), more)
        for left in directory.glob(".*"):
            if _UNFINISHED.fullmatch(left.name):  # of a process that was killed
                left.unlink()
        if not path.exists():
            with replacing(path) as partial:
                text = json.dumps({**identity, **more}, indent=2)
                partial.write_text(f"{text}\n", encoding="utf-8")
        yield Folder(directory)


def _check(path: Path, identity: Mapping[str, object], more: Mapping[str, object]) -> None:
    """Raises ValueError unless the folder of a run's identity is empty, or has this one.

    An unfinished one must have been begun with the same series of versions.
    """
    directory = path.parent
    if not path.exists():
        others = [one.name for one in directory.iterdir() if one.name[0] != "."]
        if others:
            raise ValueError(
                f"{directory} has other files, such as {min(others)}: choose a new folder"
            )
        return
    try:
        found = json.loads(read_regular(path))
        kept = {name: found.get(name) for name in identity}
        is_run = not identity.keys().isdisjoint(found)
    except (AttributeError, RecursionError, ValueError):
        found, kept, is_run = {}, {}, False
    if not is_run:
        raise ValueError(f"{path} is damaged: choose another folder")
    difference = first_difference(identity, kept)
    if difference is None and not (directory / POLICY).exists():
        difference = first_mismatch({"versions": more["versions"]}, found)
    if difference is not None:
        name, here, there = difference
        other = f", or give the settings in its {_IDENTITY}" if name.startswith("settings.") else ""
        raise ValueError(
            f"{directory} has a run whose {name} is {there!r}, not {here!r}: choose another folder"
            f"{other}"
        )
