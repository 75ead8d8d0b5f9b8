"""`limberjack collect`: a policy's episodes, in files that anyone can make again."""

import contextlib
import enum
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from limberjack.cli.app import command
from limberjack.cli.datasets import print_information, reading_reported
from limberjack.cli.options import (
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
    complain,
    misuse_reported,
    search_working_directory,
    users_failure,
    worded,
)
from limberjack.cli.progress import Units, show_units
from limberjack.cli.typed import command_line

__all__: list[str] = []

_MINARI = "minari"  # the folder, within --out, of a dataset in Minari's format


class _Format(enum.StrEnum):
    """The format of a dataset."""

    PARQUET = "parquet"
    MINARI = "minari"


_Out = Annotated[
    Path,
    typer.Option(metavar="DIR", help="Write the files here; those that are there are kept."),
]
_Seeds = Annotated[
    str, typer.Option(metavar="A:B", help="One episode for each seed from A to B-1.")
]
_States = Annotated[
    bool, typer.Option("--states", help="Keep MuJoCo's full state of each step, too.")
]
_Float32 = Annotated[
    bool, typer.Option("--float32", help="Keep observations as float32; actions are float64.")
]
_Flat = Annotated[
    bool, typer.Option("--flat", help="Join the observations of a step into one array.")
]
_FileMb = Annotated[
    float,
    typer.Option(
        metavar="N",
        help="Megabytes of a file before compression; it fixes the number of seeds of a file.",
    ),
]
_FormatName = Annotated[
    _Format, typer.Option(help="Besides Parquet files: a Minari dataset in DIR/minari.")
]
_Threads = Annotated[
    int | None,
    typer.Option(
        min=1, help="Threads that step the batch, or of each worker; by default all cores."
    ),
]


@command(
    "collect",
    "limberjack collect humanoid walk --policy random --seeds 0:640 --out walk",
    "limberjack collect stacker/stack_2 --policy planner --seeds 0:9 --out towers",
)
def _collect(
    domain: Domain,
    task: TaskName = None,
    *,
    out: _Out,
    seeds: _Seeds = "0:100",
    policy: PolicyName = "zero",
    states: _States = False,
    float32: _Float32 = False,
    flat: _Flat = False,
    file_mb: _FileMb = 100.0,
    format: _FormatName = _Format.PARQUET,
    threads: _Threads = None,
    time_limit: TimeLimit = None,
    workers: Workers = None,
    ray: Ray = None,
    shard: Shard = None,
    any_processor: AnyProcessor = False,
) -> None:
    """Collect the episodes of a policy into Parquet files, in the folder episodes of DIR.

    Episode k is the first episode of an environment with the k-th seed. The same command gives the
    same bytes; it continues a collection that was killed, and other seeds add to the folder.
    """
    with misuse_reported():
        where = named_task(domain, task)
        chosen = seeds_of(seeds)
        part = shard_named(shard, out)
    search_working_directory(policy)
    with reading_reported("collect"):
        from limberjack import data

        if format is _Format.MINARI:
            importlib.import_module("limberjack.data.to_minari")  # raises if its extra is missing
        kept = data.Kept(states, float32, flat)
    who = {"num_threads": threads, "workers": workers, "ray": ray, "any_processor": any_processor}
    how = {"kept": kept, "file_mb": file_mb, "time_limit": time_limit, **who}
    _play((*where, policy, chosen), out, part, **how)
    if part is not None:
        typer.echo(f"shard {shard} is complete in {out}")
        return
    _finish(out, format)


# Arguments of `data.collect`, which checks them.
def _play(
    what: tuple[str, str, str, range], out: Path, part: tuple[int, int] | None, **how: Any
) -> None:
    """Collects the episodes, with a progress bar."""
    with show_units() as progress, _failures_reported(progress, out):
        from limberjack import data
        from limberjack.workers import shard_of

        seeds = what[-1]
        progress.begin(len(seeds if part is None else shard_of(seeds, *part)))
        data.collect(
            *what,
            out=out,
            shard=part,
            on_progress=progress.show,
            on_state=progress.show_state,
            command=command_line(),
            **how,
        )


def _finish(out: Path, format: _Format) -> None:
    """Converts the dataset if that is wanted, and prints its figures."""
    with reading_reported("collect"):
        from limberjack import data

        dataset = data.load(out)
        information = data.inform(dataset)
        if format is _Format.MINARI:
            from limberjack.data.to_minari import to_minari

            to_minari(dataset, out / _MINARI)
    print_information(information)


@contextlib.contextmanager
def _failures_reported(progress: Units, out: Path) -> Iterator[None]:
    """Turns an error or interrupt into one line and an exit status."""
    from limberjack.policies import PolicyError
    from limberjack.workers import WorkError

    try:
        yield
    except KeyboardInterrupt:
        complain(f"interrupted: {_done(progress, out)}")
        raise typer.Exit(INTERRUPTED) from None
    except (PolicyError, OSError, WorkError) as error:
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


def _done(progress: Units, out: Path) -> str:
    """The number of episodes that are complete, and how to continue."""
    done = f"{progress.finished or 0} of {progress.episodes} episodes are in {out}"
    return f"{done}: the same command continues from there"
