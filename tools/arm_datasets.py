"""Makes datasets of planner episodes of the arm's six tasks, with cards and the hashes of files.

    python tools/arm_datasets.py --out arm                              # all six, seeds 20000:20100
    python tools/arm_datasets.py bring_ball --out again --compare arm

The episodes of a task go to a folder of its name, and its card beside it, such as bring_ball.md;
their evaluation, for which only the baselines are played, goes to a folder such as
bring_ball-scores. An episode takes 10 to 40 core-seconds, so a task up to an hour of one core; a
killed run continues. A card names returns, versions, licence, command and hashes. With --compare
the run ends with status 1 unless the files have the hashes that the cards in another folder list.
"""

import contextlib
import re
import sys
from pathlib import Path
from typing import Annotated

import typer

from limberjack import data, suite
from limberjack.data import Information
from limberjack.episodes.player import Player
from limberjack.evaluation import Score, evaluate
from limberjack.evaluation.store import Store
from limberjack.utils.files import write_whole

__all__ = ["card_of", "hashes_in", "main"]

_ARM = {
    task: domain for domain in ("manipulator", "stacker") for task in suite.TASKS_BY_DOMAIN[domain]
}
_POLICY = "planner"
_FIRST_SEED = 20_000  # of the table of scores, so that the returns are the same
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
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder of datasets and cards.")],
    tasks: Annotated[
        list[str] | None, typer.Argument(metavar="[TASK]...", help="All six by default.")
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Seeds from 20000 on.")] = 100,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one per core.")] = None,
    compare: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Cards whose hashes must be the same.")
    ] = None,
) -> None:
    """Make the datasets and their cards."""
    chosen = tasks or list(_ARM)
    unknown = [task for task in chosen if task not in _ARM]
    if unknown:
        raise typer.BadParameter(f"no task {', '.join(unknown)}; expected {', '.join(_ARM)}")
    expected = {task: _hashes_of_card(compare, task) for task in chosen} if compare else {}
    differing: list[str] = []
    for task in chosen:
        files = _make(task, out, episodes, workers)
        _evaluate(task, out, episodes)
        typer.echo(_card(out, task))
        if compare:
            names = {name for name, _ in expected[task].items() ^ files.items()}
            differing += [f"{task}/{name}" for name in sorted(names)]
    if differing:
        typer.echo(f"other hashes than in {compare}: {', '.join(differing)}", err=True)
        sys.exit(1)


def _make(task: str, out: Path, episodes: int, workers: int | None) -> dict[str, str]:
    """Collects a task's dataset and writes its card; returns the hashes of its files, by name."""
    domain, seeds = _ARM[task], _seeds(episodes)
    asked = f"--seeds {seeds.start}:{seeds.stop}"
    command = f"limberjack collect {domain} {task} --policy {_POLICY} {asked}"
    data.collect(domain, task, _POLICY, seeds, out=out / task, workers=workers, command=command)
    information = data.inform(data.load(out / task))
    write_whole(_card(out, task), card_of(information, f"{command} --out DIR"))
    return information.files


def _evaluate(task: str, out: Path, episodes: int) -> None:
    """Evaluates the episodes of a dataset beside those of the baselines."""
    domain, seeds, folder = _ARM[task], _seeds(episodes), out / f"{task}-scores"
    player = Player(domain, task, _POLICY, seeds, is_kept=True)
    with (
        contextlib.closing(player),
        contextlib.closing(Store(folder, player.identity, canary=player.canary)) as store,
    ):
        known = store.scores[_POLICY]
        played = map(Score.of, data.load(out / task))
        store.add(_POLICY, (score for score in played if score.seed not in known))
    command = f"limberjack evaluate {domain} {task} --policy {_POLICY} "
    asked = f"--seeds {seeds.start}:{seeds.stop} --out DIR"
    evaluate(domain, task, _POLICY, seeds, out=folder, command=command + asked)


def _seeds(episodes: int) -> range:
    return range(_FIRST_SEED, _FIRST_SEED + episodes)


def _card(folder: Path, task: str) -> Path:
    return folder / f"{task}.md"


def _hashes_of_card(folder: Path, task: str) -> dict[str, str]:
    return hashes_in(_card(folder, task).read_text(encoding="utf-8"))


if __name__ == "__main__":
    typer.run(main)
