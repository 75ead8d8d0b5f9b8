"""Optimisers of the planner on one task, at equal processor time: an ablation that can be resumed.

    python benchmarks/optimisers.py walker:run --seconds 5
    python benchmarks/optimisers.py walker:run --seconds 5 --variant "icem colour=3 samples=64"
    python benchmarks/optimisers.py                          # prints what has been played

plays each variant on the tuning seeds 1000:1020, and keeps each episode in results/optimisers.json
as it ends; what is there is not played again. The first variant is the task's own cost as it is. Of
every other one the number of samples is set, before its first episode, so that a planning step
takes as much processor time as the first variant's, unless the variant names its samples.
"""

import dataclasses
import json
import math
import statistics
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import pages
import sources
import typer
from report import versions

from limberjack import suite
from limberjack.planner import ICEM, MPPI, Planner, Settings, cost_for
from limberjack.planner.cost import sources_for
from limberjack.utils.seeds import checked_seed
from limberjack.utils.sources import hash_of_files
from limberjack.utils.suggest import did_you_mean

__all__ = ["RESULTS", "VARIANTS", "main", "settings_of", "table"]

RESULTS = sources.RESULTS / "optimisers.json"
SEEDS = range(1000, 1020)  # of those on which the planner may be tuned
OWN = "own"  # the task's own settings, with which the others are compared
# Each changes one thing: of MPPI, and of iCEM.
VARIANTS = (
    OWN,
    "mppi iterations=2",
    "mppi colour=2",
    "icem",
    "icem iterations=1",
    "icem iterations=3",
    "icem colour=0",
    "icem colour=3",
    "icem kept=0",
    "icem takes_best=true",
    "icem finest=0.03",
)

_KINDS = {"mppi": MPPI, "icem": ICEM}
_PLANS = 15  # planning steps of each side in a round of a comparison of times
_ROUNDS = 3  # the time of a planning step is not proportional to the samples
_FEWEST = 8  # samples

_Task = dict[str, Any]  # JSON: a task's facts and variants


def main(
    task: Annotated[str | None, typer.Argument(help="DOMAIN:TASK.")] = None,
    variant: Annotated[
        list[str] | None, typer.Option(help="mppi or icem and options; repeatable.")
    ] = None,
    seeds: Annotated[int, typer.Option(help="Number of seeds, from 1000 on.")] = len(SEEDS),
    seconds: Annotated[
        float | None, typer.Option(help="Time limit of an episode; by default the task's.")
    ] = None,
    file: Annotated[Path, typer.Option(help="File of the results.")] = RESULTS,
) -> None:
    """Compares optimisers of the planner on one task at equal processor time."""
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    if task is not None:
        chosen = range(SEEDS.start, checked_seed(SEEDS.start + seeds))
        variants = list(dict.fromkeys([OWN, *(variant or VARIANTS)]))
        try:
            _play(found, file, task, variants, chosen, seconds)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from error
    for name, entry in found.items():
        typer.echo(f"\n{name}\n\n" + "\n".join(table(entry)))


def _play(
    found: dict[str, _Task],
    file: Path,
    task: str,
    variants: Sequence[str],
    seeds: Sequence[int],
    seconds: float | None,
) -> None:
    """Plays the episodes that are missing, and writes the file after each of them."""
    domain, _, name = task.partition(":")
    cost = cost_for(suite.load(domain, name).task)
    settings = {variant: settings_of(cost.settings, variant) for variant in variants}
    title = task if seconds is None else f"{task}, {seconds:g} s"
    sha256 = hash_of_files(sources_for(cost.task))
    entry = found.setdefault(title, {"planner": sha256, "versions": versions(), "variants": {}})
    if entry["planner"] != sha256:
        raise ValueError(
            f"{title} was played with other sources of the planner ({entry['planner'][:12]}, not "
            f"{sha256[:12]}): remove it from {file.name}, or play it with those sources"
        )
    for seed in seeds:  # all variants of a seed together, so that an early end compares them fairly
        for variant, chosen in settings.items():
            played = entry["variants"].setdefault(variant, {"samples": None, "episodes": {}})
            if str(seed) in played["episodes"]:
                continue
            if played["samples"] is None:
                is_given = variant == OWN or "samples=" in variant
                equal = chosen if is_given else _equal(domain, name, cost.settings, chosen)
                played["samples"] = equal.samples
            chosen = dataclasses.replace(chosen, samples=played["samples"])
            episode = _episode(domain, name, seed, chosen, seconds)
            played["episodes"][str(seed)] = episode
            sources.write(file, found)
            typer.echo(f"{title} {seed} {variant}: {episode['return']:.2f}")


