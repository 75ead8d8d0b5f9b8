"""The program that the commands are parts of.

@command("list", "limberjack list", "limberjack list --json")
def _list() -> None: ...
"""

import contextlib
import errno
import importlib
import io
import itertools
import sys
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer
import typer.core

import limberjack
from limberjack import registry
from limberjack.cli.output import FAILED, append_working_directory, misuse_reported
from limberjack.cli.process import own_process
from limberjack.utils.requirements import broken_mujoco, is_of_mujoco

__all__ = ["app", "command", "main"]

_Function = TypeVar("_Function", bound=Callable[..., None])

# Values of options that may be given without one, which Typer cannot express.
_VALUES = {"--ray": "local"}


class _ShortTypes:
    """Help pages that show a flag by its name alone, without `<bool>`, and a number without range.

    Numbers out of range are refused by the type of the parameter, in a message with the range.
    """

    # Any: classes that depend on the version of Typer, of which a class inherits beside this one.
    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters of the command line."""
        inherited: Any = super()  # Any: as above
        parameters = inherited.get_params(ctx)
        for parameter in parameters:
            if getattr(parameter, "is_flag", False):
                parameter.metavar = ""
            parameter.min = parameter.max = None  # of its description alone
        return parameters


class _Command(_ShortTypes, typer.core.TyperCommand):
    """One command."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # as Typer has it
        """Parses the command line."""
        return super().parse_args(ctx, _with_values(args))


class _Group(_ShortTypes, typer.core.TyperGroup):
    """The program."""


def _with_values(arguments: list[str]) -> list[str]:
    """The arguments, with the values that were left out of options that need none."""
    complete = []
    for argument, following in itertools.pairwise([*arguments, "-"]):
        complete.append(argument)
        if argument in _VALUES and following.startswith("-"):
            complete.append(_VALUES[argument])
    return complete


def _examples(*lines: str) -> str:
    """The end of a help page, in Markdown."""
    return "\n".join(["Examples:\n" if len(lines) > 1 else "Example:\n", "```text", *lines, "```"])


app = typer.Typer(
    name="limberjack",
    cls=_Group,
    help=f"Control tasks on MuJoCo: {', '.join(registry.domains())}.",
    epilog=_examples(
        "limberjack list",
        "limberjack run humanoid walk --policy random --out demo",
        "limberjack COMMAND -h",
    ),
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="markdown",  # joins the lines of a paragraph
    pretty_exceptions_enable=False,
)


def command(name: str, *examples: str) -> Callable[[_Function], _Function]:
    """Adds a function to the program as a command.

    Args:
      name: of the command.
      examples: calls of it, which its help page shows.
    """
    return app.command(name, cls=_Command, epilog=_examples(*examples))


def main() -> None:
    """Runs the command line and exits. SIGTERM, which clusters send, ends it as Ctrl-C does."""
    with own_process():
        if isinstance(sys.stdout, io.TextIOWrapper):  # names of files may be no text
            sys.stdout.reconfigure(errors="backslashreplace")
        try:
            app(prog_name="limberjack")
        except (AttributeError, ImportError, OSError) as error:
            report = _report_on_writing(error) or _report_on_files(error)
            if report is None:
                raise
            typer.echo(f"limberjack: {report}", err=True)
            sys.exit(FAILED)


def _report_on_writing(error: Exception) -> str | None:
    """The reason if a disk, or what the output goes to, is full; None otherwise."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        with contextlib.suppress(OSError):
            sys.stdout.close()  # what it could not take is not tried again
        return f"could not write: {error.strerror}"
    return None


def _report_on_files(error: Exception) -> str | None:
    """Commands that help where files of MuJoCo or Limberjack are missing; None otherwise."""
    from limberjack.doctor import packages  # which imports no MuJoCo

    clashes = packages.clashes()
    if clashes:
        return clashes[0]
    if not is_of_mujoco(error):
        return None
    return str(broken_mujoco(error))


def _import(modules: list[str]) -> None:
    """Imports modules that register domains; the working directory is searched last."""
    if not modules:
        return
    from limberjack.policies.kinds import Locating

    append_working_directory()
    for module in modules:
        before = set(registry.domains())
        with misuse_reported():
            if module.startswith("."):
                raise ValueError(f"--import {module}: expected the full name of a module")
            try:
                with Locating(f"--import {module}"):
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


# Shown by the program without a command: what each does, and the command.
_TO_BEGIN_WITH = {
    "lists the tasks": "limberjack list",
    "shows a trained policy, live in a browser": (
        "limberjack view cartpole balance --policy pretrained"
    ),
    "plays an episode, with a film and a report": (
        "limberjack run walker walk --policy pretrained --out demo"
    ),
    "measures a policy over 100 episodes": (
        "limberjack evaluate walker walk --policy pretrained --episodes 100"
    ),
    "trains a policy": "limberjack train cartpole balance --out trained",
}


def _greet() -> None:
    """Prints the commands to begin with."""
    typer.echo("Control tasks on MuJoCo. Five commands to begin with:\n")
    for effect, line in _TO_BEGIN_WITH.items():
        typer.echo(f"  {line}\n      {effect}")
    typer.echo("\nlimberjack -h shows all commands, and limberjack COMMAND -h explains one.")


@app.callback()
def _options(
    context: typer.Context,
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
    if context.invoked_subcommand is None:
        _greet()
