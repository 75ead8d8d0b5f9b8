"""The units of a run: one part of one kind of comparison of one task.

for unit in planned(["humanoid:walk batches"]):
    print(compared(unit).difference)
"""

import functools
import time
import traceback
from typing import NamedTuple

from limberjack import registry
from tests.exactness.comparisons import KINDS, Tally, Task

__all__ = ["Result", "Unit", "compared", "cost", "planned"]

# Rough costs, which order the units and are corrected by what the finished ones took.
_SECONDS_OF_A_STEP, _SECONDS_OF_A_DOF = 50e-6, 5e-6


class Unit(NamedTuple):
    """A part of one kind of comparison of one task."""

    task: Task
    kind: str
    part: int

    def __str__(self) -> str:
        return f"{':'.join(self.task)} {self.kind} {self.part}"


class Result(NamedTuple):
    """The result of a unit; `difference` is "" if both packages agree."""

    unit: Unit
    comparisons: int
    steps: int
    difference: str
    core_seconds: float


@functools.cache
def _degrees_of_freedom() -> dict[tuple[str, str], int]:
    return {(row.domain, row.task): row.dof for row in registry.TASKS}


def planned(words: list[str]) -> list[Unit]:
    """Units whose names contain any of the words, all if there are none; the longest first."""
    units = [
        Unit(task, kind, part)
        for task in _degrees_of_freedom()
        for kind in KINDS
        for part in range(KINDS[kind].parts)
    ]
    chosen = [unit for unit in units if not words or any(word in str(unit) for word in words)]
    return sorted(chosen, key=cost, reverse=True)


def cost(unit: Unit) -> float:
    """Seconds that a unit takes on one core, roughly."""
    of_a_step = _SECONDS_OF_A_STEP + _SECONDS_OF_A_DOF * _degrees_of_freedom()[unit.task]
    return KINDS[unit.kind].steps * of_a_step


def compared(unit: Unit) -> Result:
    """The result of a unit; an error counts as a difference."""
    began = time.process_time()
    tally, difference = Tally(), ""
    try:
        tally = KINDS[unit.kind].compare(unit.task, unit.part)
    except AssertionError as error:
        difference = str(error)
    except Exception:
        difference = traceback.format_exc()
    seconds = time.process_time() - began
    return Result(unit, tally.comparisons, tally.steps, difference, seconds)
