"""The files of a run's folder, and the folders that a run may write to.

    check_folder(Path("out"), {"domain": "humanoid", "task": "walk", "policy": "zero"})

A run replaces the files of an earlier run of the same task and policy, and of nothing else: a
folder with other results is left as it is, so that no result lies beside another one's film.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path

from limberjack.utils.files import read_regular

__all__ = ["EVALUATION", "FILM", "PAGE", "PLOT", "RESULT", "check_folder"]

FILM = "video.mp4"
PAGE = "report.html"
PLOT = "return.png"
RESULT = "result.json"
EVALUATION = "episodes*.jsonl"  # as `limberjack.evaluation.store` calls them

# Entries that are equal in all results of a folder, where they have them.
_SAME = ("domain", "task", "environment", "policy")


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
