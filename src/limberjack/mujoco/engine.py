"""`Physics`: a MuJoCo simulation with named access, resets, checks and rendering.

    physics = Physics.from_xml_string(xml)
    with physics.reset_context():
        physics.named.data.qpos["hinge"] = 0.5
    physics.set_control([0.1])
    physics.step()
    frame = physics.render(240, 320, camera_id="fixed")

A domain subclasses it with the quantities its tasks measure. A `Physics` has one simulation or a
batch of them, which steps, saves and loads (`simulation.py`); a batch's arrays have a leading axis.
Names are looked up by `index.py` and pictures drawn by `camera.py`. `action_spec` describes a
model's controls.

It is one idea, and long: most of it is the interface of dm_control's class.
"""

import contextlib
import copy
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Self, cast

import mujoco
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.mujoco import camera, fields, index, replicas, wrapper
from limberjack.mujoco.camera import (
    Camera,
    CameraMatrices,
    Contexts,
    MovableCamera,
    Pose,
    SceneCallback,
    Selected,
    TextOverlay,
)
from limberjack.mujoco.index import NamedIndexStructs
from limberjack.mujoco.model_values import derived_fields, identity
from limberjack.mujoco.pictures import Overlay
from limberjack.mujoco.recompiling import Recompiler
from limberjack.mujoco.rows_view import RowsData
from limberjack.mujoco.simulation import (
    MOST_AT_ONCE,
    Fields,
    Simulation,
    checked_signature,
    checked_steps,
    described,
)
from limberjack.mujoco.single_simulation import SingleSimulation, advance
from limberjack.mujoco.wrapper.sharing import compiled
from limberjack.mujoco.wrapper.visual import RenderFlag
from limberjack.rl import control as _control
from limberjack.rl.references import is_live, reachable
from limberjack.utils.log import log

__all__ = [
    "Camera",
    "CameraMatrices",
    "Contexts",
    "MovableCamera",
    "NamedIndexStructs",
    "Physics",
    "Pose",
    "Selected",
    "TextOverlay",
    "action_spec",
]


