"""`Replicas`: many simulations of one physics, driven row by row.

    replicas = physics.replicate(num_envs=256, num_threads=8, own_fields=("body_pos",))
    for row in range(256):
        with replicas.episode(row) as one:
            task.initialize_episode(one)
    replicas.start(np.arange(256))
    diverged = replicas.step(None, 5)
    task.get_observation(replicas.physics)     # (256, ...) each

`physics` is of the same class as the one that was replicated, so that what a domain measures on it
carries the leading axis of rows. `single` is a single simulation of the same model without its
textures, in which rows are begun, one after the other.
"""

import contextlib
import functools
import weakref
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

import mujoco
import numpy as np

from limberjack.mujoco import drawing
from limberjack.mujoco.batch_simulation import BatchSimulation
from limberjack.mujoco.simulation import STATE, Rows, read_field
from limberjack.rl.contract import PhysicsError
from limberjack.utils.arrays import any_of

__all__ = ["Replicas"]

# A `Physics`, which this file cannot import, as that one imports it.
_P = TypeVar("_P", bound=Any)


class Replicas(Generic[_P]):
    """See the module's docstring."""

    def __init__(
        self, physics: _P, num_envs: int, num_threads: int, own_fields: Sequence[str]
    ) -> None:
        """Makes simulations of a physics' model, in the model's default state.

        Args:
          physics: a single simulation; it is left alone.
          num_envs: number of rows.
          num_threads: threads that step them, the caller's included.
          own_fields: fields of the model that each row has for itself.
        """
        model = physics.model
        # Copies cost nothing while the models are not changed: no change reaches another one.
        simulation = BatchSimulation(model.copy(), num_envs, num_threads, own_fields)
        self.simulation = simulation
        self.num_envs, self.num_threads = num_envs, num_threads
        self.physics: _P = physics.seen_through(simulation)
        self.single: _P = type(physics).from_model(model.without_textures())
        for each in (self.physics, self.single):
            self._set_up(each, physics)
        simulation.forget_arrays = weakref.WeakMethod(self.physics._forget_arrays)

    @functools.cached_property
    def textured(self) -> _P:
        """As `single`, with textures: for pictures, and to make other replicas of."""
        one = type(self.single).from_model(self.simulation.model.copy())
        self._set_up(one, self.single)
        return one

    @staticmethod
    def _set_up(one: _P, like: _P) -> None:
        """Has one physics run as another one is."""
        one.legacy_step = like.legacy_step
        one.simulation.sets_constants = like.simulation.sets_constants

    @contextlib.contextmanager
    def episode(self, row: int) -> Iterator[_P]:
        """Yields `single`, reset, whose state at exit is the start of the row's episode.

        The row's quantities follow with `start`.
        """
        one, simulation = self.single, self.simulation
        self._take_fields(one, row)
        with contextlib.suppress(PhysicsError):
            one.reset()
        yield one
        model = one.model._model
        for name, values in simulation.own_fields.items():
            values[row] = read_field(model, name)
        mujoco.mj_getState(model, one.data._data, simulation.state[row], STATE)

    def start(self, rows: np.ndarray) -> None:
        """Computes every quantity of rows whose episode begins, with actuation disabled."""
        self.simulation.forward_without_actuation(rows)

    def step(self, rows: Rows, nstep: int) -> np.ndarray:
        """Advances rows, all for None, by time steps; returns which diverged, (num_envs,)."""
        simulation = self.simulation
        simulation.warnings[...] = 0
        if self.physics.legacy_step:
            simulation.step(nstep, rows)
        else:
            simulation.step_whole(nstep, rows)
        if not any_of(simulation.warnings):
            return np.zeros(self.num_envs, bool)
        return np.any(simulation.warnings, axis=-1)

    def render_rows(self, rows: Rows, **kwargs: Any) -> np.ndarray:
        """Pictures of rows, (n, height, width, ...).

        Args:
          rows: row numbers, None for all.
          kwargs: of `Physics.render`.

        Raises:
          ValueError, TypeError: see `picture_spec`.
          RenderingError: OpenGL cannot be had.
        """
        drawing.check_names(kwargs)
        numbers = range(self.num_envs) if rows is None else rows.tolist()
        if not numbers:
            shape, dtype = self.picture_spec(**kwargs)
            return np.empty((0, *shape), dtype)
        first = self.shown(numbers[0]).render(**kwargs)
        pictures = np.empty((len(numbers), *first.shape), first.dtype)
        pictures[0] = first
        for picture, row in zip(pictures[1:], numbers[1:], strict=True):
            picture[...] = self.shown(row).render(**kwargs)
        return pictures

    def picture_spec(self, **kwargs: Any) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and type of a row's picture; see `drawing.picture_spec`."""
        return drawing.picture_spec(self.single, kwargs)

    def shown(self, row: int) -> _P:
        """A single simulation with all that is drawn of a row, until this is called again."""
        self._take_fields(self.textured, row)
        self.textured.simulation.load(self.simulation.seen(row))
        return self.textured

    def free(self) -> None:
        """Frees the simulations; nothing of this object but this must be used afterwards."""
        for name in ("physics", "single", "textured"):
            if name in vars(self):
                vars(self)[name].free()
        vars(self).clear()

    def _take_fields(self, one: _P, row: int) -> None:
        """Copies a row's own fields of the model to a single simulation."""
        own: Mapping[str, np.ndarray] = self.simulation.own_fields
        if own:
            one.simulation.set_fields({name: values[row] for name, values in own.items()})
