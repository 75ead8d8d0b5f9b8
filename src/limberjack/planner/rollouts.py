"""`Rollouts`: simulations of plans in parallel, all from the same state.

rollouts = Rollouts(planning_physics, samples=64, num_threads=4, own_fields=("body_pos",))
rollouts.load(saved)
for controls in plans:
    rollouts.physics.set_control(controls)
    rollouts.step(2)
diverged = rollouts.diverged()

`Budget` chooses how many samples fit into a time budget.
"""

import time
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.simulation import NOT_FIELDS
from limberjack.utils.arrays import any_of

__all__ = ["Budget", "Rollouts", "state_of"]


class Rollouts:
    """See the module's docstring."""

    def __init__(
        self, physics: Any, samples: int, num_threads: int, own_fields: Sequence[str]
    ) -> None:
        """Makes as many simulations of a `Physics` as there are samples; see `replicate`."""
        replicas = physics.replicate(samples, num_threads, own_fields)
        self.physics = replicas.physics  # the batch, (samples, ...)
        self.simulation = replicas.simulation  # steps the batch
        self.single = replicas.single  # a single simulation of the same model

    def load(self, saved: Mapping[str, np.ndarray]) -> None:
        """Sets all simulations to the one saved state.

        Quantities that follow from the state are those of before, until they are stepped.
        """
        simulation = self.simulation
        values = {name: value for name, value in saved.items() if name not in NOT_FIELDS}
        simulation.set_fields({name: value[0] for name, value in values.items()})
        if simulation.remembers:  # such as the time for which bodies have been at rest
            simulation.reset()
        simulation.state[...] = saved["state"]

    def step(self, nstep: int) -> None:
        """Advances all of them by `nstep` time steps."""
        self.simulation.step(nstep)

    def forget_divergence(self) -> None:
        """Resets the record of divergence."""
        self.simulation.warnings[...] = 0

    def diverged(self) -> np.ndarray:
        """Whether each has diverged since `forget_divergence`, (samples,)."""
        warnings = self.simulation.warnings
        if not any_of(warnings):
            return np.zeros(len(warnings), bool)
        return warnings.any(axis=-1)

    def roll_out(
        self, controls: np.ndarray, fields: Sequence[str], out: dict[str, np.ndarray] | None = None
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Advances all by time steps whose controls are known, with a record of them.

        Threads take whole simulations, so that none waits for the others between steps. Afterwards
        all but the state may belong to the state before the last step.

        Args:
          controls: (samples, steps, nu).
          fields: of the data, to be recorded after each step.
          out: records of an earlier call of the same size, to be written over.

        Returns:
          The records by field, (samples, steps, ...) each, and which diverged, (samples,): those
          stop, and their last record is repeated.

        Raises:
          ValueError: a field cannot be recorded.
        """
        self.forget_divergence()
        time_item = mujoco.mjtState.mjSTATE_TIME.value
        items = {name: time_item if name == "time" else name for name in fields}
        given = {items[name]: array for name, array in (out or {}).items() if name in items}
        record = list(items.values())
        found = self.simulation.call_directly(
            lambda batch: batch.rollout(controls.shape[1], controls, record=record, out=given)
        )
        return {name: found[item] for name, item in items.items()}, self.diverged()


def state_of(physics: Any, fields: Sequence[str]) -> dict[str, np.ndarray]:
    """The current state of a single simulation, and fields of its model, for `load`."""
    saved = physics.simulation.save(None, fields)
    return {name: value for name, value in saved.items() if name not in ("before", "call")}


class Budget:
    """Number of samples of a planning step that fit into a time budget.

    Depends on the clock, so what is planned within a budget cannot be repeated.
    """

    def __init__(self, max_ms: float, sizes: Sequence[int]) -> None:
        """Args: max_ms: milliseconds of a planning step; sizes: numbers of samples to choose from.

        Raises:
          ValueError, TypeError: max_ms is not a positive number.
        """
        if isinstance(max_ms, bool) or not isinstance(max_ms, int | float | np.number):
            raise TypeError(f"max_ms is of type {type(max_ms).__name__}; expected a number")
        if not (np.isfinite(max_ms) and max_ms > 0):
            raise ValueError(f"max_ms is {max_ms!r}; expected a positive number of milliseconds")
        self._seconds, self._sizes = 1e-3 * float(max_ms), sorted(sizes)
        self._per_sample: float | None = None  # seconds
        self._began = self._simulated = 0.0

    def begin(self) -> None:
        """Begins a planning step."""
        self._began = time.perf_counter()

    def size(self) -> int:
        """The number of samples for the time that is left of this planning step.

        The fewest if nothing has been measured or none fit.
        """
        self._simulated = time.perf_counter()
        left = self._began + self._seconds - self._simulated
        per_sample = np.inf if self._per_sample is None else self._per_sample
        fitting = [size for size in self._sizes if size * per_sample <= left]
        return max(fitting, default=self._sizes[0])

    def spent(self, size: int) -> None:
        """Ends the planning step, of which `size` samples were simulated since `size()`."""
        latest = (time.perf_counter() - self._simulated) / size
        before = latest if self._per_sample is None else self._per_sample
        self._per_sample = before + 0.2 * (latest - before)  # a running mean
