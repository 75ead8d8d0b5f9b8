"""The command that the others are parts of."""

from typing import Annotated

import typer

import limberjack

__all__ = ["app", "main"]

app = typer.Typer(
    name="limberjack",
    help="Control tasks on MuJoCo: humanoid, manipulator and stacker.",
    no_args_is_help=True,
    rich_markup_mode="markdown",  # joins the lines of a paragraph
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Runs the command line and exits."""
    app(prog_name="limberjack")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(limberjack.__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    pass
