"""`limberjack evaluate`: scores of a policy, beside zero and random actions on the same seeds."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    ActionRepeat,
    AnyProcessor,
    EnvironmentName,
    Episodes,
    OptionalDomain,
    Out,
    PolicyName,
    Ray,
    Seeds,
    Shard,
    TaskName,
    Threads,
    TimeLimit,
    Vectorised,
    Workers,
    chosen_seeds,
    named_environment,
    shard_named,
)
from limberjack.cli.output import (
    add_summaries,
    complain,
    console,
    failures_reported,
    misuse_reported,
    remarks_reported,
    search_working_directory,
    summaries_table,
)
from limberjack.cli.process import command_line
from limberjack.cli.progress import Units, show_units

if TYPE_CHECKING:
    from limberjack.evaluation import Evaluation

__all__: list[str] = []

_EPISODES = 100  # by default


@command(
    "evaluate",
    "limberjack evaluate stacker stack_2 --policy my_policies:Still --seeds 0:50",
    "limberjack evaluate humanoid/walk --policy sb3:walk.zip --out scores",
)
def _evaluate(
    domain: OptionalDomain = None,
    task: TaskName = None,
    env: EnvironmentName = None,
    policy: PolicyName = "zero",
    seeds: Seeds = None,
    episodes: Episodes = None,
    out: Out = None,
    threads: Threads = None,
    time_limit: TimeLimit = None,
    action_repeat: ActionRepeat = None,
    workers: Workers = None,
    ray: Ray = None,
    shard: Shard = None,
    any_processor: AnyProcessor = False,
    vectorised: Vectorised = None,
) -> None:
    """Measure the returns of a policy: mean with its interval, median and success rate.

    Episode k is the first episode of an environment with the k-th seed. Zero and random actions
    are measured on the same seeds, and all of it for each kind of start.

    With --out every episode is written as it ends, and the same command continues an evaluation
    that was killed. The planner plays one episode per core, unless --threads is given.
    """
    with misuse_reported():
        where = named_environment(domain, task, env, time_limit)
        chosen = chosen_seeds(seeds, episodes, _EPISODES)
        part = shard_named(shard, out)
    search_working_directory(policy)
    with (
        remarks_reported(),
        show_units() as progress,
        failures_reported(progress, lambda: _done(progress, out)),
    ):
        from limberjack.evaluation import evaluate

        progress.begin(_count(chosen, part, policy))
        evaluation = evaluate(
            *where,
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
            vectorised=vectorised,
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
