"""`limberjack collect`: a policy's episodes, in files that anyone can make again."""

import enum
import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from limberjack.cli.app import command
from limberjack.cli.datasets import print_information, reading_reported
from limberjack.cli.options import (
    ActionRepeat,
    AnyProcessor,
    Appearance,
    Camera,
    EnvironmentName,
    Episodes,
    Faults,
    OptionalDomain,
    PolicyName,
    Ray,
    Seeds,
    Shard,
    TaskName,
    TaskSet,
    Threads,
    TimeLimit,
    Vectorised,
    Workers,
    camera_named,
    chosen_seeds,
    named_environment,
    refuse_beside,
    shard_named,
    world_named,
)
from limberjack.cli.output import misuse_reported, search_working_directory
from limberjack.cli.process import command_line
from limberjack.cli.progress import Units, units_reported

if TYPE_CHECKING:
    from limberjack.rl.pixels import Pixels
    from limberjack.workers.factories import Make

__all__: list[str] = []

_SET = "--set, which names the tasks: leave it out"
_EPISODES = 100  # by default
_MINARI = "minari"  # the folder, within --out, of a dataset in Minari's format


class _Format(enum.StrEnum):
    """The format of a dataset."""

    PARQUET = "parquet"
    MINARI = "minari"


_DatasetOut = Annotated[
    str,  # a Path would take a slash from a URL
    typer.Option(
        metavar="DIR",
        help="Write the dataset into this folder, or to a URL such as s3://bucket/walk.",
    ),
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
_Pixels = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Keep a picture of N by N pixels of each step, too."),
]
_FileMb = Annotated[
    float,
    typer.Option(
        metavar="N",
        help="Megabytes of a file before compression; it fixes the number of seeds of a file.",
    ),
]
_Repair = Annotated[
    bool,
    typer.Option(
        "--repair", help="First move damaged files into DIR/damaged; they are then made again."
    ),
]
_Film = Annotated[
    bool,
    typer.Option(
        "--film", help="Draw a picture and a film of the median episode for the dataset's card."
    ),
]
_FormatName = Annotated[
    _Format, typer.Option(help="Besides Parquet files: a Minari dataset in DIR/minari.")
]


@command(
    "collect",
    "limberjack collect humanoid walk --policy random --seeds 0:640 --out walk",
    "limberjack collect stacker/stack_2 --policy planner --seeds 0:9 --out towers",
    "limberjack collect --set dmc-sparse --policy random --out sparse",
)
def _collect(
    domain: OptionalDomain = None,
    task: TaskName = None,
    *,
    out: _DatasetOut,
    env: EnvironmentName = None,
    task_set: TaskSet = None,
    policy: PolicyName = "zero",
    seeds: Seeds = None,
    episodes: Episodes = None,
    states: _States = False,
    float32: _Float32 = False,
    flat: _Flat = False,
    pixels: _Pixels = None,
    camera: Camera = None,
    file_mb: _FileMb = 100.0,
    repair: _Repair = False,
    film: _Film = False,
    format: _FormatName = _Format.PARQUET,
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
    """Collect the episodes of a policy into Parquet files, in the folder episodes of DIR.

    Episode k is the first episode of an environment with the k-th seed. The same command gives the
    same bytes; it continues a collection that was killed, and other seeds add to the folder. With
    --set each task has a dataset of its own, in DIR/DOMAIN-TASK.
    """
    with misuse_reported():
        if task_set is not None:
            refuse_beside({"DOMAIN": domain, "--env": env}, _SET)
        where = None if task_set else named_environment(domain, task, env, time_limit)
        chosen = chosen_seeds(seeds, episodes, _EPISODES)
        part, world = shard_named(shard, out), world_named(env, faults, appearance)
        pictures = _pictures(pixels, camera)
        search_working_directory(policy)
    _check_extras(format, out, env)
    with units_reported(lambda progress: _done(progress, out)) as progress:
        progress.begin(_count(task_set, chosen, part))
        folders = _play(
            where,
            task_set,
            policy,
            chosen,
            out=out,
            keep=(states, float32, flat, pictures),
            file_mb=file_mb,
            repair=repair,
            film=film,
            time_limit=time_limit,
            action_repeat=action_repeat,
            num_threads=threads,
            workers=workers,
            ray=ray,
            shard=part,
            any_processor=any_processor,
            vectorised=vectorised,
            world=world,
            progress=progress,
        )
    if part is not None:
        typer.echo(f"shard {shard} is complete in {out}")
    for folder in [] if part else folders:
        _finish(folder, format)


def _check_extras(format: _Format, out: str, env: str | None) -> None:
    """Reports a missing extra, or what a format cannot have, before anything is played."""
    with reading_reported("collect"):
        from limberjack.episodes.places import place_of

        importlib.import_module("limberjack.data")
        if not isinstance(place_of(out), Path) and format is _Format.MINARI:
            raise ValueError(f"--out is the URL {out}, and --format minari needs a folder")
        if env is not None and format is _Format.MINARI:
            raise ValueError(
                f"got --env {env} and --format minari, whose datasets name an environment that "
                "Gymnasium makes by its id: leave out --format, and convert --to lerobot"
            )
        if format is _Format.MINARI:
            importlib.import_module("limberjack.episodes.to_minari")


def _pictures(size: int | None, camera: str | None) -> "Pixels | None":
    """The pictures to keep; raises ValueError for a camera without any."""
    if size is not None:
        from limberjack.rl.pixels import Pixels

        return Pixels(0 if camera is None else camera_named(camera), size, size)
    if camera is not None:
        raise ValueError(f"--camera is {camera}, and no pictures are kept: add --pixels 84")
    return None


def _count(task_set: str | None, seeds: Sequence[int], part: tuple[int, int] | None) -> int:
    """The number of episodes of all tasks."""
    from limberjack.registry.sets import tasks_of
    from limberjack.workers import shard_of

    of_one = len(seeds if part is None else shard_of(seeds, part))
    return of_one if task_set is None else of_one * len(tasks_of(task_set))


def _play(
    where: "tuple[str | Make, str | None] | None",
    task_set: str | None,
    policy: str,
    seeds: Sequence[int],
    keep: tuple[bool, bool, bool, "Pixels | None"],
    progress: Units,
    **kwargs: Any,  # of `collect`
) -> list[str]:
    """Collects the dataset of a task, or of each task of a set; returns their folders."""
    from limberjack import data
    from limberjack.episodes.places import absolute

    kwargs |= {"kept": data.Kept(*keep), "command": command_line()}
    kwargs |= {"on_progress": progress.show, "on_state": progress.show_state}
    if task_set is not None:
        return [*map(str, data.collect_set(task_set, policy, seeds, **kwargs).values())]
    assert where is not None
    folder = str(absolute(kwargs["out"]))
    data.collect(*where, policy, seeds, **kwargs)
    return [folder]


def _finish(out: str, format: _Format) -> None:
    """Converts the dataset if that is wanted, and prints its figures."""
    with reading_reported("collect"):
        from limberjack import data

        dataset = data.load(out)
        information = data.inform(dataset)
        if format is _Format.MINARI:
            from limberjack.episodes.to_minari import to_minari

            to_minari(dataset, Path(out) / _MINARI)
    print_information(information)


def _done(progress: Units, out: str) -> str:
    """The number of episodes that are complete, and how to continue."""
    done = f"{progress.finished or 0} of {progress.episodes} episodes are in {out}"
    return f"{done}: the same command continues from there"
