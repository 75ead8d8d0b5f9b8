"""`limberjack convert`: a dataset in another format."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.datasets import DatasetFolder, reading_reported
from limberjack.cli.progress import show_units

__all__: list[str] = []


class _Target(enum.StrEnum):
    """A format to convert to."""

    MINARI = "minari"


@command(
    "convert",
    "limberjack convert walk --to minari",
    "limberjack convert walk --to minari --id mine/walk-v0",
)
def _convert(
    directory: DatasetFolder,
    to: Annotated[_Target, typer.Option(help="The format.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="ROOT", help="The folder of Minari datasets; DIR/minari by default."),
    ] = None,
    id: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Such as mine/walk-v0; of task and policy by default."),
    ] = None,
) -> None:
    """Convert a dataset to Minari's format, one episode at a time.

    To load it, MINARI_DATASETS_PATH must name the folder of Minari datasets.
    """
    with reading_reported("convert"):
        from limberjack import data
        from limberjack.episodes.to_minari import to_minari

        dataset = data.load(directory)
        root = directory / to if out is None else out
        with show_units() as progress:
            progress.begin(len(dataset))
            name = to_minari(dataset, root, id, progress.show)
    typer.echo(f'MINARI_DATASETS_PATH={root}: minari.load_dataset("{name}")')
