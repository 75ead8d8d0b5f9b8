"""`Replicas`: many simulations of one physics, started row by row and stepped together.

    replicas = physics.replicate(num_envs=256, num_threads=8, own_fields=("body_pos",))
    for row in range(256):
        with replicas.episode(row) as one:
            task.initialize_episode(one)
    replicas.start(np.arange(256))
    diverged = replicas.step(None, 5)
    task.get_observation(replicas.physics)     # (256, ...) each

`physics` has the same class as the replicated one, so a domain's measurements on it have a leading
batch axis. `single` is a single simulation of the same model without textures; the episodes of the
rows are initialised in it, one after the other.
"""

import collections
import contextlib
import functools
import weakref
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Generic, NoReturn, Protocol, Self, TypeVar

import mujoco
import numpy as np

from limberjack.mujoco import rendering
from limberjack.mujoco.batch_simulation import BatchSimulation, check_callbacks
from limberjack.mujoco.camera import Drawing, check_names, completed
from limberjack.mujoco.simulation import STATE, Call, Fields, Rows, read_field
from limberjack.mujoco.wrapper.core import MjModel
from limberjack.rl.contract import PhysicsError, SimulatedPhysics
from limberjack.utils.arrays import any_of
from limberjack.worlds.appearance.looks import Looks

__all__ = ["Replicas"]


class _Physics(SimulatedPhysics, Protocol):
    """The parts of a `Physics`, whose module imports this one, that replication needs."""

    @classmethod
    def from_model(cls, model: MjModel) -> Self: ...

    def seen_through(self, fields: Fields) -> Self: ...

    def reset(self) -> None: ...

    def render(self) -> np.ndarray: ...

    @property
    def can_render_in_parts(self) -> bool: ...

    # Any: as of `Physics.render`
    def begin_render(self, given: Mapping[str, Any], thread: int) -> Drawing: ...

    def free(self) -> None: ...

    def _kept_attributes(self) -> dict[str, object]: ...

    def _forget_arrays(self) -> None: ...


_P = TypeVar("_P", bound=_Physics)


