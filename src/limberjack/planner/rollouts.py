"""`Rollouts`: simulations of plans in parallel, all from the same state.

rollouts = Rollouts(planning_physics, samples=64, num_threads=4, own_fields=("body_pos",))
rollouts.load(saved)
for controls in plans:
    rollouts.physics.set_control(controls)
    rollouts.step(2)
diverged = rollouts.diverged()
"""

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.simulation import NOT_FIELDS
from limberjack.utils.arrays import any_of

__all__ = ["Rollouts", "state_of"]

_TIME = mujoco.mjtState.mjSTATE_TIME.value
_NOT_LOADED = ("before", "call")


class Rollouts:
    """See the module's docstring.

    Attributes:
      physics: the batch, (samples, ...).
      simulation: steps the batch.
      single: a single simulation of the same model.
    """

    def __init__(
        self, physics: Any, samples: int, num_threads: int, own_fields: Sequence[str]
    ) -> None:
        """Makes as many simulations of a `Physics` as there are samples; see `replicate`."""
        replicas = physics.replicate(samples, num_threads, own_fields)
        self.physics, self.single = replicas.physics, replicas.single
        self.simulation = replicas.simulation

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
        items = {name: _TIME if name == "time" else name for name in fields}
        given = {items[name]: array for name, array in (out or {}).items() if name in items}
        record = list(items.values())
        found = self.simulation.call_directly(
            lambda batch: batch.rollout(controls.shape[1], controls, record=record, out=given)
        )
        return {name: found[item] for name, item in items.items()}, self.diverged()


def state_of(physics: Any, fields: Sequence[str]) -> dict[str, np.ndarray]:
    """The current state of a single simulation, and fields of its model, for `load`."""
    saved = physics.simulation.save(None, fields)
    return {name: value for name, value in saved.items() if name not in _NOT_LOADED}