def settings_of(own: Settings, variant: str) -> Settings:
    """The settings that a variant's words describe.

    Raises:
      ValueError: there is no such optimiser or option, or a value cannot be.
    """
    kind, *options = variant.split()
    if kind == OWN and not options:
        return own
    if kind not in _KINDS:
        raise ValueError(
            f"optimiser is {kind!r}; expected own, mppi or icem.{did_you_mean(kind, _KINDS)}"
        )
    names = [field.name for field in dataclasses.fields(_KINDS[kind])]
    given: dict[str, Any] = {}
    for option in options:
        name, _, value = option.partition("=")
        if name not in (*names, "samples"):
            raise ValueError(
                f"{kind} has no option {name!r}; it has {', '.join(names)} and samples."
                f"{did_you_mean(name, names)}"
            )
        given[name] = json.loads(value)
    samples = given.pop("samples", own.samples)
    return dataclasses.replace(own, samples=samples, optimiser=_KINDS[kind](**given))


def _equal(domain: str, task: str, own: Settings, settings: Settings) -> Settings:
    """The settings with so many samples that a planning step takes as long as with the own ones."""
    for _ in range(_ROUNDS):
        sides = [_planning(domain, task, one) for one in (own, settings)]
        pairs = list(zip(*sides, strict=True))
        ratio = statistics.median(ours / theirs for theirs, ours in pairs)
        samples = max(_FEWEST, round(settings.samples / ratio))
        settings = dataclasses.replace(settings, samples=samples)
    return settings


def _planning(domain: str, task: str, settings: Settings) -> Iterator[float]:
    """Processor time of planning steps, one after the other as they are asked for, seconds."""
    env = suite.load(domain, task, {"random": SEEDS.start})
    env.reset()
    planner = Planner(env, 1, settings=dataclasses.replace(settings, interval=1))
    env.step(planner.act())  # the first one learns what to record
    for _ in range(_PLANS):
        began = time.process_time()
        action = planner.act()
        yield time.process_time() - began
        env.step(action)


def _episode(
    domain: str, task: str, seed: int, settings: Settings, seconds: float | None
) -> dict[str, float]:
    """One episode with one thread: its return, steps, and the processor time of the planner."""
    limit = {} if seconds is None else {"time_limit": seconds}
    env = suite.load(domain, task, {"random": seed, **limit})
    planner = Planner(env, 1, seed, settings=settings)
    time_step, total, steps, spent = env.reset(), 0.0, 0, 0.0
    while not time_step.last():
        began = time.process_time()
        action = planner.act()
        spent += time.process_time() - began
        time_step = env.step(action)
        total += float(time_step.reward or 0.0)
        steps += 1
    return {"return": total, "steps": steps, "processor_seconds": round(spent, 2)}


def table(entry: _Task) -> list[str]:
    """The lines of a task's table: each variant on the seeds that all of them have played."""
    variants = entry["variants"]
    common = set.intersection(*(set(played["episodes"]) for played in variants.values()))
    seeds = sorted(common, key=int)
    columns = [f"{len(seeds)} seeds", "samples", "mean per step", "less own", "time / own"]
    if not seeds:
        return pages.table(columns, [])
    rows = []
    per_step, spent = {}, {}
    for variant, played in variants.items():
        episodes = [played["episodes"][seed] for seed in seeds]
        per_step[variant] = [one["return"] / one["steps"] for one in episodes]
        spent[variant] = sum(one["processor_seconds"] / one["steps"] for one in episodes)
    for variant, means in per_step.items():
        less = [mean - own for mean, own in zip(means, per_step[OWN], strict=True)]
        # 95 % confidence, of the mean of the paired differences.
        half = 1.96 * statistics.stdev(less) / math.sqrt(len(less)) if len(less) > 1 else math.inf
        difference = "" if variant == OWN else f"{statistics.fmean(less):+.3f} ± {half:.3f}"
        samples, ratio = variants[variant]["samples"], spent[variant] / spent[OWN]
        figures = f"{statistics.fmean(means):.3f}", difference, f"{ratio:.2f}"
        rows.append([variant, str(samples), *figures])
    return pages.table(columns, rows)


if __name__ == "__main__":
    typer.run(main)
