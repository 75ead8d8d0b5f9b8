"""The time of a step of several tasks in one batch, beside a batch for each task.

    python benchmarks/many.py [--quick] [--threads T] [--seconds S] [--json FILE]

README.md describes the comparisons. Both sides must return the same rewards. The exit status is 1
if a bar is missed. Run it on idle cores.
"""

import dataclasses
import importlib
import os
import statistics
import time
from typing import Annotated, Any

import footprint
import fresh
import numpy as np
import typer
from report import Json, Quick, Row, at_least, at_most, figure, finish, spread
from sides import Step, take_turns

from limberjack import gym

__all__ = ["Effort", "made", "main"]

_SEED = 0
_SPEED = at_least(0.95)  # of a batch for each task
_SECONDS = at_most(4.5)  # of processor time to make it
_MEGABYTES = at_most(750.0)
_THREADS = at_most(8.0)  # more than those of one batch


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    tasks: str | list[str] = "all"  # a set, or a list
    rows: int = 8  # of each task
    threads: int = 2
    seconds: float = 60.0  # of the comparison
    rounds: int = 20  # at least
    processes: int = 3  # that make the batch


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(["pendulum:swingup", "reacher:easy"], 2, 2, seconds=0.1, rounds=2, processes=1)


def made(tasks: str | list[str], rows: int, threads: int) -> dict[str, float | None]:
    """Processor seconds to make a batch, and what the process has then; call it in a fresh one.

    Returns:
      seconds; the peak of megabytes then, and after a step; and the threads more that this started.
    """
    load_vector = importlib.import_module("limberjack.gym").load_vector
    before, began = _threads(), time.process_time()
    envs = load_vector(tasks, rows=rows, num_threads=threads)
    seconds, megabytes = time.process_time() - began, footprint.megabytes("VmHWM")
    envs.reset(seed=_SEED)
    envs.step(np.zeros(envs.action_space.shape))
    return {
        "seconds": seconds,
        "megabytes": megabytes,
        "after_a_step": footprint.megabytes("VmHWM"),
        "threads": float(_threads() - before),
    }


def _threads() -> int:
    return len(os.listdir("/proc/self/task"))


def _separate(many: Any, effort: Effort) -> Step:
    """Steps a vector environment for each task, with as many threads each."""
    all_envs = []
    for task in many.tasks:
        domain, _, name = task.name.partition(":")
        envs = gym.load_vector(domain, name, effort.rows, flat=True, num_threads=effort.threads)
        envs.reset(seed=_SEED + task.rows.start)
        all_envs.append((envs, task))

    def step(actions: np.ndarray) -> np.ndarray:
        steps = [envs.step(actions[task.rows, : task.action_size]) for envs, task in all_envs]
        return np.concatenate([step[1] for step in steps])

    return step


def _speed(effort: Effort) -> Row:
    many: Any = gym.load_vector(effort.tasks, rows=effort.rows, num_threads=effort.threads)
    many.reset(seed=_SEED)
    sides: dict[str, Step] = {"many": lambda given: many.step(given)[1]}
    sides["separate"] = _separate(many, effort)
    spec = many.batches[0].action_spec()
    taken = take_turns(sides, spec, effort.seconds, effort.rounds)
    ratios = [b / a for a, b in zip(taken["many"], taken["separate"], strict=True)]
    ours, theirs = (statistics.median(taken[name]) for name in ("many", "separate"))
    return Row(
        "speed of many / separate",
        f"{len(many.tasks)} tasks, {effort.rows} rows each",
        1e3 * ours,
        1e3 * theirs,
        "ms",
        statistics.median(ratios),
        bar=_SPEED,
        details={"ratio": spread(ratios)},
    )


def _making(effort: Effort) -> list[Row]:
    given = effort.tasks, effort.rows, effort.threads
    found = [fresh.call("many", "made", *given) for _ in range(effort.processes)]
    subject = f"{effort.rows} rows each"
    rows = []
    for name, bar, measure in (
        ("seconds", _SECONDS, "processor seconds to make"),
        ("megabytes", _MEGABYTES, "peak megabytes when made"),
        ("after_a_step", None, "peak megabytes after a step"),
        ("threads", _THREADS, "threads more"),
    ):
        rows.append(
            figure(measure, subject, statistics.median(one[name] for one in found), "", bar)
        )
    return rows


def main(
    quick: Quick = False,
    threads: Annotated[int, typer.Option(min=1, help="Of both sides.")] = Effort.threads,
    seconds: Annotated[float, typer.Option(min=0.1, help="Of the comparison.")] = Effort.seconds,
    json: Json = None,
) -> None:
    """Measure many tasks in one batch against a batch for each, and print whether bars are met."""
    effort = _QUICK if quick else Effort(threads=threads, seconds=seconds)
    typer.echo("measuring: making", err=True)
    rows = _making(effort)
    typer.echo("measuring: steps", err=True)
    rows.append(_speed(effort))
    finish(rows, "compared with", quick, json, dataclasses.asdict(effort))


if __name__ == "__main__":
    typer.run(main)
