"""result.json: the returns of a run, and everything needed to run it again; and the run's folder.

    check_folder(Path("out"), {"domain": "humanoid", "task": "walk", "policy": "zero"})
    result = as_result(run_facts, episodes, fingerprint(physics.model._official))
    write_result(Path("out/result.json"), result)

The file is valid JSON: a number that is not finite is written as null. A run replaces the files of
an earlier run of the same task and policy, and of nothing else: a folder with other results is left
as it is, so that no result lies beside another one's film.
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NotRequired, Protocol, TypedDict, cast

import numpy as np

from limberjack.mujoco.fingerprint import versions
from limberjack.utils.facts import Facts
from limberjack.utils.files import read_regular, write_whole

__all__ = [
    "EVALUATION",
    "FILM",
    "PAGE",
    "PLOT",
    "RESULT",
    "Entry",
    "Played",
    "Result",
    "as_result",
    "check_folder",
    "write_result",
]

FILM = "video.mp4"
PAGE = "report.html"
PLOT = "return.png"
RESULT = "result.json"
EVALUATION = "episodes*.jsonl"  # as `limberjack.evaluation.store` calls them

# Entries that are equal in all results of a folder, where they have them.
_SAME = ("domain", "task", "environment", "policy")


# Of an episode. A return is None if it is no finite number.
Entry = TypedDict(
    "Entry", {"seed": int, "return": float | None, "length": int, "start": NotRequired[str]}
)


class Result(Facts):
    """The contents of result.json."""

    episodes: Sequence[Entry]
    episodes_asked_for: int


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


def write_result(path: Path, result: Result) -> None:
    """Write result.json whole, or leave the one that is there."""
    write_whole(path, json.dumps(result, indent=2, allow_nan=False) + "\n")


def as_result(
    run: Mapping[str, object], episodes: Sequence[Played], model_fingerprint: str
) -> Result:
    """The contents of result.json.

    Args:
      run: the facts of the run: domain, task, policy and so on.
      episodes: those that ended, in order.
      model_fingerprint: of the compiled model, before the first episode changed it.
    """
    result: dict[str, object] = {
        **run,
        "episodes": [_episode_entry(episode) for episode in episodes],
        "versions": versions(),
        "fingerprint": model_fingerprint,
    }
    return cast(Result, result)


def _episode_entry(episode: Played) -> Entry:
    entry: Entry = {
        "seed": episode.seed,
        "return": episode.total if math.isfinite(episode.total) else None,
        "length": episode.length,
    }
    if episode.start is not None:
        entry["start"] = episode.start
    return entry


def check_folder(directory: Path, run: Mapping[str, object]) -> None:
    """Checks that a folder holds no other results than those of a run.

    Args:
      directory: the folder, which exists.
      run: the run's facts; has 'policy', and 'domain' and 'task', or 'environment'.

    Raises:
      ValueError: it does.
      OSError: its result cannot be read.
    """
    if any(directory.glob(EVALUATION)):
        raise ValueError(f"{directory} holds an evaluation: choose another folder")
    result = _result(directory)
    if result is None:
        left = [name for name in (PAGE, PLOT, FILM) if os.path.lexists(directory / name)]
        if left:
            raise ValueError(
                f"{directory} holds {left[0]} but no {RESULT}, so it is not the folder of a run: "
                "choose another folder"
            )
        return
    for name in _SAME:
        if result.get(name) != run.get(name):
            raise ValueError(
                f"{directory} holds results with {name} {result.get(name)!r}, and these have "
                f"{run.get(name)!r}: choose another folder"
            )


def _result(directory: Path) -> dict[str, object] | None:
    """The entries of the folder's result; none if it is not JSON, None if there is no result."""
    if not os.path.lexists(directory / RESULT):
        return None
    content = read_regular(directory / RESULT)
    try:
        result = json.loads(content)
    except (RecursionError, ValueError):
        return {}
    return result if isinstance(result, dict) else {}
