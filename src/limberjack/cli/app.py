"""The command that the others are parts of."""

import importlib
import os
import signal
import sys
from typing import Annotated

import typer

import limberjack
from limberjack import registry
from limberjack.cli.output import INTERRUPTED, TERMINATED, misuse_reported

__all__ = ["app", "main"]

app = typer.Typer(
    name="limberjack",
    help=f"Control tasks on MuJoCo: {', '.join(registry.domains())}.",
    no_args_is_help=True,
    rich_markup_mode="markdown",  # joins the lines of a paragraph
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Runs the command line and exits. SIGTERM, as clusters send it, ends it as Ctrl-C does."""
    terminated = False

    def terminate(*_: object) -> None:
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


def _import(modules: list[str]) -> None:
    """Imports modules that register domains; the working directory is searched last."""
    if modules and os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    for module in modules:
        before = set(registry.domains())
        with misuse_reported():
            try:
                importlib.import_module(module)
            except ModuleNotFoundError as error:
                raise ValueError(f"--import {module}: {error}") from None
            names = [domain.import_name for domain in registry.domains().values()]
            if set(registry.domains()) == before and module not in names:
                raise ValueError(
                    f"--import {module}: the module registers no domain; write "
                    "suite.register(NAME, __name__) in its last line"
                )


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
    modules: Annotated[
        list[str] | None,
        typer.Option(
            "--import",
            metavar="MODULE",
            help="Import a module that registers domains, such as my_package.swing, before the "
            "command; may be repeated.",
        ),
    ] = None,
) -> None:
    _import(modules or [])
