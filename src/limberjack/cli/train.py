"""`limberjack train`: a policy that one command learns, and continues to learn after a kill."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.datasets import reading_reported
from limberjack.cli.options import (
    EnvironmentName,
    Faults,
    OptionalDomain,
    RequiredOut,
    TaskName,
    named_environment,
    world_named,
)
from limberjack.cli.output import complain, failures_reported, misuse_reported, remarks_reported
from limberjack.cli.process import command_line
from limberjack.cli.progress import Steps, show_steps

if TYPE_CHECKING:
    from limberjack.data import Dataset
    from limberjack.training import Run, Settings

__all__: list[str] = []

_LAST_SEED = 999_999

_Steps = Annotated[
    int | None,
    typer.Option(
        metavar="N", min=1, help="Control steps, over all rows; by default those of the settings."
    ),
]
_Seed = Annotated[
    int,
    typer.Option(
        metavar="N", min=0, max=_LAST_SEED, help="Of the networks, the exploration and the starts."
    ),
]
_Config = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Settings in TOML, in the place of the domain's row of the table."
    ),
]
_Demonstrations = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="A dataset of the task, as `collect` writes it: half of each batch is drawn from it.",
    ),
]


@command(
    "train",
    "limberjack train cartpole swingup --out cartpole",
    "limberjack train walker walk --faults easy --out faulty",
    "limberjack train --env my_tasks:make --config mine.toml --out mine",
)
def _train(
    domain: OptionalDomain = None,
    task: TaskName = None,
    *,
    out: RequiredOut,
    env: EnvironmentName = None,
    steps: _Steps = None,
    seed: _Seed = 0,
    config: _Config = None,
    demonstrations: _Demonstrations = None,
    faults: Faults = None,
) -> None:
    """Train a policy with CrossQ, and write it to DIR/policy.safetensors.

    Ten episodes are played without exploration every twentieth of the run; their returns are in
    DIR/curve.csv, and TensorBoard shows DIR. At the end DIR/curve.png shows them beside the runs
    that the bundled policy is from. The same command continues a run that was killed, and reports
    one that has finished.
    """
    with misuse_reported():
        where = named_environment(domain, task, env)
        world = world_named(env, faults)
        settings = _settings(config)
    with (
        reading_reported("train"),
        remarks_reported(),
        show_steps("training") as progress,
        failures_reported(progress, lambda: _done(progress, out)),
    ):
        from limberjack.training import train

        run = train(
            *where,
            out=out,
            steps=steps,
            seed=seed,
            settings=settings,
            on_progress=progress.show,
            command=command_line(),
            world=world,
            demonstrations=_dataset(demonstrations),
        )
    _print(run)


def _settings(config: Path | None) -> "Settings | None":
    """The settings in a file; None without one."""
    if config is None:
        return None
    from limberjack.training import read_settings

    return read_settings(config)


def _dataset(folder: Path | None) -> "Dataset | None":
    """The dataset in a folder; None without one."""
    if folder is None:
        return None
    from limberjack import data

    return data.load(folder)


def _done(progress: Steps, out: Path) -> str:
    """The number of steps so far, and how to continue."""
    then = f"the same command continues from the last checkpoint in {out}"
    if progress.finished is None:  # a checkpoint may have been read, or not
        return then
    return f"{progress.finished:,} of {progress.steps:,} control steps are done: {then}"


def _print(run: "Run") -> None:
    last = run.curve[-1]
    typer.echo(
        f"{'finished earlier' if run.was_finished else 'finished'}: return {last.mean:.1f} "
        f"({min(last.returns):.1f} to {max(last.returns):.1f}) over {len(last.returns)} episodes, "
        f"after {last.control_steps:,} control steps and {last.processor_seconds:,.0f} seconds of "
        "one processor core"
    )
    if run.left_out is not None:
        complain(run.left_out)
    typer.echo(run.policy)
    if run.picture is not None:
        typer.echo(run.picture)
