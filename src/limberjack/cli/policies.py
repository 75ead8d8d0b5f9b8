"""`limberjack policies`: the bundled policies, with their scores."""

import dataclasses
import json as json_module
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.output import console, misuse_reported, table

if TYPE_CHECKING:
    from limberjack.policies import Bundled

__all__: list[str] = []

_FIGURES = ("repeat", "steps", "mean", "95 % interval", "seeds", "kB")
_UNKNOWN = "-"


@command("policies", "limberjack policies", "limberjack policies --json")
def _policies(
    json: Annotated[
        bool,
        typer.Option("--json", help="Print a JSON list of objects, one for each, with all cards."),
    ] = False,
) -> None:
    """List the tasks that have a bundled policy, which `--policy pretrained` plays.

    The scores are means over the first episodes of seeds that training has not seen, with their
    95 % intervals, at the policy's own action repeat.
    """
    with misuse_reported():
        from limberjack import policies

        found = policies.bundled()
    if json:
        typer.echo(json_module.dumps([_as_json(one) for one in found], indent=2))
        return
    if not found:
        typer.echo("No task has a bundled policy in this version.")
        return
    rows = table("domain", "task", "algorithm", *(f"{name}>" for name in _FIGURES))
    for one in found:
        rows.add_row(*_row(one))
    console().print(rows)


def _as_json(one: "Bundled") -> dict[str, object]:
    facts = {**dataclasses.asdict(one), "path": str(one.path)}
    return {**facts, "card": one.card.as_json()}


def _row(one: "Bundled") -> list[str]:
    card, scores = one.card, one.card.scores
    steps = _UNKNOWN if card.steps is None else f"{card.steps:,}"
    figures = [_UNKNOWN] * 3
    if scores is not None:
        low, high = scores.interval
        first, end = scores.seeds
        figures = [f"{scores.mean:.1f}", f"{low:.1f} to {high:.1f}", f"{first}:{end}"]
    named = [one.domain, one.task, card.algorithm or _UNKNOWN, str(card.action_repeat), steps]
    return [*named, *figures, f"{one.nbytes / 1e3:.0f}"]
