"""Progress bars on standard error; nothing is shown where that is not a terminal.

with show_units() as progress:       # or units_reported, which turns failures into one line
    progress.begin(300)
    evaluate(..., on_progress=progress.show, on_state=progress.show_state)

with show_steps("training") as progress:
    train(..., on_progress=progress.show)

with show_parts() as show:
    show("drawing humanoid walk", finished, pictures)
"""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import rich.console
import rich.progress

from limberjack.cli.output import failures_reported, is_terminal, remarks_reported

if TYPE_CHECKING:
    from limberjack.workers import State

__all__ = [
    "Steps",
    "Units",
    "progress_bar",
    "show_parts",
    "show_steps",
    "show_units",
    "units_reported",
]

_UPDATE = 0.1  # seconds from one update to the next; a step may take microseconds


def progress_bar(
    *columns: str | rich.progress.ProgressColumn, auto_refresh: bool = True
) -> rich.progress.Progress:
    """A bar with a description before it and columns after it, which disappears at the end.

    Args:
      columns: as Rich takes them.
      auto_refresh: redraw ten times a second from a thread; otherwise only on `refresh`.
    """
    return rich.progress.Progress(
        "{task.description}",
        rich.progress.BarColumn(),
        *columns,
        # Names of policies may look like markup: sb3:[red].zip.
        console=rich.console.Console(stderr=True, markup=False, emoji=False),
        disable=not is_terminal(sys.stderr),
        transient=True,
        auto_refresh=auto_refresh,
    )


class Units:
    """A bar over all episodes of a command, with their throughput and the state of the workers.

    Attributes:
      episodes: their number.
      finished: those that have ended, in earlier calls too; None before the first one has begun.
    """

    def __init__(self, bar: rich.progress.Progress) -> None:
        """Adds the episodes to a bar that is shown."""
        self.episodes = 0
        self.finished: int | None = None
        self._bar = bar
        self._began: tuple[float, float] | None = None  # time, and the episodes that had ended
        self._task = bar.add_task("loading", total=None, speed="", workers="")

    def begin(self, episodes: int) -> None:
        """Sets the number of episodes."""
        self.episodes = episodes
        self._bar.update(self._task, total=episodes)

    def show(self, what: str, finished: int, part: float = 0.0) -> None:
        """Shows progress.

        Args:
          what: is being played, such as the policy.
          finished: number of episodes that have ended, in earlier calls too.
          part: episodes' worth of steps that the running ones have played.
        """
        self.finished = finished
        now, done = time.monotonic(), finished + part
        if self._began is None:
            self._began = now, done
        seconds, played = now - self._began[0], done - self._began[1]
        speed = _speed(played / seconds) if played > 0 and seconds > 0 else ""
        self._bar.update(self._task, completed=done, description=what, speed=speed)

    def close(self) -> None:
        """Removes the bar, before something else is shown."""
        self._bar.stop()

    def show_state(self, state: "State") -> None:
        """Shows the workers' state; an event such as a lost node is printed as a line."""
        if state.note:  # above the bar, or by itself where there is none
            self._bar.console.print(
                f"limberjack: {state.note}", markup=False, highlight=False, soft_wrap=True
            )
        self._bar.update(self._task, workers=str(state))


def _speed(per_second: float) -> str:
    """Episodes per second, or per minute if they are few."""
    if per_second >= 1:
        return f"{per_second:.1f} episodes/s"
    return f"{60 * per_second:.1f} episodes/min"


@contextlib.contextmanager
def show_units() -> Iterator[Units]:
    """A bar over the episodes that workers play while the context lasts."""
    columns = (
        rich.progress.MofNCompleteColumn(),
        "{task.fields[speed]}",
        rich.progress.TimeRemainingColumn(),
        "{task.fields[workers]}",
    )
    with progress_bar(*columns) as bar:
        yield Units(bar)


@contextlib.contextmanager
def units_reported(done: Callable[[Units], str]) -> Iterator[Units]:
    """A bar over episodes, with remarks after it, and one line on what ends the command early.

    Args:
      done: the number of episodes that are complete, and how to continue, in words.
    """
    with remarks_reported(), show_units() as bar, failures_reported(bar, lambda: done(bar)):
        yield bar


class Steps:
    """A bar over the control steps of a training or a film, with a return and the time left.

    Attributes:
      steps: all of them.
      finished: those that were taken, in earlier calls too; None before the first one.
    """

    def __init__(self, bar: rich.progress.Progress, what: str) -> None:
        """Adds the steps of what is done to a bar that is shown."""
        self._what = what
        self.steps = 0
        self.finished: int | None = None
        self._bar = bar
        self._updated = 0.0
        self._task = bar.add_task("loading", total=None, mean=0.0)

    def show(self, finished: int, steps: int, mean: float) -> None:
        """Shows progress; `mean` is the return so far, or the last one without exploration."""
        is_first, self.finished, self.steps = self.finished is None, finished, steps
        now = time.monotonic()
        if self._bar.disable or (now < self._updated + _UPDATE and finished != steps):
            return
        self._updated = now
        if is_first:  # the time left is not that of a run that took all steps just now
            self._bar.reset(self._task, total=steps, completed=finished, description=self._what)
        self._bar.update(self._task, completed=finished, mean=mean)


@contextlib.contextmanager
def show_steps(what: str) -> Iterator[Steps]:
    """A bar over the steps of a training or a film while the context lasts."""
    columns = "return {task.fields[mean]:.1f}", rich.progress.TimeRemainingColumn()
    with progress_bar("{task.percentage:.0f} %", *columns) as bar:
        yield Steps(bar, what)


@contextlib.contextmanager
def show_parts() -> Iterator[Callable[[str, float, float], None]]:
    """A bar over parts of a task, with the time left, while the context lasts.

    It is redrawn only on a call, which has the part that begins, the number of parts that have
    finished and that of all: a thread that redraws it would disturb measurements of time.
    """
    columns = "{task.percentage:.0f} %", rich.progress.TimeRemainingColumn()
    with progress_bar(*columns, auto_refresh=False) as bar:
        task = bar.add_task("starting", total=None)
        bar.refresh()

        def show(part: str, finished: float, parts: float) -> None:
            bar.update(task, description=part, completed=finished, total=parts)
            bar.refresh()

        yield show
