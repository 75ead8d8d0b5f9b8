"""`Row`: facts about a task that are available without importing its domain."""

from typing import NamedTuple

__all__ = ["Row"]


class Row(NamedTuple):
    """A task of a domain; `table.py` lists one row per suite task."""

    domain: str
    task: str
    tags: tuple[str, ...]
    steps: int | None  # of an episode; None without a time limit
    dof: int  # degrees of freedom of the model
