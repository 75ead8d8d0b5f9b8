"""`limberjack info`, `replay` and `convert`: the commands on a dataset, and what they share."""

import contextlib
import enum
import json as json_module
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import EnvironmentName, folder_named, function_named
from limberjack.cli.output import (
    FAILED,
    add_summaries,
    complain,
    console,
    misuse_reported,
    summaries_table,
    visible,
)
from limberjack.cli.progress import show_units
from limberjack.utils.facts import title_of
from limberjack.utils.requirements import is_of_mujoco

if TYPE_CHECKING:
    from limberjack.data import Dataset, Information
    from limberjack.workers import OnProgress

__all__ = ["DatasetFolder", "print_information", "reading_reported"]

DatasetFolder = Annotated[
    str,  # a Path would take a slash from a URL
    typer.Argument(
        metavar="DIR",
        help="The folder of a dataset, as `limberjack collect`, `run --out` and `solve --out` "
        "write it, or its URL, such as https://host/walk.",
    ),
]


@contextlib.contextmanager
def reading_reported(name: str) -> Iterator[None]:
    """Turns an error into one line: status 2 for a bad dataset, 1 for a missing extra.

    Args:
      name: of the command.
    """
    try:
        with misuse_reported():
            yield
    except ImportError as error:
        if is_of_mujoco(error):
            raise
        complain(f"limberjack {name} {error}")
        raise typer.Exit(FAILED) from None


def print_information(information: "Information") -> None:
    """Prints the figures of a dataset."""

    facts, kept = information.recipe.facts, information.recipe.kept
    rows = summaries_table()
    add_summaries(rows, facts["policy"], information.summary, information.strata)
    console().print(rows)
    seeds, size = information.seeds, information.nbytes
    observed = "float32" if kept.float32 else "float64"
    more = [name for name in ("flat", "states") if getattr(kept, name)]
    lines = [
        f"{title_of(facts)}: {len(seeds)} episodes of seeds {seeds[0]} to "
        f"{seeds[-1]}, {information.steps:,} steps of {facts['control_timestep']:g} s",
        f"{size / 1e6:,.1f} MB in {len(information.files)} files, {size / information.steps:.0f} "
        f"bytes a step; {', '.join([f'observations in {observed}', *more])}",
        ", ".join(f"{name} {value}" for name, value in facts["versions"].items()),
        f"model {facts['fingerprint']}, policy {facts['policy_sha256']}",
    ]
    for line in lines:
        typer.echo(visible(line))


@command("info", "limberjack info walk", "limberjack info walk --verify --json")
def _info(
    directory: DatasetFolder,
    json: Annotated[
        bool, typer.Option("--json", help="Print everything as JSON, with the files' SHA-256.")
    ] = False,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify", help="Compare the files' SHA-256 and returns with the manifest's."
        ),
    ] = False,
) -> None:
    """Show the returns, sizes and versions of a dataset, and check every page of its files."""
    with reading_reported("info"):
        from limberjack import data

        information = data.inform(data.load(directory), verify=verify)
    if json:
        typer.echo(json_module.dumps(information.as_json(), indent=2))
    else:
        print_information(information)


@command(
    "replay",
    "limberjack replay walk",
    "limberjack replay mine --env my_package:make",
)
def _replay(
    directory: DatasetFolder,
    env: EnvironmentName = None,
) -> None:
    """Play recorded episodes again, without their policy, and report whether every bit is equal.

    Everything that was kept is compared: rewards, observations, ends and states. If they differ, as
    they may with another version of MuJoCo or on another kind of processor, the exit status is 1.
    `limberjack record --from DIR` films an episode.
    """
    with reading_reported("replay"):
        _refuse_recording(directory)
        from limberjack import data

        make = None if env is None else function_named(env)
        dataset = data.load(directory)
        with show_units() as progress:
            progress.begin(len(dataset))
            difference = data.replay(dataset, make, on_progress=progress.show)
    if difference is not None:
        complain(difference)
        raise typer.Exit(FAILED)
    typer.echo(f"{directory}: {len(dataset)} episodes, {dataset.steps:,} steps, every bit the same")


def _refuse_recording(path: str) -> None:
    """Raises ValueError for a file, such as the recordings that earlier versions wrote."""
    if path.endswith(".npz"):
        raise ValueError(
            f"{path} is a recording of an earlier version; limberjack 0.1.0 is the last one that "
            "reads it. `limberjack solve --out DIR` now writes a dataset: replay DIR"
        )


class _Target(enum.StrEnum):
    """A format to convert to."""

    MINARI = "minari"
    LEROBOT = "lerobot"


@command(
    "convert",
    "limberjack convert walk --to minari",
    "limberjack convert walk --to minari --id mine/walk-v0",
    "limberjack convert walk --to lerobot --out walk-lerobot",
)
def _convert(
    directory: DatasetFolder,
    to: Annotated[_Target, typer.Option(help="The format.")],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="ROOT",
            parser=folder_named,
            help="The folder of Minari datasets, or that of the LeRobot dataset; DIR/minari or "
            "DIR/lerobot by default.",
        ),
    ] = None,
    id: Annotated[
        str | None,
        typer.Option(
            metavar="ID", help="Of Minari, such as mine/walk-v0; of task and policy by default."
        ),
    ] = None,
) -> None:
    """Convert a dataset to the format of Minari, or version 3 of LeRobot's.

    To load a Minari dataset, MINARI_DATASETS_PATH must name the folder of Minari datasets.
    """
    with reading_reported("convert"):
        from limberjack import data
        from limberjack.episodes.places import place_of

        if id is not None and to is not _Target.MINARI:
            raise ValueError(f"--id names a Minari dataset, and --to is {to}: leave it out")
        if out is None:
            folder = place_of(directory)
            if not isinstance(folder, Path):
                raise ValueError(f"{directory} is a URL: name the folder to write to with --out")
            out = folder / to
        convert = _to_minari if to is _Target.MINARI else _to_lerobot
        dataset = data.load(directory)
        with show_units() as progress:
            progress.begin(len(dataset))
            call = convert(dataset, out, id, progress.show)
    typer.echo(call)


def _to_minari(dataset: "Dataset", out: Path, id: str | None, on_progress: "OnProgress") -> str:
    """Converts a dataset; returns what to call to load it."""
    from limberjack.episodes.to_minari import to_minari

    name = to_minari(dataset, out, id, on_progress)
    return f'MINARI_DATASETS_PATH={out}: minari.load_dataset("{name}")'


def _to_lerobot(dataset: "Dataset", out: Path, id: str | None, on_progress: "OnProgress") -> str:
    """Converts a dataset; returns what to call to load it."""
    from limberjack.episodes.to_lerobot import to_lerobot

    to_lerobot(dataset, out, on_progress)
    return f'LeRobotDataset("limberjack/{out.name}", root="{out}")'
