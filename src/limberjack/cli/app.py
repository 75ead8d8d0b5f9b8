"""The command that the others are parts of."""

import signal
import sys
from typing import Annotated, Any

import typer

import limberjack
from limberjack.cli.output import INTERRUPTED, TERMINATED

__all__ = ["app", "main"]

app = typer.Typer(
    name="limberjack",
    help="Control tasks on MuJoCo: humanoid, manipulator and stacker.",
    no_args_is_help=True,
    rich_markup_mode="markdown",  # joins the lines of a paragraph
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Runs the command line and exits. SIGTERM, as clusters send it, ends it as Ctrl-C does."""
    terminated = False

    def terminate(*_: Any) -> None:
        nonlocal terminated
        terminated = True
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, terminate)
    try:
        app(prog_name="limberjack")
    except SystemExit as end:
        if terminated and end.code == INTERRUPTED:
            sys.exit(TERMINATED)
        raise


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
