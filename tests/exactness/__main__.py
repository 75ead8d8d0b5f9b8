"""Compares every task with dm_control at length; continues where an earlier run was interrupted.

    python -m tests.exactness                          # everything, as `make test-exactness`
    python -m tests.exactness reacher:easy batches     # units whose names contain a word
    python -m tests.exactness --list

Finished units are stored in build/exactness.jsonl and skipped by the next run, until a version or
the source changes; units with a difference run again. At the end of a whole run the numbers of
comparisons and steps, by task and kind, are written to benchmarks/results/exactness.json.

The exit status is 0 if both packages agree in every bit, 1 if they differ, and 130 after Ctrl-C.
Before anything else, a difference is planted into a few comparisons, which must find it.
"""

import argparse
import concurrent.futures
import ctypes.util
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

# dm_control chooses when it is imported, and fails where its first choice, a window, cannot open.
if "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = "egl" if ctypes.util.find_library("EGL") else "disable"

from limberjack.utils.cores import usable_cores
from tests.exactness.comparisons import self_check
from tests.exactness.ledger import Ledger, fingerprint
from tests.exactness.units import Result, Unit, compared, cost, planned

_REPOSITORY = Path(__file__).parents[2]
_LEDGER = _REPOSITORY / "build" / "exactness.jsonl"
_SUMMARY = _REPOSITORY / "benchmarks" / "results" / "exactness.json"

# Then all processes are replaced, and what they kept is freed. The executor's own
# max_tasks_per_child is of no use: with Python 3.11, such an executor hangs after so many units.
_UNITS_OF_A_PROCESS = 20


def _executor(processes: int) -> concurrent.futures.Executor:
    return concurrent.futures.ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"))


def _results(todo: list[Unit], processes: int) -> Iterator[Result]:
    """The results of units, as they are finished."""
    size = processes * _UNITS_OF_A_PROCESS
    for first in range(0, len(todo), size):
        executor = _executor(processes)
        try:
            running = [executor.submit(compared, unit) for unit in todo[first : first + size]]
            for future in concurrent.futures.as_completed(running):
                yield future.result()
        finally:
            executor.shutdown(cancel_futures=True)


def run(plan: list[Unit], ledger: Ledger, processes: int) -> None:
    """Runs the units of the plan that the ledger lacks, and prints each result."""
    todo = [unit for unit in plan if not ledger.passed(unit)]
    print(f"{len(plan)} units, {len(plan) - len(todo)} of them finished before", flush=True)
    began, finished = time.monotonic(), 0.0
    left = sum(map(cost, todo))  # in seconds as predicted, like `finished`
    for number, result in enumerate(_results(todo, processes), 1):
        ledger.add(result)
        finished, left = finished + cost(result.unit), left - cost(result.unit)
        minutes = max(0.0, (time.monotonic() - began) * left / finished / 60)
        progress = f"{number} of {len(todo)}, about {minutes:.0f} min left"
        verdict = f"DIFFERS\n  {result.difference}" if result.difference else "equal"
        print(f"{progress:32} {result.unit!s:45} {result.steps:8} steps {verdict}", flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Runs the units named on the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("words", nargs="*", help="parts of the names of units; all without any")
    parser.add_argument("--list", action="store_true", help="print the units and run none")
    parser.add_argument(
        "--processes", type=int, default=usable_cores(), help="all cores by default"
    )
    parser.add_argument("--ledger", type=Path, default=_LEDGER, help="the file of finished units")
    parser.add_argument("--summary", type=Path, help="the JSON to write; by default of a whole run")
    options = parser.parse_args(arguments)
    plan = planned(options.words)
    if options.list:
        print(*plan, sep="\n")
        return 0
    found = self_check()
    print(*(f"planted into {kind} and found: {what}" for kind, what in found.items()), sep="\n")
    ledger = Ledger(options.ledger, fingerprint())
    try:
        run(plan, ledger, options.processes)
    except KeyboardInterrupt:
        print("interrupted; the same command continues with the units that are not finished")
        return 130
    summary = ledger.summary(plan, found)
    path = options.summary or (None if options.words else _SUMMARY)
    if path is not None:
        path.write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    counts = ("comparisons", "steps", "differences", "core_minutes")
    print(", ".join(f"{summary[name]} {name.replace('_', ' ')}" for name in counts))
    return 1 if summary["differences"] else 0


if __name__ == "__main__":
    sys.exit(main())
