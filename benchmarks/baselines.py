"""Returns of zero and of random actions on dm_control's benchmark of 28 tasks.

    python benchmarks/baselines.py

It writes `results/baselines.json`, from which `scores.py` makes the table in docs/scores.md. Any
policy must be compared with these: on some tasks they already score well.
"""

from typing import Any

import sources
import typer
from report import versions

from limberjack import suite
from limberjack.evaluation import evaluate

__all__ = ["FILE", "main"]

FILE = sources.RESULTS / "baselines.json"
_SEEDS = range(64)  # one batch
_POLICIES = ("zero", "random")


def _measure(domain: str, task: str) -> dict[str, Any]:
    """The mean return of each policy on the same seeds, and the 95 % interval of the mean."""
    evaluation = evaluate(domain, task, "random", _SEEDS)
    row: dict[str, Any] = {"domain": domain, "task": task}
    for policy in _POLICIES:
        summary = evaluation.summary(policy)
        row[policy] = {"mean": summary.mean, "interval": summary.interval}
    return row


def main() -> None:
    """Play all tasks of the benchmark and write the results."""
    rows = []
    for domain, task in suite.BENCHMARKING:
        rows.append(_measure(domain, task))
        typer.echo(f"{domain}:{task} {[round(rows[-1][name]['mean'], 1) for name in _POLICIES]}")
    seeds = f"{_SEEDS.start}:{_SEEDS.stop}"
    document = {"versions": versions(), "seeds": seeds, "rows": rows}
    sources.write(FILE, document)


if __name__ == "__main__":
    typer.run(main)
