"""result.json: the returns of a run, and everything needed to run it again.

    write_result(Path("out/result.json"), run_facts, episodes, fingerprint(physics.model._model))

The file is valid JSON: a number that is not finite is written as null.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from limberjack.mujoco.fingerprint import versions
from limberjack.utils.facts import Facts
from limberjack.utils.files import replacing

__all__ = ["Played", "as_result", "write_result"]


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


def _episode_entry(episode: Played) -> Facts:
    entry: Facts = {
        "seed": episode.seed,
        "return": episode.total if math.isfinite(episode.total) else None,
        "length": episode.length,
    }
    return entry if episode.start is None else {**entry, "start": episode.start}
