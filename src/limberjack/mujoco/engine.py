"""`Physics`: a MuJoCo simulation with named access, resets, checks and rendering.

    physics = Physics.from_xml_string(xml)
    with physics.reset_context():
        physics.named.data.qpos["hinge"] = 0.5
    physics.set_control([0.1])
    physics.step()
    frame = physics.render(240, 320, camera_id="fixed")

A domain subclasses it with the quantities its tasks measure. The class does not step by itself
(`simulation.py` does), resolve names (`index.py`) or draw (`camera.py`).
"""

import collections
import contextlib
import functools
import weakref
from collections.abc import Callable, Iterator
from typing import Any, Self

import mujoco
import numpy as np
from dm_env import specs

from limberjack.mujoco import camera, index, wrapper
from limberjack.mujoco.camera import (
    Camera,
    CameraMatrices,
    Contexts,
    MovableCamera,
    Pose,
    Selected,
    TextOverlay,
)
from limberjack.mujoco.rows import Rows
from limberjack.mujoco.simulation import SingleSimulation
from limberjack.mujoco.wrapper.core import SharedModel
from limberjack.rl import control as _control
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

NamedIndexStructs = collections.namedtuple("NamedIndexStructs", ["model", "data"])

# Compiled models in use, by their source: the environments of a process share one.
_models: "weakref.WeakValueDictionary[Any, SharedModel]" = weakref.WeakValueDictionary()


