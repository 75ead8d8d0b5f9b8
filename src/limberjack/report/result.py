"""result.json: the returns of a run, and everything needed to run it again.

    write_result(Path("out/result.json"), run_facts, episodes, fingerprint(physics.model._model))

The file is valid JSON: a number that is not finite is written as null.
"""

import hashlib
import json
import math
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

import limberjack
from limberjack.mujoco.official import mujoco
from limberjack.utils.files import replacing

if TYPE_CHECKING:
    from hashlib import _Hash

    from mujoco import MjModel

__all__ = ["Facts", "Played", "as_result", "fingerprint", "title_of", "versions", "write_result"]

Facts = dict[str, Any]  # Any: values of JSON, whose types are not known before it is read


class Played(Protocol):
    """An episode that has ended, as results and pages show it; `episodes.Episode` is one."""

    @property
    def seed(self) -> int:
        """Of the environment."""
        ...

    @property
    def start(self) -> str | None:
        """The kind of start; None if the task has no kinds."""
        ...

    @property
    def rewards(self) -> np.ndarray:
        """(T,), one per step."""
        ...

    @property
    def returns(self) -> np.ndarray:
        """The rewards summed up to each step, (T,)."""
        ...

    @property
    def total(self) -> float:
        """The return."""
        ...

    @property
    def length(self) -> int:
        """The number of steps."""
        ...


# Fields that depend on the files of a model and on its compiler, not on the model itself.
_NOT_OF_THE_MODEL = ("paths", "signature")


def write_result(
    path: Path, run: Mapping[str, object], episodes: Sequence[Played], model_fingerprint: str
) -> None:
    """Write result.json whole, or leave the one that is there.

    Args:
      path: the file.
      run: the facts of the run: domain, task, policy and so on.
      episodes: those that ended, in order.
      model_fingerprint: of the compiled model, before the first episode changed it.
    """
    result = as_result(run, episodes, model_fingerprint)
    text = json.dumps(result, indent=2, allow_nan=False)
    with replacing(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8")


def as_result(
    run: Mapping[str, object], episodes: Sequence[Played], model_fingerprint: str
) -> Facts:
    """The contents of result.json; arguments are those of `write_result`."""
    return {
        **run,
        "episodes": [_episode_entry(episode) for episode in episodes],
        "versions": versions(),
        "fingerprint": model_fingerprint,
    }


def title_of(facts: Mapping[str, object]) -> str:
    """The task that facts are about, or the function that made its environments."""
    return str(facts.get("environment") or f"{facts['domain']} {facts['task']}")


def versions() -> dict[str, str]:
    """The versions of the packages that numbers depend on."""
    return {
        "limberjack": limberjack.__version__,
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def fingerprint(model: "MjModel") -> str:
    """SHA-256 over the names and values of all fields of a compiled `mujoco.MjModel`, in hex.

    Equal models have equal fingerprints, wherever their files lie and however often they are
    compiled. Compilers and processors that round differently give models that differ.
    """
    digest = hashlib.sha256()
    _add_fields(digest, "", model)
    return digest.hexdigest()


def _add_fields(digest: "_Hash", prefix: str, struct: object) -> None:
    """Add every public field of a MuJoCo struct, including those of the structs within it."""
    for name in sorted(dir(struct)):
        if name.startswith("_") or name in _NOT_OF_THE_MODEL or name.endswith("pathadr"):
            continue
        value = getattr(struct, name)
        if callable(value):
            continue
        full = f"{prefix}{name}"
        if isinstance(value, np.ndarray):
            digest.update(f"{full} {value.dtype.str}{value.shape}".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
        elif isinstance(value, int | float | bytes):
            digest.update(f"{full} {value!r}".encode())
        else:
            _add_fields(digest, f"{full}.", value)


def _episode_entry(episode: Played) -> Facts:
    entry: Facts = {
        "seed": episode.seed,
        "return": episode.total if math.isfinite(episode.total) else None,
        "length": episode.length,
    }
    return entry if episode.start is None else {**entry, "start": episode.start}
