"""Pictures of episodes in a folder: their files, and the facts about them in episodes.json.

write(folder, "walker-walk", picture)
write_facts(folder, {"walker-walk": Episode(seed=0)})
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from limberjack import suite
from limberjack.suite import base
from limberjack.utils import png
from limberjack.utils.files import write_whole

__all__ = ["camera_of", "facts", "write", "write_facts"]

_FACTS = "episodes.json"
_Facts = TypeVar("_Facts")


def camera_of(domain: str, task: str) -> int | str:
    """The camera of a task's pictures."""
    return getattr(suite.module_of(domain), "PICTURES", {}).get(task, base.Picture()).camera


def write(folder: Path, name: str, picture: np.ndarray) -> None:
    """Writes a picture as NAME.png; the folder is made if there is none."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / f"{name}.png", png.encode(picture))


def facts(folder: Path, kind: Callable[..., _Facts]) -> dict[str, _Facts]:
    """The facts about all pictures in a folder, by 'domain-task'; empty if there are none."""
    file = folder / _FACTS
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return {name: kind(**each) for name, each in found.items()}


def write_facts(folder: Path, found: Mapping[str, NamedTuple]) -> None:
    """Replaces the facts of a folder."""
    listed = {name: found[name]._asdict() for name in sorted(found)}
    write_whole(folder / _FACTS, json.dumps(listed, indent=2) + "\n")
