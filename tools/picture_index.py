"""The facts about a folder of pictures of episodes, kept beside them in episodes.json."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol, TypeVar

from limberjack.utils.files import replacing

__all__ = ["read", "write"]

_INDEX = "episodes.json"
_Facts = TypeVar("_Facts")


class _Record(Protocol):
    """Facts about a picture, as a named tuple."""

    def _asdict(self) -> dict[str, object]: ...


def read(folder: Path, kind: Callable[..., _Facts]) -> dict[str, _Facts]:
    """The facts of all pictures in a folder, by 'domain-task'; empty if there are none."""
    index = folder / _INDEX
    if not index.exists():
        return {}
    found = json.loads(index.read_text(encoding="utf-8"))
    return {name: kind(**facts) for name, facts in found.items()}


def write(folder: Path, found: Mapping[str, _Record]) -> None:
    """Replaces the facts of a folder."""
    listed = {name: found[name]._asdict() for name in sorted(found)}
    with replacing(folder / _INDEX) as partial:
        partial.write_text(json.dumps(listed, indent=2) + "\n", encoding="utf-8")
