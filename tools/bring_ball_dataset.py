"""Makes a dataset of planner episodes of bring_ball, with its card and the hashes of its files.

    python tools/bring_ball_dataset.py --out bring_ball                 # seeds 0:100
    python tools/bring_ball_dataset.py --out again --compare bring_ball/CARD.md

An episode takes 19 core-seconds, so 100 of them about half an hour of one core; a killed run
continues. The card names returns, versions, licence, command and hashes. With --compare the run
ends with status 1 unless the files have the hashes of another card.
"""

import re
import sys
from pathlib import Path
from typing import Annotated

import typer

from limberjack import data
from limberjack.data import Information
from limberjack.utils.files import replacing

__all__ = ["card_of", "hashes_in", "main"]

CARD = "CARD.md"

_DOMAIN, _TASK, _POLICY = "manipulator", "bring_ball", "planner"
_LICENCE = (
    "Apache License 2.0, as Limberjack. The task was designed by the authors of dm_control; see "
    "Limberjack's NOTICE."
)


def card_of(information: Information, command: str) -> str:
    """The card of a dataset, in Markdown."""
    facts, summary = information.recipe.facts, information.summary
    seeds = information.seeds
    size = f"{information.nbytes / 1e6:.1f} MB in {len(information.files)} files"
    rows = [("all", summary), *information.strata.items()]
    returns = [
        f"| {name} | {part.episodes} | {part.mean:.1f} | {part.median:.1f} | {part.successes} |"
        for name, part in rows
    ]
    return "\n".join(
        [
            f"# {facts['domain']} {facts['task']}, policy {facts['policy']}",
            "",
            f"{len(seeds)} episodes of seeds {seeds[0]} to {seeds[-1]}, {information.steps:,} "
            f"steps of {facts['control_timestep']:g} s; {size}.",
            "",
            "| start | episodes | mean return | median | successes |",
            "|---|---|---|---|---|",
            *returns,
            "",
            "| | |",
            "|---|---|",
            f"| command | `{command}` |",
            f"| versions | {', '.join(f'{n} {v}' for n, v in facts['versions'].items())} |",
            f"| model | `{facts['fingerprint']}` |",
            f"| policy | `{facts['policy_sha256']}` |",
            f"| licence | {_LICENCE} |",
            "",
            "| file | SHA-256 |",
            "|---|---|",
            *(f"| {name} | `{digest}` |" for name, digest in information.files.items()),
            "",
        ]
    )


def hashes_in(card: str) -> dict[str, str]:
    """The hashes of the files that a card lists, by name."""
    return dict(re.findall(r"^\| (seeds-\S+) \| `([0-9a-f]{64})` \|$", card, re.MULTILINE))


def main(
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder of the dataset.")],
    episodes: Annotated[int, typer.Option(min=1, help="Seeds from 0 on.")] = 100,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one per core.")] = None,
    compare: Annotated[
        Path | None, typer.Option(metavar="CARD", help="A card whose hashes must be the same.")
    ] = None,
) -> None:
    """Make the dataset and its card."""
    expected = None if compare is None else hashes_in(compare.read_text(encoding="utf-8"))
    command = f"limberjack collect {_DOMAIN} {_TASK} --policy {_POLICY} --seeds 0:{episodes}"
    data.collect(
        _DOMAIN, _TASK, _POLICY, range(episodes), out=out, workers=workers, command=command
    )
    information = data.inform(data.load(out))
    with replacing(out / CARD) as partial:
        partial.write_text(card_of(information, f"{command} --out DIR"), encoding="utf-8")
    typer.echo(out / CARD)
    if expected is not None and expected != information.files:
        differing = sorted(
            name
            for name in {*expected, *information.files}
            if expected.get(name) != information.files.get(name)
        )
        typer.echo(f"other hashes than in {compare}: {', '.join(differing)}", err=True)
        sys.exit(1)


if __name__ == "__main__":
    typer.run(main)
