"""Tables, error lines and exit statuses of commands."""

import contextlib
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Protocol, TextIO

import rich.box
import rich.console
import rich.table
import typer

import limberjack
from limberjack.cli.process import INTERRUPTED, TERMINATED
from limberjack.utils.described import described, is_of_user
from limberjack.utils.log import log

if TYPE_CHECKING:
    from limberjack.evaluation import Summary

__all__ = [
    "FAILED",
    "INTERRUPTED",
    "MISUSED",
    "TERMINATED",
    "Progress",
    "add_summaries",
    "append_working_directory",
    "complain",
    "console",
    "failures_reported",
    "is_terminal",
    "misuse_reported",
    "remarks_reported",
    "search_working_directory",
    "summaries_table",
    "table",
    "users_failure",
    "visible",
    "worded",
]

# Exit statuses, besides that of an interrupt.
FAILED = 1
MISUSED = 2

_WIDTH = 1000  # characters of a line; a narrow terminal continues it, and no digit is left out


def search_working_directory(policy: str) -> None:
    """Lets Python import the module of a policy MODULE:CALLABLE from the working directory.

    The directory is searched last, and only for such a policy, so that a stray matplotlib.py in it
    is not imported in place of the installed one.
    """
    from limberjack import policies

    if ":" in policy and not policies.is_saved_model(policy):
        append_working_directory()


# As Python words an OSError; the words after it say the same.
_ERROR_NUMBER = re.compile(r"\[(?:Errno|WinError) \d+\] ")


def append_working_directory() -> None:
    """Lets Python import from the working directory, after all other places."""
    with contextlib.suppress(FileNotFoundError):  # the directory has been removed
        if os.getcwd() not in sys.path:
            sys.path.append(os.getcwd())


def table(*columns: str) -> rich.table.Table:
    """An empty table; a column whose name ends in '>' is aligned to the right."""
    table = rich.table.Table(box=rich.box.SIMPLE_HEAD, show_edge=False)
    for column in columns:
        name = column.removesuffix(">")
        table.add_column(name, justify="left" if name == column else "right", no_wrap=True)
    return table


def console() -> rich.console.Console:
    """Standard output; a cell such as the file `[red].zip` is shown as it is."""
    return rich.console.Console(width=_WIDTH, markup=False, emoji=False)


def is_terminal(stream: TextIO | None) -> bool:
    """Whether a person sees a stream; None where it was closed before the program began."""
    return stream is not None and stream.isatty()


@contextlib.contextmanager
def misuse_reported() -> Iterator[None]:
    """Turns an error in the arguments, or in code that they name, into one line and status 2."""
    try:
        yield
    except (ValueError, OSError, MemoryError) as error:  # too many environments, for example
        complain(error)
        raise typer.Exit(MISUSED) from None
    except Exception as error:
        if not hasattr(error, "__notes__"):  # which all errors of a policy's module have
            raise
        complain(worded(error))
        raise typer.Exit(MISUSED) from None


class Progress(Protocol):
    """Shows the progress of episodes; `Units` and `Steps` of `limberjack.cli.progress` do."""

    finished: int | None  # episodes or steps; None before the first one has begun


@contextlib.contextmanager
def failures_reported(
    progress: Progress, done: Callable[[], str], failures: tuple[type[Exception], ...] = ()
) -> Iterator[None]:
    """Turns an error or interrupt while episodes are played into one line and an exit status.

    Args:
      progress: an error before the first episode has begun is a mistake on the command line.
      done: the number of episodes that are complete, and how to continue, in words.
      failures: errors that are no such mistake.
    """
    from limberjack.episodes.manifest import DamagedError
    from limberjack.policies import PolicyError
    from limberjack.registry.sets import SetError
    from limberjack.rl.control import PhysicsError
    from limberjack.workers import WorkError

    try:
        yield
    except KeyboardInterrupt:
        complain(f"interrupted: {done()}")
        raise typer.Exit(INTERRUPTED) from None
    except Exception as error:
        begun = progress.finished is not None or isinstance(error, failures)
        expected = (PolicyError, PhysicsError, WorkError, SetError, DamagedError, OSError)
        expected = (*expected, *failures)
        if isinstance(error, expected if begun else (*expected, ValueError)):
            sentence = worded(error)
        else:
            sentence = users_failure(error)
        if sentence is None:
            if begun:
                error.add_note(f"limberjack: {done()}")
            raise
        would_recur = getattr(error, "would_recur", False)
        complain(f"{sentence}; {done()}" if begun and not would_recur else sentence)
        raise typer.Exit(FAILED if begun else MISUSED) from None


@contextlib.contextmanager
def remarks_reported() -> Iterator[None]:
    """Prints at exit, once each, why a task was played in rows, and other remarks on results.

    That a saved model is code is said before the first one is loaded.
    """
    from limberjack.episodes.manifest import NOT_DRAWN, SET_ASIDE
    from limberjack.policies.named import NOT_RESET
    from limberjack.policies.networks import OTHER_SCORES
    from limberjack.policies.saved import RUNS_CODE
    from limberjack.rl.batches import NOT_VECTORISED

    remarks: dict[str, None] = {}
    said: set[str] = set()

    class Remarks(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.msg in (NOT_DRAWN, NOT_RESET, NOT_VECTORISED, OTHER_SCORES, SET_ASIDE):
                remarks[record.getMessage()] = None
            elif record.msg == RUNS_CODE and RUNS_CODE not in said:
                said.add(RUNS_CODE)
                complain(record.getMessage())

    handler, level = Remarks(logging.INFO), log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
        for remark in remarks:
            complain(remark)


def complain(what: object) -> None:
    """Writes a note or an error to standard error, as one line."""
    text = worded(what) if isinstance(what, BaseException) else str(what)
    text = _ERROR_NUMBER.sub("", text)
    typer.echo(f"limberjack: {visible(' '.join(text.split()))}", err=True)


def visible(text: str) -> str:
    """A text that may come from anyone, with escapes for characters that a terminal would obey."""
    return "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text)


def worded(error: BaseException) -> str:
    """An error after its notes, such as the policy, the step and the seed.

    One of the user's own code has its kind and place too.
    """
    notes = getattr(error, "__notes__", [])
    is_own_class = type(error).__module__.partition(".")[0] == limberjack.__name__
    if notes and not is_own_class:
        return described(error)
    return ": ".join([*notes, str(error)])


def users_failure(error: BaseException) -> str | None:
    """The sentence on an error of the user's policy or task, as workers give it.

    None for an error of this package, whose traceback is needed to find it.
    """
    if not isinstance(error, Exception) or not (hasattr(error, "__notes__") or is_of_user(error)):
        return None
    return described(error)


def summaries_table() -> rich.table.Table:
    """An empty table of policies."""
    return table("policy", "start", "episodes>", "mean>", "95 % interval>", "median>", "success>")


def add_summaries(
    rows: rich.table.Table, name: str, summary: "Summary", strata: "Mapping[str, Summary]"
) -> None:
    """Adds the row of all episodes, and one for each kind of start."""
    rows.add_row(visible(name), "", *_cells(summary))
    for start, of_start in strata.items():
        rows.add_row("", visible(start), *_cells(of_start))
    rows.add_section()


def _cells(summary: "Summary") -> tuple[str, ...]:
    interval = ""
    if summary.interval is not None:
        interval = "{:.1f} to {:.1f}".format(*summary.interval)
    return (
        str(summary.episodes),
        f"{summary.mean:.1f}",
        interval,
        f"{summary.median:.1f}",
        f"{100 * summary.success_rate:.1f} %",
    )
