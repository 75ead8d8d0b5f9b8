"""`Ledger`: the finished units of a run in a file, so that an interrupted run continues.

    ledger = Ledger(path, fingerprint())
    if not ledger.passed(unit):
        ledger.add(compared(unit))
    ledger.summary(plan, self_check())

The file begins with the fingerprint of everything that results depend on: the source of the
simulation and of the comparisons, and the versions. A file with another fingerprint is replaced.
"""

import hashlib
import importlib.metadata
import json
import os
import platform
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tests.exactness.comparisons import KINDS
from tests.exactness.units import Result, Unit

__all__ = ["Ledger", "fingerprint", "versions"]

_REPOSITORY = Path(__file__).parents[2]
_SOURCES = (
    *(f"src/limberjack/{part}" for part in ("gym", "mujoco", "registry", "rl", "suite", "utils")),
    "tests/exactness",
    "tests/oracle/rows.py",
    "tests/oracle/same.py",
    "tests/oracle/twins.py",
)
_PACKAGES = ("mujoco", "dm_control", "numpy", "dm-env", "gymnasium")


def versions() -> dict[str, str]:
    """The versions of all packages that results depend on, and of Python."""
    found = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return {"python": platform.python_version(), **found}


def fingerprint() -> str:
    """A digest of the versions, the processor's architecture and the source."""
    digest = hashlib.sha256(json.dumps([versions(), platform.machine()]).encode())
    for source in _SOURCES:
        path = _REPOSITORY / source
        texts = [*path.rglob("*.py"), *path.rglob("*.xml")]
        files = [path] if path.is_file() else sorted(texts)
        for file in files:
            digest.update(file.read_bytes())
    return digest.hexdigest()


class Ledger:
    """Results, in memory and in a file."""

    def __init__(self, path: Path, expected: str) -> None:
        """Reads the results in the file if it has the fingerprint, else begins a new one."""
        self.results: dict[Unit, Result] = {}
        self._path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        if lines[:1] != [expected]:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(expected + "\n", encoding="utf-8")
            lines = []
        for line in lines[1:]:
            (task, *rest), *values = json.loads(line)
            result = Result(Unit(tuple(task), *rest), *values)
            self.results[result.unit] = result

    def passed(self, unit: Unit) -> bool:
        """Whether the unit was finished without a difference."""
        return unit in self.results and not self.results[unit].difference

    def add(self, result: Result) -> None:
        """Stores a result in the file at once."""
        self.results[result.unit] = result
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(result) + "\n")

    def summary(self, plan: Iterable[Unit], self_check: dict[str, str]) -> dict[str, Any]:
        """The results of the plan by task and kind, with versions and machine."""
        chosen = [self.results[unit] for unit in plan]
        tasks: dict[str, dict[str, Any]] = {}
        for result in chosen:
            task, kind, _ = result.unit
            empty = {"comparisons": 0, "steps": 0, "core_minutes": 0.0, "first_difference": None}
            entry = tasks.setdefault(":".join(task), {}).setdefault(kind, empty)
            entry["comparisons"] += result.comparisons
            entry["steps"] += result.steps
            entry["core_minutes"] = round(entry["core_minutes"] + result.core_seconds / 60, 2)
            entry["first_difference"] = entry["first_difference"] or result.difference or None
        return {
            "date": time.strftime("%Y-%m-%d"),
            "machine": {"processor": _processor(), "cores": os.cpu_count()},
            "versions": versions(),
            "kinds": {name: (kind.compare.__doc__ or "").strip() for name, kind in KINDS.items()},
            "self_check": self_check,
            "core_minutes": round(sum(result.core_seconds for result in chosen) / 60, 1),
            "comparisons": sum(result.comparisons for result in chosen),
            "steps": sum(result.steps for result in chosen),
            "differences": sum(bool(result.difference) for result in chosen),
            "tasks": tasks,
        }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
