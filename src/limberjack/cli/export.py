"""`limberjack export`: a saved model as a policy file."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import named_task
from limberjack.cli.output import misuse_reported, search_working_directory

__all__: list[str] = []


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
    with misuse_reported():
        search_working_directory(policy)
        from limberjack.policies import onnx
        from limberjack.policies.exporting import export

        of_task = None if task is None else named_task(task, None)
        export(policy, out, task=of_task, action_repeat=action_repeat)
    kind = "onnx" if out.suffix == onnx.ENDING else "mlp"
    typer.echo(f"{out}: --policy {shlex.quote(f'{kind}:{out}')}")
