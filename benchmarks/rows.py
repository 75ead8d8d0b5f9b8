"""The time of a step in rows that are complete environments, against the alternatives.

    python benchmarks/rows.py [--quick] [--threads T] [--seconds S] [--json FILE]

README.md describes the comparisons. All sides must return the same rewards. The exit status is 1 if
a bar is missed. Run it on idle cores: processes share a busy machine differently from threads.
"""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Annotated

import typer
from gymnasium.vector import AsyncVectorEnv
from report import Bar, Json, Quick, Row, at_most, compared, finish
from sides import Step, take_turns

from limberjack import gym, suite
from limberjack.rl.rows import RowsEnvironment

__all__ = ["Effort", "main"]

# Limits on the time of rows as a multiple of the vectorised batch's.
_BARS = {
    ("walker", "walk"): at_most(1.6),
    ("manipulator", "bring_ball"): at_most(2.1),
    ("humanoid", "walk"): at_most(2.0),
    ("cartpole", "swingup"): at_most(5.5),
}
_PROCESSES = at_most(0.6)  # of the time of AsyncVectorEnv

_NUM_PROCESSES = 16  # one for each environment, as AsyncVectorEnv has it
_SEED = 0

_ROWS, _THEIRS = "rows", "theirs"


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    rows: int = 64  # beside the vectorised batch
    threads: int = 2  # of both kinds of batch
    seconds: float = 30.0  # of each comparison
    rounds: int = 20  # of each comparison, at least


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(rows=4, threads=2, seconds=0.1, rounds=2)


def _row(
    measure: str, batch: RowsEnvironment, sides: Mapping[str, Step], bar: Bar, effort: Effort
) -> Row:
    taken = take_turns(sides, batch.action_spec(), effort.seconds, effort.rounds)
    ours, theirs = ([1e6 * seconds for seconds in taken[name]] for name in (_ROWS, _THEIRS))
    return compared(measure, f"{batch.name}, N={batch.num_envs}", ours, theirs, "us", bar)


def _begun(domain: str, task: str, num_envs: int, threads: int) -> RowsEnvironment:
    batch = suite.load_batch(domain, task, num_envs, threads, _SEED, vectorised=False)
    batch.reset()
    return batch


def _beside_vectorised(domain: str, task: str, bar: Bar, effort: Effort) -> Row:
    size = effort.rows, effort.threads
    rows = _begun(domain, task, *size)
    vectorised = suite.load_batch(domain, task, *size, _SEED, vectorised=True)
    vectorised.reset()
    sides: dict[str, Step] = {
        _ROWS: lambda actions: rows.step(actions).reward,
        _THEIRS: lambda actions: vectorised.step(actions).reward,
    }
    row = _row("rows / vectorised", rows, sides, bar, effort)
    rows.close()
    vectorised.close()
    return row


def _beside_processes(domain: str, task: str, effort: Effort) -> Row:
    make = functools.partial(gym.load, domain, task)
    # First, so that it forks before this process has any threads.
    processes = AsyncVectorEnv([make] * _NUM_PROCESSES)
    processes.reset(seed=_SEED)
    rows = _begun(domain, task, _NUM_PROCESSES, effort.threads)
    sides: dict[str, Step] = {
        _ROWS: lambda actions: rows.step(actions).reward,
        _THEIRS: lambda actions: processes.step(actions)[1],
    }
    row = _row("rows / AsyncVectorEnv", rows, sides, _PROCESSES, effort)
    rows.close()
    processes.close()
    return row


def main(
    quick: Quick = False,
    threads: Annotated[int, typer.Option(min=1, help="Of both kinds of batch.")] = Effort.threads,
    seconds: Annotated[float, typer.Option(min=0.1, help="Of a comparison.")] = Effort.seconds,
    json: Json = None,
) -> None:
    """Measure rows against vectorised batches and processes, and print whether bars are met."""
    effort = _QUICK if quick else Effort(threads=threads, seconds=seconds)
    measured = []
    for domain, task in _BARS:
        typer.echo(f"measuring: {domain} {task} in processes", err=True)
        measured.append(_beside_processes(domain, task, effort))
    for (domain, task), bar in _BARS.items():
        typer.echo(f"measuring: {domain} {task} vectorised", err=True)
        measured.append(_beside_vectorised(domain, task, bar, effort))
    measured.sort(key=lambda row: row.measure != "rows / vectorised")
    settings = {**dataclasses.asdict(effort), "processes": _NUM_PROCESSES}
    finish(measured, "compared with", quick, json, settings)


if __name__ == "__main__":
    typer.run(main)
