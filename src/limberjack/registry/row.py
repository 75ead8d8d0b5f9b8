"""`Row`: the facts about a task that others need without importing its domain."""

from typing import NamedTuple

__all__ = ["Row"]


class Row(NamedTuple):
    """A task of a domain; `table.py` has one for each task of the suite."""

    domain: str
    task: str
    tags: tuple[str, ...]
    steps: int | None  # of an episode; None without a time limit
    dof: int  # degrees of freedom of the model
