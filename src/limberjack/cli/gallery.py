"""`limberjack gallery`: pictures of all tasks."""

from pathlib import Path
from typing import Annotated

import typer

from limberjack.cli.app import app
from limberjack.cli.output import FAILED, complain, misuse_reported

__all__: list[str] = []


@app.command("gallery")
def _gallery(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where to write the PNG files.")],
) -> None:
    """Draw a picture of each task, and a sheet of all of them: suite.png."""
    from limberjack import gallery
    from limberjack.mujoco.camera import RenderingError

    with misuse_reported():
        try:
            paths = gallery.write(out)
        except RenderingError as error:
            complain(f"no pictures: {error}")
            raise typer.Exit(FAILED) from None
    for path in paths:
        typer.echo(path)
