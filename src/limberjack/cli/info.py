"""`limberjack info`: the returns, sizes, versions and recipe of a dataset."""

import json as json_module
from typing import Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.datasets import DatasetFolder, print_information, reading_reported

__all__: list[str] = []


@command("info", "limberjack info walk", "limberjack info walk --verify --json")
def _info(
    directory: DatasetFolder,
    json: Annotated[
        bool, typer.Option("--json", help="Print everything as JSON, with the files' SHA-256.")
    ] = False,
    verify: Annotated[
        bool, typer.Option("--verify", help="Compare the files' SHA-256 with the manifest's.")
    ] = False,
) -> None:
    """Show the returns, sizes and versions of a dataset, and check every page of its files."""
    with reading_reported("info"):
        from limberjack import data

        information = data.inform(data.load(directory), verify=verify)
    if json:
        typer.echo(json_module.dumps(information.as_json(), indent=2))
    else:
        print_information(information)
