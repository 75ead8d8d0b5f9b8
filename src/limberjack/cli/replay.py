"""`limberjack replay`: the episodes of a dataset, played again and compared bit for bit."""

from pathlib import Path

import typer

from limberjack.cli.app import command
from limberjack.cli.datasets import DatasetFolder, reading_reported
from limberjack.cli.options import EnvironmentName, function_named
from limberjack.cli.output import FAILED, complain
from limberjack.cli.progress import show_units

__all__: list[str] = []


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


def _refuse_recording(path: Path) -> None:
    """Raises ValueError for a file, such as the recordings that earlier versions wrote."""
    if path.suffix == ".npz":
        raise ValueError(
            f"{path} is a recording of an earlier version; limberjack 0.1.0 is the last one that "
            "reads it. `limberjack solve --out DIR` now writes a dataset: replay DIR"
        )