class Replicas(Generic[_P]):
    """See the module's docstring."""

    def __init__(
        self, physics: _P, num_envs: int, num_threads: int, own_fields: Sequence[str]
    ) -> None:
        """Creates simulations of a physics' model, in the model's default state.

        Args:
          physics: a single simulation, which is not changed.
          num_envs: number of rows.
          num_threads: number of threads, the caller's included.
          own_fields: model fields of which each row has its own copy.
        """
        model = physics.model
        # Copy-on-write: this costs nothing unless one of the models is changed.
        simulation = BatchSimulation(model.copy(), num_envs, num_threads, own_fields)
        self.simulation = simulation
        self.num_envs, self.num_threads = num_envs, num_threads
        self.looks: Looks | None = None  # with which rows are drawn; None for that of the model
        self.physics: _P = physics.seen_through(simulation)
        self.single: _P = type(physics).from_model(model.without_textures())
        self._also_shown: list[_P] = []  # like `textured`, for several pictures at once
        for each in (self.physics, self.single):
            self._set_up(each, physics)
        simulation.forget_arrays = weakref.WeakMethod(self.physics._forget_arrays)

    @functools.cached_property
    def textured(self) -> _P:
        """Like `single` but with textures, for pictures and for further replication."""
        return self._new_textured()

    def _new_textured(self) -> _P:
        one = type(self.single).from_model(self.simulation.model.copy())
        self._set_up(one, self.single)
        return one

    @staticmethod
    def _set_up(one: _P, like: _P) -> None:
        """Copies settings from one physics to another, `legacy_step` among them."""
        vars(one).update(like._kept_attributes())
        one.simulation.sets_constants = like.simulation.sets_constants

    @contextlib.contextmanager
    def episode(self, row: int) -> Iterator[_P]:
        """Yields `single` after a reset; its state on exit starts the row's episode.

        Derived quantities of the row are computed by `start`.
        """
        one, simulation = self.single, self.simulation
        self._take_fields(one, row)
        with contextlib.suppress(PhysicsError):
            one.reset()
        yield one
        model = one.model._official
        for name, values in simulation.own_fields.items():
            values[row] = read_field(model, name)
        mujoco.mj_getState(model, one.data._data, simulation.state[row], STATE)

    def start_of(self, row: int) -> dict[str, np.ndarray]:
        """A copy of the state and the own model fields that a row's episode starts with."""
        fields = {name: values[row].copy() for name, values in self.simulation.own_fields.items()}
        return {"state": self.simulation.state[row].copy(), **fields}

    def set_start(self, row: int, start: Mapping[str, np.ndarray]) -> None:
        """Makes a row start with the result of `start_of`; see `start`."""
        self.simulation.state[row] = start["state"]
        for name, values in self.simulation.own_fields.items():
            values[row] = start[name]

    def check(self) -> None:
        """Raises ValueError if no row can be stepped now, to be called before anything changes.

        That is the case while a MuJoCo callback is a Python function; see `check_callbacks`.
        """
        check_callbacks()

    def start(self, rows: np.ndarray) -> None:
        """Computes derived quantities of rows that begin an episode, with actuation disabled."""
        self.simulation.set_constants(rows)
        self.simulation.forward_without_actuation(rows)

    def step(self, rows: Rows, nstep: int) -> np.ndarray:
        """Advances rows, None for all, by time steps; returns a divergence mask, (num_envs,).

        `check` comes first, before anything that belongs to the step.
        """
        simulation = self.simulation
        simulation.warnings[...] = 0
        call = Call.STEP if self.physics.legacy_step else Call.STEP_WHOLE
        simulation.advance(call, nstep, rows)
        if not any_of(simulation.warnings):
            return np.zeros(self.num_envs, bool)
        diverged = np.any(simulation.warnings, axis=-1)
        # MuJoCo neither resets nor uses bad controls, from which a cost of control would overflow.
        simulation.ctrl[diverged] = 0.0
        return diverged

    def render_rows(self, rows: Rows, **kwargs: Any) -> np.ndarray:  # Any: as of `Physics.render`
        """Pictures of rows, (n, height, width, ...).

        Args:
          rows: row numbers; None for all.
          kwargs: keyword arguments of `Physics.render`.

        Raises:
          ValueError, TypeError: see `picture_spec`.
          RenderingError: OpenGL is not available.
        """
        check_names(kwargs)
        numbers = range(self.num_envs) if rows is None else rows.tolist()
        if not numbers:
            shape, dtype = self.picture_spec(**kwargs)
            return np.empty((0, *shape), dtype)
        first = self.shown(numbers[0]).render(**kwargs)
        pictures = np.empty((len(numbers), *first.shape), first.dtype)
        pictures[0] = first
        # Functions of users are called for one row after the other.
        calls = any(kwargs.get(name) for name in ("overlays", "scene_callback"))
        if len(numbers) > 1 and self.textured.can_render_in_parts and not calls:
            self._draw_at_once(numbers[1:], kwargs, pictures[1:])
            return pictures
        for picture, row in zip(pictures[1:], numbers[1:], strict=True):
            picture[...] = self.shown(row).render(**kwargs)
        return pictures

    # Any: as of `Physics.render`
    def _draw_at_once(
        self, rows: Sequence[int], kwargs: Mapping[str, Any], pictures: np.ndarray
    ) -> None:
        """Draws rows on all rendering threads while this thread prepares the next one.

        Each picture under way has a single simulation to itself until it is complete.
        """
        threads = rendering.num_threads()
        ahead = min(threads, len(rows) - 1)  # rows that are prepared while one is drawn
        while len(self._also_shown) < ahead:
            self._also_shown.append(self._new_textured())
        shown = (self.textured, *self._also_shown[:ahead])
        under_way: collections.deque[tuple[np.ndarray, Drawing]] = collections.deque()
        try:
            for number, (picture, row) in enumerate(zip(pictures, rows, strict=True)):
                if len(under_way) == len(shown):
                    _complete_first(under_way)
                one = self._show(row, shown[number % len(shown)])
                under_way.append((picture, one.begin_render(kwargs, number % threads)))
                next(under_way[-1][1]).start()
            while under_way:
                _complete_first(under_way)
        finally:  # after an error or an interrupt, the rest is cancelled
            for _, drawing in under_way:
                drawing.close()

    def picture_spec(self, **kwargs: object) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and dtype of a row's picture; see `camera.picture_spec`."""
        return self.single.picture_spec(**kwargs)

    def shown(self, row: int) -> _P:
        """A single simulation that looks like a row, valid until the next call."""
        return self._show(row, self.textured)

    def _show(self, row: int, one: _P) -> _P:
        """The single simulation `one`, which from now on looks like the row."""
        self._take_fields(one, row)
        one.simulation.load(self.simulation.seen(row))
        one.simulation.look = None if self.looks is None else self.looks.of(row)
        return one

    def free(self) -> None:
        """Frees the simulations; afterwards only `free` itself may be called."""
        for name in ("physics", "single", "textured"):
            if name in vars(self):
                vars(self)[name].free()
        for one in vars(self).get("_also_shown", ()):
            one.free()
        vars(self).clear()

    def __getattr__(self, name: str) -> NoReturn:
        if vars(self):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        raise RuntimeError("this batch is closed: create a new one")

    def _take_fields(self, one: _P, row: int) -> None:
        """Copies a row's own model fields to a single simulation."""
        own = self.simulation.own_fields
        if own:
            one.simulation.set_fields({name: values[row] for name, values in own.items()})


def _complete_first(under_way: collections.deque[tuple[np.ndarray, Drawing]]) -> None:
    """Writes the picture that was begun first, and removes its drawing."""
    picture, drawing = under_way[0]
    picture[...] = completed(drawing)
    under_way.popleft()