class Physics(_control.Physics):
    """A MuJoCo simulation, or a batch of them; see the module's docstring."""

    # A class attribute, because programs override `__init__` without calling it.
    _warnings_cause_exception = True
    # Methods that a subclass replaces, and that rows of a batch do not call.
    replaced: tuple[str, ...] = ()
    _replaces_parts_of_step = False  # as programs for dm_control do
    # Any: a `wrapper.MjData`, or a `RowsData` with the same fields.
    _data: Any
    _simulation: Simulation

    def __init_subclass__(cls, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        parts = ("check_invalid_state", "_step_with_up_to_date_position_velocity")
        names = ("step", "after_reset", "reset_context", *parts)
        own = (name for name in names if getattr(cls, name) is not getattr(Physics, name))
        cls.replaced = tuple(own)
        cls._replaces_parts_of_step = not set(parts).isdisjoint(cls.replaced)

    def __init__(self, data: wrapper.MjData) -> None:
        """Wraps a `wrapper.MjData`; see also the `from_...` constructors."""
        self._reload_from_data(data)

    @classmethod
    def from_model(cls, model: wrapper.MjModel) -> Self:
        """A simulation of a compiled model."""
        return cls(wrapper.MjData(model))

    @classmethod
    def from_xml_string(
        cls, xml_string: str | bytes, assets: dict[str, bytes] | None = None
    ) -> Self:
        """A simulation of a model given as MJCF text.

        Args:
          xml_string: the MJCF.
          assets: contents of the files it refers to, by name.

        Raises:
          ValueError: MuJoCo's error message about the MJCF.
        """
        return cls.from_model(wrapper.MjModel.from_xml_string(xml_string, assets=assets))

    @classmethod
    def from_shared_xml(cls, xml_string: str | bytes, assets: dict[str, bytes]) -> Self:
        """Like `from_xml_string`, but shares the compiled model between equal sources.

        The MJCF must refer only to files in `assets`. The model is copied on write, so sharing has
        no visible effect.
        """
        source = (xml_string, *sorted(assets.items()))
        shared = compiled(source, lambda: wrapper.MjModel.from_xml_string(xml_string, assets).ptr)
        shared.mjcf = xml_string, assets
        return cls.from_model(wrapper.MjModel(shared))

    @classmethod
    def from_byte_string(cls, byte_string: bytes) -> Self:
        """A simulation of a model in MuJoCo's binary format (MJB)."""
        return cls.from_model(wrapper.MjModel.from_byte_string(byte_string))

    @classmethod
    def from_xml_path(cls, file_path: str) -> Self:
        """A simulation of an MJCF file."""
        return cls.from_model(wrapper.MjModel.from_xml_path(file_path))

    @classmethod
    def from_binary_path(cls, file_path: str) -> Self:
        """A simulation of a binary model file."""
        return cls.from_model(wrapper.MjModel.from_binary_path(file_path))

    def reload_from_xml_string(
        self, xml_string: str | bytes, assets: dict[str, bytes] | None = None
    ) -> None:
        """Replaces the simulation by one of another model, as from `from_xml_string`."""
        self._reload_from_data(wrapper.MjData(wrapper.MjModel.from_xml_string(xml_string, assets)))

    def reload_from_xml_path(self, file_path: str) -> None:
        """Replaces the simulation by one of another model, as from `from_xml_path`."""
        self._reload_from_data(wrapper.MjData(wrapper.MjModel.from_xml_path(file_path)))

    def _reload_from_data(self, data: wrapper.MjData) -> None:
        """Adopts a state and its model, and computes all derived quantities."""
        if not isinstance(data, wrapper.MjData):
            raise TypeError(f"Expected wrapper.MjData. Got: {type(data)}.")
        vars(self).pop("named", None)
        self._data = data
        self._simulation = SingleSimulation(data)
        try:
            self.after_reset()
        except _control.PhysicsError as error:
            log.warning("%s", error)

    def free(self) -> None:
        """Frees the simulation; this object must not be used afterwards."""
        for name in ("_data", "_simulation", "named"):
            vars(self).pop(name, None)

    def __repr__(self) -> str:
        name = f"{type(self).__module__.rpartition('.')[2]}.{type(self).__qualname__}"
        if "_simulation" not in vars(self):
            return f"<{name}, closed>"
        rows = "" if self.num_envs is None else f", {self.num_envs} rows"
        return f"<{name}{rows}: nq={self.model.nq}, nv={self.model.nv}, nu={self.model.nu}>"

    def __getattr__(self, name: str) -> Any:  # raises; of the property that raised
        if name in ("_data", "_simulation"):
            raise RuntimeError(
                "this Physics is closed or was never initialised: create one with a from_... "
                "constructor, or load an environment"
            )
        return object.__getattribute__(self, name)  # raises, as a property's own error does

    @property
    def simulation(self) -> Simulation:
        """The simulation that steps, saves and loads."""
        return self._simulation

    @property
    def num_envs(self) -> int | None:
        """Number of rows of a batch; None for a single simulation."""
        return self._simulation.num_envs

    @property
    def model(self) -> wrapper.MjModel:
        """The model; edits affect only this simulation. A batch's model is read-only."""
        return self._data.model

    @property
    def data(self) -> Any:  # Any: the official struct's fields are not listed anywhere
        """The state and all quantities derived from it."""
        return self._data

    @functools.cached_property
    def named(self) -> NamedIndexStructs:
        """`named.data` and `named.model`: fields indexed by the names of the model's objects."""
        source = self._simulation
        names = index.Names(source.model.structure)
        return NamedIndexStructs(
            index.NamedFields("MjModel", source.model_field, names),
            index.NamedFields("MjData", source.data_field, names),
        )

    # Batches.

    def replicate(
        self, num_envs: int, num_threads: int, own_fields: Sequence[str] = ()
    ) -> "replicas.Replicas[Self]":
        """Many simulations of this model, in its default state; see `Replicas`.

        Args:
          num_envs: number of simulations.
          num_threads: number of threads, the caller's included.
          own_fields: model fields that an episode's start may set for its own row.
        """
        return replicas.Replicas(self, num_envs, num_threads, own_fields)

    def seen_through(self, fields: Fields) -> Self:
        """This physics evaluated on other fields, such as those of a `BatchSimulation`."""
        cls: type[Self] = type(self)
        other = cls.__new__(cls)
        vars(other).update(self._kept_attributes())
        other._simulation = cast(Simulation, fields)  # read-only ones raise when stepped
        other._forget_arrays()
        return other

    def _shared_attributes(self) -> dict[str, object]:
        """The attributes that do not belong to one simulation, such as a domain's settings."""
        cls, own = type(self), ("_data", "_simulation")
        cached = functools.cached_property
        return {
            name: value
            for name, value in vars(self).items()
            if name not in own and not isinstance(getattr(cls, name, None), cached)
        }

    def _kept_attributes(self) -> dict[str, object]:
        """Those of `_shared_attributes` that another simulation may have: none shows this one."""
        return {n: v for n, v in self._shared_attributes().items() if not self._shows_this(v)}

    def _shows_this(self, value: object) -> bool:
        """Whether a value is, holds or views this simulation's state, model or arrays."""
        whole = (self._data, self._data.model, self._data._data, self._data.model._official)
        return any(
            is_live(part) or any(part is one for one in whole) for _, part in reachable(value)
        )

    def _forget_arrays(self) -> None:
        vars(self).pop("named", None)
        self._data = RowsData(self._simulation)

    def _only_single(self, what: str, instead: str) -> SingleSimulation:
        """The simulation; raises TypeError if it is a batch, with the call to use instead."""
        simulation = self._simulation
        if type(simulation) is not SingleSimulation:
            raise TypeError(f"the physics of a batch does not support {what}: {instead}")
        return simulation

    def identity(self, varying: Sequence[str] = ()) -> dict[str, object]:
        """Facts that must match for a saved state to load; see `model_values.identity`."""
        return identity(self._simulation.model, varying)

    def nominal_fields(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Current model values of the fields to be randomised, by name.

        Raises:
          ValueError: there is no such field, or it is part of the model's structure.
        """
        return fields.nominal(self._data.model._official, names)

    def recompute_constants_of(self, names: Sequence[str]) -> None:
        """Makes starts that set these fields recompute the constants derived from them, if any."""
        self._simulation.sets_constants = bool(derived_fields(names))

    def recompiler(self) -> Recompiler:
        """Compiles this model again with changes of its MJCF.

        Raises:
          ValueError: the model was not made by `from_shared_xml`, or was changed since.
        """
        shared = self._data.model._shared
        if shared is None or shared.mjcf is None:
            raise ValueError(
                "this model cannot be compiled again: make the physics with from_shared_xml, and "
                "change its model in the MJCF only"
            )
        return Recompiler(*shared.mjcf)

    # Stepping.

    def set_control(self, control: npt.ArrayLike) -> None:
        """Sets the actuators' control signals, (nu,)."""
        np.copyto(self._simulation.ctrl, control)

    def step(self, nstep: int = 1) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Advances the simulation by `nstep` time steps.

        Raises:
          ValueError: `nstep` is not a whole number of at least 1; nothing was stepped.
          TypeError: these are the rows of a batch.
          PhysicsError: the simulation diverged.
        """
        simulation = self._simulation
        if type(simulation) is not SingleSimulation:
            simulation = self._only_single("step()", "call step(actions) of its BatchEnvironment")
        if type(nstep) is not int or not 1 <= nstep <= MOST_AT_ONCE:
            nstep = checked_steps(nstep)
        if self._replaces_parts_of_step:
            with self.check_invalid_state():
                if self.legacy_step:
                    self._step_with_up_to_date_position_velocity(nstep)
                else:
                    advance(*simulation.begin_step_whole(nstep))
            return
        earlier = simulation.set_warnings_aside()
        if self.legacy_step:
            advance(*simulation.begin_step(nstep))
        else:
            advance(*simulation.begin_step_whole(nstep))
        if earlier is not None or simulation.has_warned():
            self._raise_if_warned(earlier)

    def _step_with_up_to_date_position_velocity(self, nstep: int = 1) -> None:
        """Steps with quantities of the present state, and computes those of the next one.

        Subclasses for dm_control replace it; it checks nothing.
        """
        simulation = self._simulation
        assert isinstance(simulation, SingleSimulation)  # as `step` has checked
        advance(*simulation.begin_step(nstep))

    @property
    def can_step_in_parts(self) -> bool:
        """Whether `step_in_parts` equals `step`: no subclass or user has replaced that."""
        is_replaced = type(self).step is not Physics.step or "step" in vars(self)
        if is_replaced or self._replaces_parts_of_step:
            return False
        return type(self._simulation) is SingleSimulation

    def step_in_parts(self, nstep: int = 1) -> tuple[Callable[[], None], Callable[[], None]]:
        """Begins what `step(nstep)` does, and returns two functions that complete it, in order.

        The first calls only MuJoCo, in any thread. The second raises `PhysicsError` if the
        simulation diverged.

        Raises:
          ValueError: `nstep` is not a whole number of at least 1; nothing was stepped.
        """
        instead = "call step(actions) of its BatchEnvironment"
        simulation = self._only_single("step_in_parts()", instead)
        nstep = checked_steps(nstep)
        earlier = simulation.set_warnings_aside()
        record = simulation.begin_step if self.legacy_step else simulation.begin_step_whole
        run = functools.partial(advance, *record(nstep))

        def check() -> None:
            if earlier is not None or simulation.has_warned():
                self._raise_if_warned(earlier)

        return run, check

    def forward(self) -> None:
        """Recomputes every quantity from the state and the controls.

        Raises:
          PhysicsError: the state is invalid.
        """
        with self.check_invalid_state():
            self._simulation.forward()

    def reset(self, keyframe_id: int | None = None) -> None:
        """Resets to the default state or a keyframe.

        Raises:
          ValueError: there is no such keyframe.
          TypeError: `keyframe_id` is not a whole number, or these are the rows of a batch.
        """
        self._only_single("reset()", "call reset(rows) of its BatchEnvironment")
        if keyframe_id is not None and not isinstance(keyframe_id, int | np.integer):
            raise TypeError(
                f"keyframe_id is {keyframe_id!r}; expected a keyframe's number, or None"
            )
        if keyframe_id is not None and not self.model.nkey:
            raise ValueError(f"keyframe_id is {keyframe_id}, but the model has no keyframes")
        if keyframe_id is not None and not 0 <= keyframe_id < self.model.nkey:
            raise ValueError(
                f"`keyframe_id` must be between 0 and {self.model.nkey - 1} inclusive, got: "
                f"{keyframe_id}."
            )
        self._simulation.reset(keyframe_id)
        _recompute(self)

    def after_reset(self) -> None:
        """Recomputes every quantity with actuation disabled: there are no controls yet."""
        _recompute(self)

    @contextlib.contextmanager
    def check_invalid_state(self) -> Iterator[None]:
        """Raises `PhysicsError` at exit if MuJoCo warned within the context."""
        earlier = self._simulation.set_warnings_aside()
        yield
        self._raise_if_warned(earlier)

    @contextlib.contextmanager
    def suppress_physics_errors(self) -> Iterator[None]:
        """Context in which divergence is logged instead of raised."""
        before = self._warnings_cause_exception
        self._warnings_cause_exception = False
        try:
            yield
        finally:
            self._warnings_cause_exception = before

    def _raise_if_warned(self, earlier: np.ndarray | None) -> None:
        """Raises or logs if there are warnings other than the earlier ones, and names them."""
        new = self._simulation.new_warnings(earlier)
        if new is None:
            return
        message = f"Physics state is invalid. Warning(s) raised: {described(new)}"
        if self._warnings_cause_exception:
            raise _control.PhysicsError(message)
        log.warning(message)

    def enable_profiling(self) -> None:
        """Enables MuJoCo's stage timers."""
        wrapper.enable_timer(True)

    # State.

    def get_state(self, sig: int | None = None) -> np.ndarray:
        """The state as one array, (..., size).

        Args:
          sig: the components to include, as `mujoco.mjtState` bits. The default is dm_control's
            state: positions, velocities, activations and plugin states. It lacks the solver's warm
            start; `mjSTATE_INTEGRATION` is everything a step depends on.

        Raises:
          ValueError, TypeError: `sig` has other bits, or is not a whole number.
        """
        if sig is None:
            return np.concatenate(self._physics_state_items(), axis=-1)
        return self._simulation.get_state(checked_signature(sig))

    def set_state(self, physics_state: np.ndarray, sig: int | None = None) -> None:
        """Sets the state to an array from `get_state(sig)`; does not recompute derived quantities.

        Args:
          physics_state: (..., size).
          sig: as for `get_state`.

        Raises:
          ValueError, TypeError: the array has another shape, or see `get_state`; nothing is
            changed.
        """
        if sig is not None:
            sig = checked_signature(sig)
        state = np.asarray(physics_state, float)
        items = self._physics_state_items()
        sizes = [item.shape[-1] for item in items]
        size = sum(sizes) if sig is None else mujoco.mj_stateSize(self.model._official, sig)
        shape = (*items[0].shape[:-1], size)
        if state.shape != shape:
            raise ValueError(f"Input physics state has shape {state.shape}. Expected {shape}.")
        if sig is not None:
            self._simulation.set_state(state, sig)
            return
        parts = np.split(state, np.cumsum(sizes)[:-1], axis=-1)
        for item, part in zip(items, parts, strict=True):
            np.copyto(item, part)

    def _physics_state_items(self) -> list[np.ndarray]:
        data = self._data._data
        items = [data.qpos, data.qvel, data.act]
        return [*items, data.plugin_state] if self.model._official.nplugin else items

    def copy(self, share_model: bool = False) -> Self:
        """A simulation in the same state, except for the solver's warm start, as in dm_control.

        Args:
          share_model: whether both use one model, so that edits affect both.
        """
        instead = "take a snapshot() of its BatchEnvironment, or deepcopy it"
        simulation = self._only_single("copy()", instead).copy(share_model)
        new = type(self).__new__(type(self))
        new.__setstate__((simulation, self._kept_settings()))
        return new

    def __getstate__(self) -> tuple[Simulation, dict[str, object]]:
        return self._only_single("pickling", "pickle its BatchEnvironment"), self._kept_settings()

    def __setstate__(self, state: tuple[SingleSimulation, dict[str, object]]) -> None:
        self.become(state)
        with self.suppress_physics_errors():  # as in dm_control; this changes the warm start
            self.after_reset()

    def become(self, state: tuple[SingleSimulation, dict[str, object]]) -> None:
        """Adopts the exact state returned by another simulation's `__getstate__`."""
        simulation, settings = state
        if type(self)._reload_from_data is not Physics._reload_from_data:
            self._reload_exactly(simulation.data)
        self._simulation, self._data = simulation, simulation.data
        vars(self).update(settings)

    def _reload_exactly(self, data: wrapper.MjData) -> None:
        """Calls a subclass's `_reload_from_data`, as in dm_control, and keeps every quantity."""
        before = copy.copy(data)
        self._reload_from_data(data)
        mujoco.mj_copyData(data._data, data.model._official, before._data)

    def _kept_settings(self) -> dict[str, object]:
        """The attributes that copies keep: settings, and what a subclass adds."""
        own = self._kept_attributes()
        own.pop("_warnings_cause_exception", None)
        return own

    def control(self) -> np.ndarray:
        """The control signals, (nu,)."""
        return self._data._data.ctrl.copy()

    def activation(self) -> np.ndarray:
        """The internal states of the actuators, (na,)."""
        return self._data._data.act.copy()

    def state(self) -> np.ndarray:
        """Positions, velocities and activations, (nq + nv + na,): `get_state()`."""
        return self.get_state()

    def position(self) -> np.ndarray:
        """Generalised positions, (nq,)."""
        return self._data._data.qpos.copy()

    def velocity(self) -> np.ndarray:
        """Generalised velocities, (nv,)."""
        return self._data._data.qvel.copy()

    def timestep(self) -> float:
        """Length of one time step, seconds."""
        return self.model._official.opt.timestep

    def time(self) -> float:
        """Simulated time since the last reset, seconds."""
        return self._data._data.time

    # Drawing.

    def render(
        self,
        height: int = 240,
        width: int = 320,
        camera_id: int | str = -1,
        overlays: Iterable[Overlay] = (),
        depth: bool = False,
        segmentation: bool = False,
        scene_option: mujoco.MjvOption | None = None,
        render_flag_overrides: Mapping[RenderFlag, bool] | None = None,
        scene_callback: SceneCallback | None = None,
        quality: str = "full",
    ) -> np.ndarray:
        """A picture of the current state; see `limberjack.mujoco.camera.Camera.render`.

        Args:
          height: pixels.
          width: pixels.
          camera_id: name or number of a camera of the model; -1 is the free camera.
          overlays: `TextOverlay`s to draw on an RGB picture.
          depth: return depth in metres, (height, width) float32, instead of RGB.
          segmentation: return object id and `mjtObj` type, (height, width, 2) int32, -1 for the
            background, instead of RGB.
          scene_option: visualisation options, a `wrapper.MjvOption`.
          render_flag_overrides: rendering flags by name, such as {'wireframe': True}.
          scene_callback: called with the physics and the scene before it is drawn.
          quality: 'full', as in dm_control, or 'fast', without shadows, reflections and sky.

        Returns:
          (height, width, 3) uint8 unless `depth` or `segmentation` is set.
        """
        self._only_single("render()", "call render(rows, ...) of its BatchEnvironment")
        what = height, width, camera_id, overlays, depth, segmentation
        how = scene_option, render_flag_overrides, scene_callback, quality
        return camera.render(self, *what, *how)

    @property
    def can_render_in_parts(self) -> bool:
        """Whether `begin_render` equals `render`: no subclass or user has replaced that."""
        return type(self).render is Physics.render and "render" not in vars(self)

    # Any: each keyword of `render` has its own type.
    def begin_render(self, given: Mapping[str, Any], thread: int) -> camera.Drawing:
        """The picture of `render(**given)` in two steps; see `camera.begin_render`."""
        return camera.begin_render(self, given, thread)

    # Any: as above.
    def render_rows(self, rows: np.ndarray | None, **kwargs: Any) -> np.ndarray:
        """A picture of a single simulation as its only row, (1, height, width, ...)."""
        return self.render(**kwargs)[None]

    def picture_spec(self, **kwargs: object) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and dtype of the picture that `render` returns; see `camera.picture_spec`."""
        return camera.picture_spec(self, kwargs)

    @property
    def contexts(self) -> Contexts:
        """The OpenGL and MuJoCo rendering contexts, as `contexts.gl` and `contexts.mujoco`."""
        return camera.contexts(self)


def action_spec(physics: Physics) -> specs.BoundedArray:
    """Spec of the controls, (nu,); an unlimited control is bounded by MuJoCo's maximum value."""
    model = physics.model._official
    limited = model.actuator_ctrllimited.ravel().astype(bool)[:, None]
    bounds = np.where(limited, model.actuator_ctrlrange, [-mujoco.mjMAXVAL, mujoco.mjMAXVAL])
    return specs.BoundedArray(
        shape=(model.nu,), dtype=float, minimum=bounds[:, 0], maximum=bounds[:, 1]
    )


def _recompute(physics: Physics) -> None:
    """Recomputes every quantity with actuation disabled.

    In a single simulation it calls `forward` where a user defines it; the start of a row calls no
    method of the physics.
    """
    if type(physics).forward is not Physics.forward and physics._simulation.num_envs is None:
        with physics.model.disable("actuation"):
            physics.forward()
        return
    simulation = physics._simulation
    earlier = simulation.set_warnings_aside()
    simulation.forward_without_actuation()
    physics._raise_if_warned(earlier)
