"""The contracts of `Physics` and `Task`, the parts of an `Environment`.

Programs import them from `limberjack.rl.control`. A task specifies its class of physics:

    class SwingUp(control.Task[Pole]):
        def get_reward(self, physics: Pole) -> float: ...
"""

import abc
import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from limberjack.utils.arrays import Quantity
from limberjack.worlds.appearance.looks import Look
from limberjack.worlds.faults import Recompiles

__all__ = [
    "Drawn",
    "Nested",
    "Observation",
    "Physics",
    "PhysicsError",
    "SimulatedPhysics",
    "Simulation",
    "Task",
    "check_ending",
]

# Any: an action or a spec is an array or a nested structure of arrays, chosen by the task.
Nested = Any
Observation = Mapping[str, Quantity]


class PhysicsError(RuntimeError):
    """The simulation diverged: its state is no longer meaningful."""


class Physics(abc.ABC):
    """The interface of a simulation for `Environment` and `Task`."""

    # Whether quantities that depend on positions and velocities are up to date after a step
    # (https://arxiv.org/abs/2006.12983, page 6).
    legacy_step: bool = True

    @abc.abstractmethod
    def step(self, n_sub_steps: int = 1) -> None:
        """Advances the simulation by `n_sub_steps` time steps."""

    @abc.abstractmethod
    def time(self) -> float:
        """Simulated time since the last reset, seconds."""

    @abc.abstractmethod
    def timestep(self) -> float:
        """Length of one time step, seconds."""

    def set_control(self, control: npt.ArrayLike) -> None:
        """Sets the control signals of the actuators."""
        raise NotImplementedError(f"{type(self).__name__} does not define set_control")

    @contextlib.contextmanager
    def reset_context(self) -> Iterator["Physics"]:
        """Resets on entry; on exit recomputes all quantities from the state set within."""
        # The default state of a model may diverge, and the body of the context replaces it.
        with contextlib.suppress(PhysicsError):
            self.reset()
        yield self
        self.after_reset()

    @abc.abstractmethod
    def reset(self) -> None:
        """Returns the simulation to its default state."""

    @abc.abstractmethod
    def after_reset(self) -> None:
        """Recomputes all quantities from the state, without advancing time."""

    def check_divergence(self) -> None:  # noqa: B027 (an optional hook)
        """Raises `PhysicsError` if the state has diverged; by default does nothing."""


class Simulation(Protocol):
    """The parts of `limberjack.mujoco.simulation.Simulation` that snapshots need."""

    # Whether model constants must be recomputed (mj_setConst) after episodes set fields.
    sets_constants: bool
    # With which a single simulation is drawn; None for the look of the model.
    look: Look | None

    def save(self, rows: np.ndarray | None, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """Everything that the future of rows depends on, by name, (n, ...) each."""
        ...

    def load(self, saved: Mapping[str, np.ndarray], rows: np.ndarray | None = None) -> None:
        """Makes rows continue as the saved ones."""
        ...

    def set_fields(self, values: Mapping[str, np.ndarray], row: int | None = None) -> None:
        """Sets model fields and recomputes the constants derived from them, for one row."""
        ...

    def set_constants(self, rows: np.ndarray | None = None) -> None:
        """Recomputes the constants derived from model fields that were set in another way."""
        ...


class Drawn(Protocol):
    """A single simulation or batch that can be rendered."""

    @property
    def num_envs(self) -> int | None:
        """Number of rows; None for a single simulation."""
        ...

    def render_rows(self, rows: np.ndarray | None, **kwargs: object) -> np.ndarray:
        """Pictures of rows, None for all; `kwargs` as of `limberjack.mujoco.Physics.render`."""
        ...

    def picture_spec(self, **kwargs: object) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and dtype of the picture of one row."""
        ...


class SimulatedPhysics(Drawn, Protocol):
    """The interface that snapshots, randomisation and batches need in addition to `Physics`.

    `limberjack.mujoco.Physics` implements it, for a single simulation and for a batch.
    """

    legacy_step: bool
    replaced: tuple[str, ...]

    @property
    def simulation(self) -> Simulation:
        """The simulation that steps, saves and loads."""
        ...

    # Wrappers of the official structs, whose fields are not listed here.
    @property
    def model(self) -> Any:
        """The model."""
        ...

    @property
    def data(self) -> Any:  # the official struct's fields are not listed anywhere
        """The state and all quantities derived from it."""
        ...

    def nominal_fields(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Current model values of the fields to be randomised."""
        ...

    def recompute_constants_of(self, names: Sequence[str]) -> None:
        """Makes starts that set these fields recompute the constants derived from them."""
        ...

    def recompiler(self) -> Recompiles:
        """Compiles the model again with changes of its MJCF."""
        ...

    def identity(self, varying: Sequence[str] = ()) -> dict[str, object]:
        """Facts that must match for a saved row to load."""
        ...

    def timestep(self) -> float:
        """Length of one time step, seconds."""
        ...

    def step(self, nstep: int = 1) -> None:
        """Advances the simulation."""
        ...

    def after_reset(self) -> None:
        """Recomputes all quantities from the state."""
        ...


_Physics = TypeVar("_Physics", bound=Physics)


class Task(abc.ABC, Generic[_Physics]):
    """Defines the starts of episodes, the observations and the reward."""

    # The stream from which episodes are drawn; a batch sets each row's stream in turn.
    _random: np.random.RandomState

    def begin_stream(self, random: np.random.RandomState) -> Mapping[str, np.ndarray]:
        """Model fields that belong to a random stream, by name; by default none.

        Called once for each stream, before its first episode. The fields must be declared in
        EPISODE_FIELDS. Constants that MuJoCo derives from them are not recomputed.

        Args:
          random: the stream, from which the values may be drawn.
        """
        return {}

    @abc.abstractmethod
    def initialize_episode(self, physics: _Physics) -> None:
        """Sets an episode's initial state, within `physics.reset_context()`."""

    @abc.abstractmethod
    def before_step(self, action: Nested, physics: _Physics) -> None:
        """Applies the action; called before the physics is stepped."""

    def after_step(self, physics: _Physics) -> None:
        """Called after the physics is stepped, before reward and observation are computed."""

    @abc.abstractmethod
    def action_spec(self, physics: _Physics) -> Nested:
        """A `dm_env.specs.BoundedArray` of valid actions, or a nested structure of them."""

    def step_spec(self, physics: _Physics) -> object:
        """A spec of the result of `step`; optional."""
        raise NotImplementedError(f"{type(self).__name__} does not define step_spec")

    @abc.abstractmethod
    def get_observation(self, physics: _Physics) -> Observation:
        """The observation, a mapping from names to arrays."""

    @abc.abstractmethod
    def get_reward(self, physics: _Physics) -> Quantity:
        """The reward of the last step."""

    def get_termination(self, physics: _Physics) -> Quantity | None:
        """The final discount if the episode ends here, None or NaN if it continues.

        In a batch, an array of (num_envs,), NaN in rows whose episode continues.
        """
        return None

    def observation_spec(self, physics: _Physics) -> Nested:
        """Spec of the observation; by default it is derived from an observation."""
        raise NotImplementedError(f"{type(self).__name__} does not define observation_spec")


def check_ending(task: object, ending: object) -> None:
    """Raises TypeError for a result of `get_termination` that says whether, and not how, to end."""
    if np.asarray(ending).dtype == bool:
        raise TypeError(
            f"get_termination of task {type(task).__name__} returned {ending!r}; expected None or "
            "NaN while the episode continues, and the discount, such as 0.0, when it ends: "
            "np.where(fallen, 0.0, np.nan)"
        )
