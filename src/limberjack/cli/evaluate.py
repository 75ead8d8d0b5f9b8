"""`limberjack evaluate`: scores of a policy, beside zero and random actions on the same seeds."""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import rich.progress
import rich.table
import typer

from limberjack.cli.app import command
from limberjack.cli.options import Domain, PolicyName, TaskName, TimeLimit, named_task
from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    MISUSED,
    SEEDS,
    complain,
    console,
    misuse_reported,
    search_working_directory,
    table,
)
from limberjack.cli.progress import progress_bar
from limberjack.cli.typed import command_line

if TYPE_CHECKING:
    from limberjack.evaluation import Evaluation, Summary

__all__: list[str] = []

_EPISODES = 100  # by default

_Seeds = Annotated[
    str | None,
    typer.Option(metavar="A:B", help="One episode for each seed from A to B-1; 0:100 by default."),
]
_Episodes = Annotated[
    int | None,
    typer.Option(min=1, max=SEEDS, help="The first seeds only; without --seeds, those from 0 on."),
]


@command(
    "evaluate",
    "limberjack evaluate stacker stack_2 --policy my_policies:Still --seeds 0:50",
    "limberjack evaluate humanoid/walk --policy sb3:walk.zip --out scores",
)
def _evaluate(
    domain: Domain,
    task: TaskName = None,
    policy: PolicyName = "zero",
    seeds: _Seeds = None,
    episodes: _Episodes = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Keep results here, and continue those that are there."),
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option(min=1, help="Threads that step the batch; all usable cores by default."),
    ] = None,
    time_limit: TimeLimit = None,
) -> None:
    """Measure the returns of a policy: mean with its interval, median and success rate.

    Episode k is the first episode of an environment with the k-th seed. Zero and random actions
    are measured on the same seeds, and all of it for each kind of start.

    With --out every episode is written as it ends, and the same command continues an evaluation
    that was killed.
    """
    with misuse_reported():
        domain, task = named_task(domain, task)
        chosen = _chosen_seeds(seeds, episodes)
    search_working_directory(policy)
    with _progress(len(chosen), policy) as progress, _failures_reported(progress, out):
        from limberjack.evaluation import evaluate

        evaluation = evaluate(
            domain,
            task,
            policy,
            chosen,
            out=out,
            num_threads=threads,
            time_limit=time_limit,
            on_progress=progress.show,
            command=command_line(),
        )
    _print(evaluation)


class _Progress:
    """A bar over the episodes of all policies, which counts those that have finished."""

    def __init__(self, bar: rich.progress.Progress, episodes: int) -> None:
        self.episodes = episodes
        self.finished: int | None = None  # None: no episode has begun
        self._bar = bar
        self._task = bar.add_task("loading", total=episodes)

    def show(self, policy: str, finished: int, part: float) -> None:
        self.finished = finished
        self._bar.update(self._task, completed=finished + part, description=policy)


@contextlib.contextmanager
def _progress(episodes: int, policy: str) -> Iterator[_Progress]:
    from limberjack.evaluation import FLOORS

    columns = rich.progress.MofNCompleteColumn(), rich.progress.TimeRemainingColumn()
    with progress_bar(*columns) as bar:
        yield _Progress(bar, episodes * len({policy, *FLOORS}))


def _chosen_seeds(seeds: str | None, episodes: int | None) -> range:
    """The seeds given by their range, their number, or both.

    Raises:
      ValueError: they are not a range, an empty one, or fewer than the episodes.
    """
    if seeds is None:
        return range(_EPISODES if episodes is None else episodes)
    found = re.fullmatch(r"(\d+):(\d+)", seeds)
    if found is None:
        raise ValueError(f"--seeds is {seeds!r}; expected A:B, such as 0:100 for the first hundred")
    chosen = range(int(found[1]), int(found[2]))
    if not chosen:
        raise ValueError(f"--seeds is {seeds}, which holds no seed; expected A:B with A below B")
    if chosen[-1] >= SEEDS:
        raise ValueError(f"--seeds is {seeds}; expected numbers up to {SEEDS}")
    if episodes is not None and episodes > len(chosen):
        raise ValueError(
            f"--episodes is {episodes}, but --seeds {seeds} holds {len(chosen)}: give more seeds"
        )
    return chosen[:episodes]


@contextlib.contextmanager
def _failures_reported(progress: _Progress, out: Path | None) -> Iterator[None]:
    """Turns an error or interrupt into one line and an exit status."""
    from limberjack.policies import PolicyError
    from limberjack.rl.control import PhysicsError

    try:
        yield
    except KeyboardInterrupt:
        complain(f"interrupted: {_done(progress, out)}")
        raise typer.Exit(INTERRUPTED) from None
    except (PolicyError, PhysicsError, OSError) as error:
        if progress.finished is None:
            complain(error)
            raise typer.Exit(MISUSED) from None
        complain(f"{error}; {_done(progress, out)}")
        raise typer.Exit(FAILED) from None
    except Exception as error:
        if progress.finished is None and isinstance(error, ValueError):
            complain(error)
            raise typer.Exit(MISUSED) from None
        if progress.finished is not None:  # a policy's own error, which its traceback locates
            error.add_note(f"limberjack: {_done(progress, out)}")
        raise


def _done(progress: _Progress, out: Path | None) -> str:
    """The number of episodes that finished, and how to continue."""
    done = f"{progress.finished or 0} of {progress.episodes} episodes finished"
    if out is None:
        return f"{done}; with --out they would have been kept"
    return f"{done}, and are kept in {out}: the same command continues from there"


def _print(evaluation: "Evaluation") -> None:
    rows = table("policy", "start", "episodes>", "mean>", "95 % interval>", "median>", "success>")
    for policy in evaluation.scores:
        _add_row(rows, policy, "", evaluation.summary(policy))
        for start, summary in evaluation.strata(policy).items():
            _add_row(rows, "", start, summary)
        rows.add_section()
    console().print(rows)
    success = evaluation.facts["success"]
    typer.echo(
        f"success: a mean reward of at least {success['mean_reward_at_least']} over the last "
        f"{success['last_steps']} steps; interval: of the mean, by bootstrap"
    )
    if evaluation.left_out is not None:
        complain(evaluation.left_out)
    for path in evaluation.files:
        typer.echo(path)


def _add_row(rows: rich.table.Table, policy: str, start: str, summary: "Summary") -> None:
    interval = ""
    if summary.interval is not None:
        interval = "{:.1f} to {:.1f}".format(*summary.interval)
    rows.add_row(
        policy,
        start,
        str(summary.episodes),
        f"{summary.mean:.1f}",
        interval,
        f"{summary.median:.1f}",
        f"{100 * summary.success_rate:.1f} %",
    )
