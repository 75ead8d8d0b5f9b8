"""`limberjack policies` and `export`: bundled policies with their scores, and policy files."""

import dataclasses
import json as json_module
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import named_task
from limberjack.cli.output import console, misuse_reported, remarks_reported, table

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


@command(
    "export",
    "limberjack export sb3:walker.zip walker.safetensors",
    "limberjack export sb3:walk.zip walk.safetensors --task walker/walk",
)
def _export(
    policy: Annotated[
        str, typer.Argument(metavar="sb3:PATH", help="A model that Stable-Baselines3 has saved.")
    ],
    out: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="The policy file, such as walker.safetensors or walker.onnx."
        ),
    ],
    task: Annotated[
        str | None,
        typer.Option(
            metavar="DOMAIN/TASK",
            help="The task that it was trained on, which the model does not say: the file is then "
            "refused in tasks with other observations, not only with another number.",
        ),
    ] = None,
    action_repeat: Annotated[
        int, typer.Option(metavar="N", min=1, help="Control steps per action in training.")
    ] = 1,
) -> None:
    """Write the policy of a saved model to a file that is played without PyTorch, as mlp:FILE.

    A file whose name ends in .onnx is a model of ONNX, which is played as onnx:FILE.

    The file acts as the model does without exploration, within 1e-5 of the actions' range, and
    loading it runs no code. A `VecNormalize` saved beside the model, such as
    walker.vecnormalize.pkl, is part of it.
    """
    with misuse_reported(), remarks_reported():
        from limberjack.policies import onnx
        from limberjack.policies.exporting import export

        of_task = None if task is None else named_task(task, None)
        export(policy, out, task=of_task, action_repeat=action_repeat)
    kind = "onnx" if out.suffix == onnx.ENDING else "mlp"
    typer.echo(f"{out}: --policy {shlex.quote(f'{kind}:{out}')}")
