"""`limberjack gallery`: pictures of all tasks."""

import typer

from limberjack.cli.app import command
from limberjack.cli.options import RequiredOut
from limberjack.cli.output import FAILED, complain, misuse_reported
from limberjack.cli.progress import show_parts

__all__: list[str] = []


@command("gallery", "limberjack gallery --out pictures")
def _gallery(
    out: RequiredOut,
) -> None:
    """Draw a picture of each task, and a sheet of all of them: suite.png."""
    from limberjack import gallery
    from limberjack.mujoco.camera import RenderingError

    with misuse_reported():
        try:
            with show_parts() as show:
                paths = gallery.write(
                    out,
                    on_progress=lambda domain, task, drawn, tasks: show(
                        f"drawing {domain} {task}", drawn, tasks
                    ),
                )
        except RenderingError as error:
            complain(f"no pictures: {error}")
            raise typer.Exit(FAILED) from None
    for path in paths:
        typer.echo(path)
