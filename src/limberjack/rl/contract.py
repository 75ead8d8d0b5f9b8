"""What an `Environment` is made of: the contracts of `Physics` and `Task`.

Programs take them from `limberjack.rl.control`. A task names the physics that it reads:

    class SwingUp(control.Task[Pole]):
        def get_reward(self, physics: Pole) -> float: ...
"""

import abc
import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from limberjack.utils.arrays import Quantity

__all__ = [
    "Drawn",
    "Nested",
    "Observation",
    "Physics",
    "PhysicsError",
    "SimulatedPhysics",
    "Simulation",
    "Task",
]

# An action or a spec is an array or a nested structure of arrays, as the task likes.
Nested = Any
Observation = Mapping[str, Quantity]


class PhysicsError(RuntimeError):
    """The simulation diverged: its state is no longer meaningful."""


class Physics(abc.ABC):
    """What an `Environment` and a `Task` need of a simulation."""

    # Whether position and velocity dependent quantities are up to date after a step
    # (https://arxiv.org/abs/2006.12983, page 6).
    legacy_step: bool = True

    @abc.abstractmethod
    def step(self, n_sub_steps: int = 1) -> None:
        """Advances the simulation by `n_sub_steps` time steps."""

    @abc.abstractmethod
    def time(self) -> float:
        """Simulated time since the reset, seconds."""

    @abc.abstractmethod
    def timestep(self) -> float:
        """Length of one time step, seconds."""

    def set_control(self, control: Nested) -> None:
        """Sets the control signals of the actuators."""
        raise NotImplementedError(f"{type(self).__name__} does not define set_control")

    @contextlib.contextmanager
    def reset_context(self) -> Iterator["Physics"]:
        """Resets on entry; on exit makes every quantity follow the state set within."""
        # A model whose default state diverges can still be given a good one.
        with contextlib.suppress(PhysicsError):
            self.reset()
        yield self
        self.after_reset()

    @abc.abstractmethod
    def reset(self) -> None:
        """Returns the simulation to its default state."""

    @abc.abstractmethod
    def after_reset(self) -> None:
        """Makes every quantity follow the state, without advancing time."""

    def check_divergence(self) -> None:  # noqa: B027 (an optional hook)
        """Raises `PhysicsError` if the state has diverged. Does nothing by default."""


class Simulation(Protocol):
    """What steps a physics, as far as snapshots need it; see `limberjack.mujoco.simulation`."""

    def save(self, rows: np.ndarray | None, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """All that the future of rows depends on, by name, (n, ...) each; 'state' is the state."""
        ...

    def load(self, saved: Mapping[str, np.ndarray], rows: np.ndarray | None = None) -> None:
        """Makes rows go on as those that were saved."""
        ...

    def set_fields(self, values: Mapping[str, np.ndarray], row: int | None = None) -> None:
        """Sets fields of the model, and the constants that follow from them, for one row."""
        ...


class Drawn(Protocol):
    """What pictures are drawn of: a single simulation or the rows of a batch."""

    @property
    def num_envs(self) -> int | None:
        """Number of rows; None for a single simulation."""
        ...

    # Keyword arguments of `limberjack.mujoco.Physics.render`, which checks them.
    def render_rows(self, rows: np.ndarray | None, **kwargs: Any) -> np.ndarray:
        """Pictures of rows, all for None."""
        ...

    def picture_spec(self, **kwargs: Any) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and type of the picture of one row."""
        ...


class SimulatedPhysics(Drawn, Protocol):
    """What snapshots, randomisation and batches need of a physics beside `Physics`.

    `limberjack.mujoco.Physics` has it, of one simulation or of a batch of them.
    """

    legacy_step: bool

    @property
    def simulation(self) -> Simulation:
        """What steps, saves and loads."""
        ...

    # Wrappers of the official structs, whose fields are not listed here.
    @property
    def model(self) -> Any:
        """The model."""
        ...

    @property
    def data(self) -> Any:
        """The state and all quantities computed from it."""
        ...

    def nominal_fields(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """The model's present values of fields that are going to be randomised."""
        ...

    def origin(self, varying: Sequence[str] = ()) -> dict[str, object]:
        """What must agree for a saved row to be loaded."""
        ...

    def timestep(self) -> float:
        """Length of one time step, seconds."""
        ...

    def step(self, nstep: int = 1) -> None:
        """Advances the simulation."""
        ...

    def after_reset(self) -> None:
        """Makes every quantity follow the state."""
        ...


_Physics = TypeVar("_Physics", bound=Physics)


class Task(abc.ABC, Generic[_Physics]):
    """What an episode starts from, what the agent sees, what it is rewarded for."""

    # The stream that episodes are drawn from; environments give a batch's task each row's.
    _random: np.random.RandomState

    @abc.abstractmethod
    def initialize_episode(self, physics: _Physics) -> None:
        """Sets the state an episode starts from, within `physics.reset_context()`."""

    @abc.abstractmethod
    def before_step(self, action: Nested, physics: _Physics) -> None:
        """Applies the action, before the physics is stepped."""

    def after_step(self, physics: _Physics) -> None:
        """Called after the physics is stepped, before anything is read."""

    @abc.abstractmethod
    def action_spec(self, physics: _Physics) -> Nested:
        """A `dm_env.specs.BoundedArray` of valid actions, or a nested structure of them."""

    def step_spec(self, physics: _Physics) -> Nested:
        """A spec of what `step` returns; tasks need not define it."""
        raise NotImplementedError(f"{type(self).__name__} does not define step_spec")

    @abc.abstractmethod
    def get_observation(self, physics: _Physics) -> Observation:
        """The observation: a mapping from names to arrays."""

    @abc.abstractmethod
    def get_reward(self, physics: _Physics) -> Quantity:
        """The reward of the last step."""

    def get_termination(self, physics: _Physics) -> Quantity | None:
        """The final discount if the episode ends here, None if it goes on.

        In a batch, (num_envs,): NaN in rows whose episode goes on.
        """
        return None

    def observation_spec(self, physics: _Physics) -> Nested:
        """The spec of the observation; left undefined, it is read off an observation."""
        raise NotImplementedError(f"{type(self).__name__} does not define observation_spec")
