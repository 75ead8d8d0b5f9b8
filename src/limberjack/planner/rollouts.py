"""`Rollouts`: simulations of plans in parallel, all from the same state.

    rollouts = Rollouts(planning_physics, samples=64, num_threads=4, own_fields=("body_pos",))
    rollouts.load(saved)
    diverged = law.follow(rollouts, plans, phases, substeps=4, interval=1)
    rollouts.seen.head_height()  # (states * samples,), of the states that were recorded

`Budget` chooses how many samples fit into a time budget.
"""

import time
from collections.abc import Mapping, Sequence

import mujoco
import mujoco.batch
import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.simulation import model_fields
from limberjack.planner.history import History

__all__ = ["Budget", "Rollouts"]


class Rollouts:
    """Simulations of plans; see the module's docstring.

    Attributes:
      physics: the simulations, (samples, ...).
      simulation: steps them.
      history: the record of their states.
      seen: the recorded states as a physics, (states * samples, ...), to be read only.
      at_horizon: the last of these, (samples, ...).
    """

    def __init__(
        self,
        physics: Physics,
        samples: int,
        num_threads: int,
        own_fields: Sequence[str],
        states: int = 1,
    ) -> None:
        """Makes as many simulations of a `Physics` as samples, with a record of `states` states."""
        replicas = physics.replicate(samples, num_threads, own_fields)
        self.physics, self.simulation = replicas.physics, replicas.simulation
        self.history = History(self.simulation, states)
        self.seen = self.history.read_by(self.physics)
        self.at_horizon = self.history.last_read_by(self.physics)
        self._failed = np.zeros(samples, bool)
        self._records: dict[str, np.ndarray] = {}  # of `roll_out`, written over by the next one

    def load(self, saved: Mapping[str, np.ndarray]) -> None:
        """Sets all simulations to the one saved state, in which none has diverged.

        Quantities that follow from the state are those of before, until they are stepped.
        """
        simulation = self.simulation
        simulation.set_fields({name: value[0] for name, value in model_fields(saved).items()})
        if simulation.remembers:  # such as the time for which bodies have been at rest
            simulation.reset()
        simulation.state[...] = saved["state"]
        simulation.warnings[...] = 0
        self._failed[:] = False

    def step(self, substeps: int) -> None:
        """Advances all by time steps; those in which MuJoCo raises an error stay and have diverged.

        A body that falls apart can have more contacts than MuJoCo has memory for.
        """
        try:
            self.simulation.step(substeps)
        except mujoco.batch.SimulationError as error:
            self._failed[error.ids] = True

    def diverged(self) -> np.ndarray:
        """Whether each has diverged since `load`, (samples,)."""
        return np.asarray(self.simulation.warnings.any(axis=-1) | self._failed)

    def roll_out(
        self, controls: np.ndarray, fields: Sequence[str]
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Advances all by time steps with controls, (samples, steps, nu), and records fields.

        Threads take whole simulations, so that none waits for the others between steps. Afterwards
        all but the state may belong to the state before the last step.

        Returns:
          The records by field, (samples, steps, ...) each, until the next call; and which diverged,
          (samples,): those stop, and their last record is repeated.

        Raises:
          ValueError: a field cannot be recorded.
        """
        time_item = mujoco.mjtState.mjSTATE_TIME.value
        items = {name: time_item if name == "time" else name for name in fields}
        record, steps = list(items.values()), controls.shape[1]
        before = {items[name]: array for name, array in self._records.items() if name in items}
        out = {item: array for item, array in before.items() if array.shape[1] == steps}
        found = self.simulation.call_directly(
            lambda batch: batch.rollout(steps, controls, record=record, out=out)
        )
        self._records = {name: found[item] for name, item in items.items()}
        return dict(self._records), self.diverged()


class Budget:
    """Number of samples of a planning step that fit into a time budget.

    Depends on the clock, so what is planned within a budget cannot be repeated.

    Attributes:
      sizes: numbers of samples to choose from.
    """

    def __init__(self, max_ms: float | None, samples: int) -> None:
        """All samples, or with a limit of milliseconds at least an eighth of them.

        Raises:
          ValueError, TypeError: max_ms is not a positive number.
        """
        if max_ms is None:
            self.sizes, self._seconds = [samples], np.inf
        elif isinstance(max_ms, bool) or not isinstance(max_ms, int | float | np.number):
            raise TypeError(f"max_ms is of type {type(max_ms).__name__}; expected a number")
        elif not (np.isfinite(max_ms) and max_ms > 0):
            raise ValueError(f"max_ms is {max_ms!r}; expected a positive number of milliseconds")
        else:
            self.sizes = sorted({max(2, samples // part) for part in (1, 2, 4, 8)})
            self._seconds = 1e-3 * float(max_ms)
        self._per_sample = np.inf  # seconds; not measured yet
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
        fitting = [size for size in self.sizes if size * self._per_sample <= left]
        return max(fitting, default=self.sizes[0])

    def spent(self, size: int) -> None:
        """Ends the planning step, of which `size` samples were simulated since `size()`."""
        latest = (time.perf_counter() - self._simulated) / size
        before = latest if np.isinf(self._per_sample) else self._per_sample
        self._per_sample = before + 0.2 * (latest - before)  # a running mean
