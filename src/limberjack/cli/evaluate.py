"""`limberjack evaluate`: scores of a policy, beside zero and random actions on the same seeds."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    ActionRepeat,
    AnyProcessor,
    Domain,
    PolicyName,
    Ray,
    Shard,
    TaskName,
    TimeLimit,
    Workers,
    named_task,
    seeds_of,
    shard_named,
)
from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    MISUSED,
    SEEDS,
    complain,
    console,
    misuse_reported,
    rows_reported,
    search_working_directory,
    users_failure,
    worded,
)
from limberjack.cli.progress import Units, show_units
from limberjack.cli.summaries import add_summaries, summaries_table
from limberjack.cli.typed import command_line

if TYPE_CHECKING:
    from limberjack.evaluation import Evaluation

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
_Out = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Keep results here, and continue those that are there."),
]
_Threads = Annotated[
    int | None,
    typer.Option(
        min=1, help="Threads that step the batch, or of each worker; by default all cores."
    ),
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
    out: _Out = None,
    threads: _Threads = None,
    time_limit: TimeLimit = None,
    action_repeat: ActionRepeat = None,
    workers: Workers = None,
    ray: Ray = None,
    shard: Shard = None,
    any_processor: AnyProcessor = False,
) -> None:
    """Measure the returns of a policy: mean with its interval, median and success rate.

    Episode k is the first episode of an environment with the k-th seed. Zero and random actions
    are measured on the same seeds, and all of it for each kind of start.

    With --out every episode is written as it ends, and the same command continues an evaluation
    that was killed. The planner plays one episode per core, unless --threads is given.
    """
    with misuse_reported():
        domain, task = named_task(domain, task)
        chosen = _chosen_seeds(seeds, episodes)
        part = shard_named(shard, out)
    search_working_directory(policy)
    with rows_reported(), show_units() as progress, _failures_reported(progress, out):
        from limberjack.evaluation import evaluate

        progress.begin(_count(chosen, part, policy))
        evaluation = evaluate(
            domain,
            task,
            policy,
            chosen,
            out=out,
            num_threads=threads,
            time_limit=time_limit,
            action_repeat=action_repeat,
            workers=workers,
            ray=ray,
            shard=part,
            any_processor=any_processor,
            on_progress=progress.show,
            on_state=progress.show_state,
            command=command_line(),
        )
    _print(evaluation) if shard is None else _print_shard(shard, progress.episodes, out)


def _count(seeds: range, shard: tuple[int, int] | None, policy: str) -> int:
    """The number of episodes to play, those of the baselines included."""
    from limberjack.evaluation import FLOORS
    from limberjack.workers import shard_of

    mine = seeds if shard is None else shard_of(seeds, *shard)
    return len(mine) * len({policy, *FLOORS})


def _chosen_seeds(seeds: str | None, episodes: int | None) -> range:
    """The seeds given by their range, their number, or both.

    Raises:
      ValueError: they are not a range, an empty one, or fewer than the episodes.
    """
    if seeds is None:
        return range(_EPISODES if episodes is None else episodes)
    chosen = seeds_of(seeds)
    if episodes is not None and episodes > len(chosen):
        raise ValueError(
            f"--episodes is {episodes}, but --seeds {seeds} holds {len(chosen)}: give more seeds"
        )
    return chosen[:episodes]


@contextlib.contextmanager
def _failures_reported(progress: Units, out: Path | None) -> Iterator[None]:
    """Turns an error or interrupt into one line and an exit status."""
    from limberjack.policies import PolicyError
    from limberjack.rl.control import PhysicsError
    from limberjack.workers import WorkError

    try:
        yield
    except KeyboardInterrupt:
        complain(f"interrupted: {_done(progress, out)}")
        raise typer.Exit(INTERRUPTED) from None
    except (PolicyError, PhysicsError, WorkError, OSError) as error:
        if progress.finished is None:
            complain(error)
            raise typer.Exit(MISUSED) from None
        complain(f"{worded(error)}; {_done(progress, out)}")
        raise typer.Exit(FAILED) from None
    except Exception as error:
        if progress.finished is None and isinstance(error, ValueError):
            complain(error)
            raise typer.Exit(MISUSED) from None
        failure = users_failure(error)
        if failure is not None and progress.finished is None:
            complain(failure)
            raise typer.Exit(MISUSED) from None
        if failure is not None:
            complain(f"{failure}; {_done(progress, out)}")
            raise typer.Exit(FAILED) from None
        if progress.finished is not None:
            error.add_note(f"limberjack: {_done(progress, out)}")
        raise


def _done(progress: Units, out: Path | None) -> str:
    """The number of episodes that finished, and how to continue."""
    done = f"{progress.finished or 0} of {progress.episodes} episodes finished"
    if out is None:
        return f"{done}; with --out they would have been kept"
    return f"{done}, and are kept in {out}: the same command continues from there"


def _print(evaluation: "Evaluation") -> None:
    rows = summaries_table("policy")
    for policy in evaluation.scores:
        add_summaries(rows, policy, evaluation.summary(policy), evaluation.strata(policy))
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


def _print_shard(shard: str, episodes: int, out: Path | None) -> None:
    typer.echo(
        f"shard {shard}: {episodes} episodes are kept in {out}; the same command without --shard "
        "joins all shards"
    )
