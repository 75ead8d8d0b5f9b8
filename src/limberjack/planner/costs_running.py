"""What the planner does for a humanoid that runs: it goes on as it went, and rushes.

The cost is that of walking, at a speed that is hardly reached. In a gait, what comes next is what
the other side did a step before. So plans are continued beyond their end, and repeated steps are
proposed from the present on too, a little quicker and larger.
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.costs_humanoid import GOING, Move, actuators
from limberjack.planner.gait import Gait
from limberjack.planner.tracking import targets_at

__all__ = ["Run"]

_AIM = 4.0  # metres per second; who is faster gains little, and falls
_CONTROL_STEP = 0.025  # seconds; the task's
_FALL = 5.0  # what an imbalance of a metre costs besides; a tenth of one belongs to running
_HASTE = 6.0  # what a full lack of speed costs

# Of a foot that strikes the ground, what is foreseen with longer time steps is too wrong: it falls.
_RUNNING = dataclasses.replace(
    GOING, knots=7, anchored=True, timestep=_CONTROL_STEP / 3, temperature=0.15
)
_STEP = 14  # control steps from one foot's strike to the other's: 0.35 s, as a human runs
_REPEATS = 12  # proposed at each planning
_QUICKER = (0.95, 1.1)  # times the rate at which it went
_LARGER = (0.95, 1.2)  # times how far the targets went from their middle


class Run(Move):
    """Stands up, and runs as fast as it can."""

    def __init__(self, task: Any) -> None:
        """Takes a `humanoid.Humanoid` task."""
        super().__init__(task)
        self._aim, self._haste = _AIM, _HASTE
        self.settings = _RUNNING
        self._per_knot = self.settings.spacing / _CONTROL_STEP  # control steps
        self._gait: Gait | None = None  # while it goes

    def reset(self) -> None:
        """Stands up first."""
        super().reset()
        self._gait = None

    def look(self, physics: Any) -> None:
        """Goes once it stands, until it falls."""
        super().look(physics)
        if not self._goes:
            self._gait = None
        elif self._gait is None:
            self._gait = Gait(actuators(physics))

    def followed(self, targets: np.ndarray) -> None:
        """Remembers how it goes."""
        if self._gait is not None:
            self._gait.do(targets)

    def continued(self, plan: np.ndarray) -> np.ndarray:
        """What the other side does a step before, (nu,)."""
        if self._gait is None:
            return super().continued(plan)
        return self._gait.mirrored(targets_at(plan, len(plan) - _STEP / self._per_knot))

    def _imbalance(self, forward: np.ndarray, sideways: np.ndarray) -> np.ndarray:
        """As for walking, and more where it ends in a fall."""
        return super()._imbalance(forward, sideways) + _FALL * (forward**2 + sideways**2)

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Its own steps again, once there are some; until then as for walking."""
        if self._gait is None or len(self._gait) < 2 * _STEP:
            return super().proposals(physics, random)
        times = self._per_knot * (np.arange(self.settings.knots) - self.place)
        middle = self._gait.middle(_STEP)
        found = [self._gait.repeated(times, _STEP)]
        for _ in range(_REPEATS - 1):
            step = _STEP + int(random.integers(-1, 2))
            again = self._gait.repeated(times * random.uniform(*_QUICKER), step)
            found.append(middle + random.uniform(*_LARGER) * (again - middle))
        return np.array(found)
