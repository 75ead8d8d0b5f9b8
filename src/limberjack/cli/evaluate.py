"""`limberjack evaluate`: scores of a policy, beside zero and random actions on the same seeds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    ActionRepeat,
    AnyProcessor,
    Appearance,
    EnvironmentName,
    Episodes,
    Faults,
    OptionalDomain,
    Out,
    Ray,
    Seeds,
    Shard,
    TaskName,
    TaskSet,
    Threads,
    TimeLimit,
    Vectorised,
    Workers,
    chosen_seeds,
    named_environment,
    refuse_beside,
    shard_named,
    world_named,
)
from limberjack.cli.output import (
    add_summaries,
    complain,
    console,
    misuse_reported,
    search_working_directory,
    summaries_table,
    table,
    visible,
)
from limberjack.cli.process import command_line
from limberjack.cli.progress import Units, units_reported

if TYPE_CHECKING:
    from limberjack.evaluation import Evaluation
    from limberjack.evaluation.protocol import SetEvaluation
    from limberjack.worlds import World

__all__: list[str] = []

_EPISODES = 100  # by default

_Policies = Annotated[
    list[str] | None,
    typer.Option(
        "--policy",
        metavar="NAME",
        help="What acts: zero, random, planner, pretrained, MODULE:CALLABLE, or a file: mlp:PATH, "
        "onnx:PATH, sb3:PATH. "
        "With --set, {domain} and {task} stand for those of each task, and each --policy is a run.",
        show_default="zero",
    ),
]


@command(
    "evaluate",
    "limberjack evaluate stacker stack_2 --policy my_policies:Still --seeds 0:50",
    "limberjack evaluate humanoid/walk --policy sb3:walk.zip --out scores",
    "limberjack evaluate --set dmc28 --policy my_policies:Learned --out scores",
)
def _evaluate(
    domain: OptionalDomain = None,
    task: TaskName = None,
    env: EnvironmentName = None,
    task_set: TaskSet = None,
    policy: _Policies = None,
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
    faults: Faults = None,
    appearance: Appearance = None,
) -> None:
    """Measure the returns of a policy: mean with its interval, median and success rate.

    Episode k is the first episode of an environment with the k-th seed. Zero and random actions
    are measured on the same seeds, and all of it for each kind of start.

    With --set, seeds, episodes and action repeat are those of a protocol with a version. With --out
    every episode is written as it ends, and the same command continues an evaluation
    that was killed. The planner plays one episode per core, unless --threads is given.
    """
    names = policy or ["zero"]
    if task_set is not None:
        with misuse_reported():
            _check_fixed(domain, env, seeds, episodes, time_limit, action_repeat, shard, vectorised)
            world = world_named(None, faults, appearance)
        _evaluate_set(task_set, names, out, threads, workers, ray, any_processor, world)
        return
    with misuse_reported():
        where = named_environment(domain, task, env, time_limit)
        chosen = chosen_seeds(seeds, episodes, _EPISODES)
        part, name = shard_named(shard, out), _only(names)
        world = world_named(env, faults, appearance)
    search_working_directory(name)
    with units_reported(lambda progress: _done(progress, out)) as progress:
        from limberjack.evaluation import evaluate

        progress.begin(_count(chosen, part, name))
        evaluation = evaluate(
            *where,
            name,
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
            world=world,
            on_progress=progress.show,
            on_state=progress.show_state,
            command=command_line(),
        )
    _print(evaluation) if shard is None else _print_shard(shard, progress.episodes, out)


# The arguments that --set fixes, in the order in which `_check_fixed` takes them.
_FIXED = (
    "DOMAIN",
    "--env",
    "--seeds",
    "--episodes",
    "--time-limit",
    "--action-repeat",
    "--shard",
    "--vectorised",
)


def _check_fixed(*values: object) -> None:
    """Raises ValueError if an argument is given that --set fixes."""
    given: dict[str, object] = dict(zip(_FIXED, values, strict=True))
    refuse_beside(given, "--set, which fixes them: leave it out")


def _only(names: list[str]) -> str:
    """The policy; raises ValueError if there are several."""
    if len(names) > 1:
        raise ValueError(f"got {len(names)} policies; expected one --policy, or --set NAME")
    return names[0]


def _evaluate_set(
    task_set: str,
    names: list[str],
    out: Path | None,
    threads: int | None,
    workers: int | None,
    ray: str | None,
    any_processor: bool,
    world: "World | None",
) -> None:
    """Measures one or more runs on all tasks of a set, and prints the scores."""
    with units_reported(lambda progress: _done(progress, out)) as progress:
        from limberjack.evaluation.protocol import episodes_of, evaluate_set

        for name in names:
            search_working_directory(name)
        progress.begin(episodes_of(task_set, names))
        found = evaluate_set(
            task_set,
            names,
            out=out,
            num_threads=threads,
            workers=workers,
            ray=ray,
            any_processor=any_processor,
            world=world,
            on_progress=progress.show,
            on_state=progress.show_state,
            command=command_line(),
        )
    _print_set(found)


def _print_set(found: "SetEvaluation") -> None:
    several = len(found.runs) > 1
    spread = ("lowest run>", "highest run>") if several else ()
    rows = table(
        "task", "return>", *spread, "score>", "zero>", "random>", "repeat>", "agent steps>"
    )
    for one in found.tasks:
        mean = sum(one.returns) / len(one.returns)
        bounds = (f"{min(one.returns):.1f}", f"{max(one.returns):.1f}") if several else ()
        rows.add_row(
            visible(f"{one.domain} {one.task}"),
            f"{mean:.1f}",
            *bounds,
            f"{sum(one.scores) / len(one.scores):.3f}",
            *(f"{one.floors[floor]:.1f}" for floor in ("zero", "random")),
            _range(one.action_repeats),
            _range(one.agent_steps),
        )
    console().print(rows)
    for (domain, task), reason in found.missing.items():
        typer.echo(visible(f"missing: {domain} {task}: {reason}"))
    for line in _set_lines(found):
        typer.echo(line)
    for path in found.files:
        typer.echo(path)


def _range(numbers: tuple[int, ...]) -> str:
    low, high = min(numbers), max(numbers)
    return str(low) if low == high else f"{low} to {high}"


def _set_lines(found: "SetEvaluation") -> list[str]:
    """The aggregate score, and what it is."""
    runs = "1 run" if len(found.runs) == 1 else f"{len(found.runs)} runs"
    tasks = f"{len(found.tasks)} of {len(found.set.tasks)} tasks of {found.set.name}"
    interval = found.interval
    bounds = "" if interval is None else " ({:.3f} to {:.3f})".format(*interval)
    lines = [
        f"{tasks}, {runs}: interquartile mean of the scores {found.interquartile_mean:.3f}{bounds}",
        "score: return / 1000"
        + ("" if interval is None else "; interval: 95 %, by stratified bootstrap over runs"),
    ]
    if len(found.runs) > 1:
        shares = ", ".join(f"{at} %: {value:.3f}" for at, value in found.percentiles.items())
        lines.insert(1, f"percentiles of the runs' mean scores: {shares}")
    return lines


def _count(seeds: range, shard: tuple[int, int] | None, policy: str) -> int:
    """The number of episodes to play, those of the baselines included."""
    from limberjack.evaluation import FLOORS
    from limberjack.workers import shard_of

    mine = seeds if shard is None else shard_of(seeds, shard)
    return len(mine) * len({policy, *FLOORS})


def _done(progress: Units, out: Path | None) -> str:
    """The number of episodes that finished, and how to continue."""
    if progress.finished is None:
        return "no episode was played; finished ones of earlier calls stay where they are"
    done = f"{progress.finished} of {progress.episodes} episodes finished"
    if out is None:
        return f"{done}; with --out they would have been kept"
    return f"{done}, and are kept in {out}: the same command continues from there"


def _print(evaluation: "Evaluation") -> None:
    from limberjack.episodes.statistics import LAST_STEPS, SUCCESS_REWARD

    rows = summaries_table()
    for policy in evaluation.scores:
        add_summaries(rows, policy, evaluation.summary(policy), evaluation.strata(policy))
    console().print(rows)
    typer.echo(
        f"success: a mean reward of at least {SUCCESS_REWARD} over the last "
        f"{LAST_STEPS} steps; interval: of the mean, by bootstrap"
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
