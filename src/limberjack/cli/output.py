"""What commands print, and how they end."""

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import rich.box
import rich.console
import rich.progress
import rich.table
import typer

from limberjack.utils.seeds import SEEDS

if TYPE_CHECKING:
    from limberjack.policies import Policy

__all__ = [
    "FAILED",
    "INTERRUPTED",
    "MISUSED",
    "SEEDS",
    "TERMINATED",
    "Progress",
    "complain",
    "console",
    "find_policy",
    "misuse_reported",
    "search_working_directory",
    "show_progress",
    "table",
]

# Exit statuses.
FAILED = 1
MISUSED = 2
INTERRUPTED, TERMINATED = 130, 143  # as shells report what Ctrl-C or SIGTERM ended

_MODEL = "sb3:"  # begins a policy that is a file
_PIPE_WIDTH = 200  # columns where there is no terminal: no row is broken
_BAR_UPDATE = 10  # steps; the bar is drawn ten times a second at most


class Progress:
    """A bar over all episodes with the running return; silent where there is no terminal."""

    def __init__(self, bar: rich.progress.Progress, episodes: int) -> None:
        self._bar = bar
        self._episodes = episodes
        self._task = bar.add_task("", total=episodes, total_return=0.0)

    def show(self, finished: int, steps: int, step_limit: int | None, total: float) -> None:
        """Shows the step of the running episode, some of the time."""
        if self._bar.disable or (steps % _BAR_UPDATE and steps != step_limit):
            return
        part = steps / step_limit if step_limit else 0.0
        self._bar.update(
            self._task,
            completed=finished + part,
            description=f"episode {finished + 1}/{self._episodes}",
            total_return=total,
        )


@contextlib.contextmanager
def show_progress(episodes: int) -> Iterator[Progress]:
    """A bar on standard error while the context lasts."""
    columns = (
        "{task.description}",
        rich.progress.BarColumn(),
        "return {task.fields[total_return]:.1f}",
        rich.progress.TimeRemainingColumn(),
    )
    with rich.progress.Progress(
        *columns,
        console=rich.console.Console(stderr=True),
        disable=not sys.stderr.isatty(),
        transient=True,
    ) as bar:
        yield Progress(bar, episodes)


def find_policy(name: str) -> "Policy":
    """The policy of that name, whose module may lie in the working directory."""
    from limberjack import policies

    search_working_directory(name)
    return policies.find(name)


def search_working_directory(policy: str) -> None:
    """Let a policy MODULE:CALLABLE be found in the working directory, as with `python -m`.

    The folder is searched last, and only for such a policy: a stray matplotlib.py that lies in it
    is not imported in the place of the installed one.
    """
    if ":" in policy and not policy.startswith(_MODEL) and os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())


def table(*columns: str) -> rich.table.Table:
    """An empty table; a column whose name ends in '>' is aligned to the right."""
    table = rich.table.Table(box=rich.box.SIMPLE_HEAD, show_edge=False)
    for column in columns:
        name = column.removesuffix(">")
        table.add_column(name, justify="left" if name == column else "right", no_wrap=True)
    return table


def console() -> rich.console.Console:
    """Standard output."""
    return rich.console.Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH)


@contextlib.contextmanager
def misuse_reported() -> Iterator[None]:
    """Turns an error in what was asked for into one line and exit status 2."""
    try:
        yield
    except (ValueError, OSError) as error:
        complain(error)
        raise typer.Exit(MISUSED) from None


def complain(what: object) -> None:
    """Writes one line to standard error."""
    typer.echo(f"limberjack: {' '.join(str(what).split())}", err=True)
