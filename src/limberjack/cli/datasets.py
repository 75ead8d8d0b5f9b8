"""The parts that the commands on datasets share: argument, errors and figures."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.output import FAILED, complain, console, misuse_reported, visible
from limberjack.cli.summaries import add_summaries, summaries_table
from limberjack.utils.facts import title_of
from limberjack.utils.requirements import is_of_mujoco

if TYPE_CHECKING:
    from limberjack.data import Information

__all__ = ["DatasetFolder", "print_information", "reading_reported"]

DatasetFolder = Annotated[
    Path,
    typer.Argument(
        metavar="DIR",
        help="The folder of a dataset, as `limberjack collect`, `run --out` and `solve --out` "
        "write it.",
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
    rows = summaries_table("policy")
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