class Physics(Rows, _control.Physics):
    """A MuJoCo simulation; see the module's docstring."""

    # In the class, because programs override `__init__` without calling it.
    _warnings_cause_exception = True
    # Any: of a single simulation or of a batch.
    _data: Any
    _simulation: Any

    def __init__(self, data: wrapper.MjData) -> None:
        """Takes a `wrapper.MjData`; see the `from_...` constructors."""
        self._reload_from_data(data)

    @classmethod
    def from_model(cls, model: wrapper.MjModel) -> Self:
        """A simulation of a compiled model."""
        return cls(wrapper.MjData(model))

    @classmethod
    def from_xml_string(cls, xml_string: str | bytes, assets: dict | None = None) -> Self:
        """A simulation of a model given as MJCF text.

        Args:
          xml_string: the MJCF.
          assets: contents of the files that it names, by name.

        Raises:
          ValueError: MuJoCo's message on what is wrong with the MJCF.
        """
        return cls.from_model(wrapper.MjModel.from_xml_string(xml_string, assets=assets))

    @classmethod
    def from_shared_xml(cls, xml_string: str | bytes, assets: dict) -> Self:
        """As `from_xml_string`, sharing the compiled model with others of the same source.

        The MJCF must name no file that is not in `assets`. A simulation whose model is changed
        takes a copy first, so that sharing is never noticed.
        """
        source = (xml_string, *sorted(assets.items()))
        if (shared := _models.get(source)) is None:
            shared = SharedModel(wrapper.MjModel.from_xml_string(xml_string, assets).ptr)
        physics = cls.from_model(wrapper.MjModel(shared))
        _models[source] = shared.publish()
        return physics

    @classmethod
    def from_byte_string(cls, byte_string: bytes) -> Self:
        """A simulation of a model in MuJoCo's binary form."""
        return cls.from_model(wrapper.MjModel.from_byte_string(byte_string))

    @classmethod
    def from_xml_path(cls, file_path: str) -> Self:
        """A simulation of an MJCF file."""
        return cls.from_model(wrapper.MjModel.from_xml_path(file_path))

    @classmethod
    def from_binary_path(cls, file_path: str) -> Self:
        """A simulation of a binary model file."""
        return cls.from_model(wrapper.MjModel.from_binary_path(file_path))

    def reload_from_xml_string(self, xml_string: str | bytes, assets: dict | None = None) -> None:
        """Becomes a simulation of another model, as if made by `from_xml_string`."""
        self._reload_from_data(wrapper.MjData(wrapper.MjModel.from_xml_string(xml_string, assets)))

    def reload_from_xml_path(self, file_path: str) -> None:
        """Becomes one of another model, as if made by `from_xml_path`."""
        self._reload_from_data(wrapper.MjData(wrapper.MjModel.from_xml_path(file_path)))

    def _reload_from_data(self, data: wrapper.MjData) -> None:
        """Takes over a state and its model, and computes every quantity of it."""
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
        for name in ("_data", "_simulation", "_scratch", "named"):
            vars(self).pop(name, None)

    def __getattr__(self, name: str) -> Any:
        if name in ("_data", "_simulation"):
            raise RuntimeError(
                "this Physics is closed or was never initialised: make one with a from_... "
                "constructor, or load an environment"
            )
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    @property
    def model(self) -> wrapper.MjModel:
        """The model; editing it changes this simulation alone."""
        return self._data.model

    @property
    def data(self) -> wrapper.MjData:
        """The state and all quantities computed from it."""
        return self._data

    @functools.cached_property
    def named(self) -> Any:
        """`named.data` and `named.model`: fields indexed by the names of the model's objects."""
        names, simulation = index.Names(self.model._model), self._simulation
        watch = simulation.is_watched, simulation.want
        return NamedIndexStructs(
            model=index.NamedFields("MjModel", simulation.model_field, names),
            data=index.NamedFields("MjData", simulation.field_for_names, names, *watch),
        )

    # Stepping.

    def set_control(self, control: Any) -> None:
        """Sets the actuators' control signals, (nu,)."""
        np.copyto(self._data._data.ctrl, control)

    def step(self, nstep: int = 1) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Advances the simulation by `nstep` time steps.

        Raises:
          PhysicsError: the simulation diverged.
        """
        simulation = self._simulation
        earlier = simulation.set_warnings_aside()
        if self.legacy_step:
            simulation.step(nstep)
        else:
            simulation.step_whole(nstep)
        if earlier is not None or simulation.has_warned():
            self._check_warnings(earlier)

    def forward(self) -> None:
        """Recomputes every quantity from the state and the controls.

        Raises:
          PhysicsError: the state is invalid.
        """
        with self.check_invalid_state():
            self._simulation.forward()

    def reset(self, keyframe_id: int | None = None) -> None:
        """Returns to the model's default state or to one of its keyframes.

        Raises:
          ValueError: there is no such keyframe.
        """
        if keyframe_id is not None and not self.model.nkey:
            raise ValueError(f"keyframe_id is {keyframe_id}, but the model has no keyframes")
        if keyframe_id is not None and not 0 <= keyframe_id < self.model.nkey:
            raise ValueError(
                f"`keyframe_id` must be between 0 and {self.model.nkey - 1} inclusive, got: "
                f"{keyframe_id}."
            )
        self._simulation.reset(keyframe_id)
        self.after_reset()

    def after_reset(self) -> None:
        """Recomputes every quantity with actuation disabled, as there are no controls yet."""
        earlier = self._simulation.set_warnings_aside()
        self._simulation.forward_without_actuation()
        self._check_warnings(earlier)

    @contextlib.contextmanager
    def check_invalid_state(self) -> Iterator[None]:
        """Raises `PhysicsError` at exit if MuJoCo warned within the context."""
        earlier = self._simulation.set_warnings_aside()
        yield
        self._check_warnings(earlier)

    @contextlib.contextmanager
    def suppress_physics_errors(self) -> Iterator[None]:
        """Within the context a diverged simulation is logged instead of raised."""
        before = self._warnings_cause_exception
        self._warnings_cause_exception = False
        try:
            yield
        finally:
            self._warnings_cause_exception = before

    def _check_warnings(self, earlier: np.ndarray | None) -> None:
        """Raises or logs, naming their kinds, if there are warnings besides the earlier ones."""
        new = self._simulation.new_warnings(earlier)
        if new is not None:
            kinds = zip(mujoco.mjtWarning.__members__, new, strict=False)
            names = [name for name, is_new in kinds if is_new]
            message = f"Physics state is invalid. Warning(s) raised: {', '.join(names)}"
            if self._warnings_cause_exception:
                raise _control.PhysicsError(message)
            log.warning(message)

    def enable_profiling(self) -> None:
        """Lets MuJoCo time its stages."""
        wrapper.enable_timer(True)

    # State.

    def get_state(self, sig: int | None = None) -> np.ndarray:
        """The state as one array.

        Args:
          sig: which parts, as `mujoco.mjtState` bits. By default positions, velocities and
            activations, and plugins' states: what dm_control means by state. That misses the
            solver's warm start; `mjSTATE_INTEGRATION` is everything a step depends on.
        """
        if sig is None:
            return np.concatenate(self._physics_state_items(), axis=-1)
        model = self.model._model
        state = np.empty(mujoco.mj_stateSize(model, sig))
        mujoco.mj_getState(model, self._data._data, state, sig)
        return state

    def set_state(self, physics_state: np.ndarray, sig: int | None = None) -> None:
        """Sets the state, an array as returned by `get_state(sig)`.

        Raises:
          ValueError: the array has another shape; nothing is changed.
        """
        state = np.asarray(physics_state, float)
        model = self.model._model
        items = self._physics_state_items()
        size = sum(item.size for item in items) if sig is None else mujoco.mj_stateSize(model, sig)
        if state.shape != (size,):
            raise ValueError(f"Input physics state has shape {state.shape}. Expected {(size,)}.")
        if sig is not None:
            mujoco.mj_setState(model, self._data._data, state, sig)
            return
        for item, part in zip(
            items, np.split(state, np.cumsum([i.size for i in items])), strict=False
        ):
            np.copyto(item, part)

    def _physics_state_items(self) -> list[np.ndarray]:
        """The live arrays that make up the state."""
        data = self._data._data
        items = [data.qpos, data.qvel, data.act]
        return [*items, data.plugin_state] if self.model.nplugin else items

    def copy(self, share_model: bool = False) -> Self:
        """A simulation in the same state.

        Args:
          share_model: let both use one model, so that editing it changes both.
        """
        new = type(self).__new__(type(self))
        new.__setstate__((self._data._make_copy(share_model=share_model), {}))
        vars(new).update(self._settings())
        return new

    def __getstate__(self) -> tuple[wrapper.MjData, dict[str, Any]]:
        return self._data, self._settings()

    def __setstate__(self, state: tuple[wrapper.MjData, dict[str, Any]]) -> None:
        data, settings = state
        self._data, self._simulation = data, SingleSimulation(data)
        self._simulation.check_state()
        if not settings.get("copies_as_is"):
            self._reload_from_data(data)
        vars(self).update(settings)

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
        """The generalised positions, (nq,)."""
        return self._data._data.qpos.copy()

    def velocity(self) -> np.ndarray:
        """The generalised velocities, (nv,)."""
        return self._data._data.qvel.copy()

    def timestep(self) -> float:
        """Length of one time step, seconds."""
        return self.model._model.opt.timestep

    def time(self) -> float:
        """Simulated time since the reset, seconds."""
        return self._data._data.time

    # Drawing.

    def render(
        self,
        height: int = 240,
        width: int = 320,
        camera_id: int | str = -1,
        overlays: Any = (),
        depth: bool = False,
        segmentation: bool = False,
        scene_option: Any = None,
        render_flag_overrides: Any = None,
        scene_callback: Callable[[Any, Any], None] | None = None,
        quality: str = "full",
    ) -> np.ndarray:
        """A picture of the present state; see `limberjack.mujoco.camera.Camera.render`.

        Args:
          height: pixels.
          width: pixels.
          camera_id: name or number of a camera of the model; -1 is the free camera.
          overlays: `TextOverlay`s to draw on an RGB picture.
          depth: distances in metres, (height, width) float32, instead of colours.
          segmentation: (height, width, 2) int32 of object number and `mjtObj` type, -1 for the
            background, instead of colours.
          scene_option: a `wrapper.MjvOption` of what to draw.
          render_flag_overrides: rendering flags by name, such as {'wireframe': True}.
          scene_callback: called with the physics and the scene before it is drawn.
          quality: 'full', as dm_control, or 'fast', without shadows, reflections and sky.

        Returns:
          (height, width, 3) uint8 unless depth or segmentation is asked for.
        """
        what = height, width, camera_id, overlays, depth, segmentation
        how = scene_option, render_flag_overrides, scene_callback, quality
        return camera.render(self, *what, *how)

    @property
    def contexts(self) -> Any:
        """The OpenGL and MuJoCo rendering contexts, as `contexts.gl` and `contexts.mujoco`."""
        return camera.contexts(self)


def action_spec(physics: Physics) -> specs.BoundedArray:
    """The spec of the controls, (nu,); an unlimited one is bounded by MuJoCo's maximum."""
    model = physics.model._model
    limited = model.actuator_ctrllimited.ravel().astype(bool)[:, None]
    bounds = np.where(limited, model.actuator_ctrlrange, [-mujoco.mjMAXVAL, mujoco.mjMAXVAL])
    return specs.BoundedArray(
        shape=(model.nu,), dtype=float, minimum=bounds[:, 0], maximum=bounds[:, 1]
    )
