"""`WarpSimulation`: many simulations of one model on a device, stepped by MuJoCo Warp.

    simulation = WarpSimulation(model, num_envs=4096, device="cuda:0", own_fields=(), sizes=sizes)
    simulation.advance(5)
    simulation.first_half()
    heights = simulation.data_field("xpos")[0][:, 3, 2]      # (4096,), a `DeviceArray`

It implements `Fields`, the part of a `Simulation` that task code reads, and has the controls. A
control step is `advance` and then `first_half`. Between the two, rows may be set to another state,
such as the start of an episode: the first half then computes everything that positions and
velocities determine.

Quantities of forces and accelerations belong to the last time step, as on the CPU. MuJoCo Warp
clears their sensors in the first half of the next step. Therefore `late` has a separate array for
`sensordata` and for every other such field that a task reads.

On CUDA, the kernels of a call are recorded and replayed: see `_Graphs`. Contacts are corrected to
those of MuJoCo's C engine where MuJoCo Warp 4.0 finds others: see `_as_in_c`.
"""

import contextlib
import copy
import dataclasses
import gc
import warnings
from collections.abc import Callable, Hashable, Iterator, Sequence

import mujoco
import numpy as np

from limberjack.gpu import model_fields
from limberjack.gpu.backend import mujoco_warp, torch, warp
from limberjack.gpu.sizes import Sizes
from limberjack.gpu.tensors import DeviceArray, constant, device_array
from limberjack.mujoco.simulation import Field
from limberjack.mujoco.wrapper.core import MjModel
from limberjack.mujoco.wrapper.model import fixed_field, is_structure

__all__ = ["WarpSimulation", "bytes_per_row"]

_SENSORS = "sensordata"
# Fields that depend on forces or accelerations; `first_half` does not compute them.
_LATE = (
    *("qacc", "qacc_smooth", "act_dot", "actuator_force", "qfrc_actuator", "qfrc_smooth"),
    *("qfrc_constraint", "cacc", "cfrc_int", "cfrc_ext"),
)
_OVERFLOWS = (
    *("NEFC", "NJMAX_NNZ", "BROADPHASE", "NARROWPHASE", "CCD", "HFIELD"),
    *("CONTACT_MATCH", "NVMAX", "EPA_HORIZON", "TACTILE"),
)  # not those of a solver's iterations, which the CPU limits too
_PLANE, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_NORMAL = 1e-6  # sine of an angle; a capsule that is closer to the normal has no direction
_ROUNDING = 5e-7  # metres; above what float32 rounds off positions some metres from the origin


class WarpSimulation:
    """See the module's docstring.

    Attributes:
      num_envs: number of rows.
      model: the shared model.
      device: of all arrays.
      ctrl: the actuators' controls, (num_envs, nu), live.
      own: model fields of which each row has its own values, (num_envs, ...), live.
      late: readings and other quantities of the last time step, (num_envs, ...) by name.
      late_columns: mask of `sensordata`'s columns that belong to the last time step.
    """

    def __init__(
        self,
        model: MjModel,
        num_envs: int,
        device: str,
        own_fields: Sequence[str],
        sizes: Sizes,
        uses_graphs: bool,
    ) -> None:
        """Makes simulations in the model's default state.

        Args:
          model: the shared model.
          num_envs: number of rows.
          device: as PyTorch and Warp name it: 'cuda:0' or 'cpu'.
          own_fields: model fields of which each row has its own values.
          sizes: room for contacts and constraints.
          uses_graphs: record the steps and replay the records.

        Raises:
          ValueError: MuJoCo Warp cannot vary one of the fields, or lacks a feature of the model.
        """
        self.num_envs: int | None = num_envs
        self.model = model
        self.device = torch.device(device)
        self.stream = None if self.device.type == "cpu" else torch.cuda.Stream(self.device)
        model_fields.check(own_fields)
        names = tuple(own_fields)
        official = _for_warp(model)
        with self.scope():
            self._model = _put_model(official, dict.fromkeys(model_fields.batched(names), num_envs))
            self._data = mujoco_warp.make_data(official, num_envs, sizes.nconmax, njmax=sizes.njmax)
            self.own = {name: self._own_field(official, name) for name in names}
        self._fields: dict[str, torch.Tensor] = {}
        self.ctrl = device_array(self.live("ctrl"))
        self.late: dict[str, torch.Tensor] = {}
        self.late_columns = _late_columns(official)
        self.data_field(_SENSORS)
        self._runs_whole_steps = official.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        self._graphs = _Graphs(self.device, uses_graphs)
        mask = sum(getattr(mujoco_warp.OverflowType, name).value for name in _OVERFLOWS)
        self._overflow, self._overflow_mask = self.live("overflow"), mask

    @contextlib.contextmanager
    def scope(self) -> Iterator[None]:
        """Context in which PyTorch and Warp work on this device, in one stream.

        It leaves inference mode, since arrays that are made there cannot be written outside of it.
        """
        with torch.inference_mode(False), torch.no_grad(), self._stream_scope():
            yield

    @contextlib.contextmanager
    def _stream_scope(self) -> Iterator[None]:
        if self.stream is None:
            with warp.ScopedDevice("cpu"):
                yield
            return
        outside = torch.cuda.current_stream(self.device)
        self.stream.wait_stream(outside)
        ours = warp.stream_from_torch(self.stream)
        device = warp.ScopedDevice(str(self.device))
        with torch.cuda.stream(self.stream), device, warp.ScopedStream(ours):
            yield
        outside.wait_stream(self.stream)

    def advance(self, nstep: int) -> None:
        """Completes the step whose first half ran last, and runs whole steps up to `nstep`."""
        self._graphs.run(("advance", nstep), lambda: self._advance(nstep))
        for name, kept in self.late.items():
            kept.copy_(self.live(name))

    def _advance(self, nstep: int) -> None:
        if self._runs_whole_steps:  # the second half alone would integrate with Euler's method
            self._step_whole(nstep)
            return
        mujoco_warp.step2(self._model, self._data)
        self._step_whole(nstep - 1)

    def _step_whole(self, nstep: int) -> None:
        for _ in range(nstep):
            mujoco_warp.step(self._model, self._data)

    def first_half(self) -> None:
        """Recomputes quantities of positions and velocities, and the sensors that read them."""
        self._graphs.run(("first_half",), lambda: mujoco_warp.step1(self._model, self._data))
        readings = self.late[_SENSORS]
        late = constant(self.late_columns, self.device)
        torch.where(late, readings, self.live(_SENSORS), out=readings)

    def step_bare(self, nstep: int) -> None:
        """Runs time steps alone, for speed comparisons; quantities are stale afterwards."""
        self._graphs.run(("bare", nstep), lambda: self._step_whole(nstep))

    def take_overflow(self) -> torch.Tensor:
        """Mask of rows whose contacts or constraints had no room since the last call."""
        overflow = (self._overflow & self._overflow_mask) != 0
        self._overflow.zero_()
        return overflow

    def live(self, name: str) -> torch.Tensor:
        """A field of the data as MuJoCo Warp has it, (num_envs, ...), a plain tensor."""
        if name not in self._fields:
            array = getattr(self._data, name, None)
            if array is None or not isinstance(array, warp.array):
                raise AttributeError(f"MuJoCo Warp's data has no array {name!r}")
            tensor = warp.to_torch(array)
            if getattr(array.dtype, "_shape_", ()) == (3, 3):  # in MuJoCo they are rows of nine
                tensor = tensor.reshape(*tensor.shape[:-2], 9)
            self._fields[name] = tensor
        return self._fields[name]

    def _own_field(self, official: mujoco.MjModel, name: str) -> torch.Tensor:
        nominal = model_fields.values(official, name)
        shape = (self.num_envs, *nominal.shape)
        if name.startswith("opt."):
            array = model_fields.expand_option(self._model.opt, name, self.num_envs or 1)
        elif model_fields.batched((name,)):
            array = getattr(self._model, name)
        else:  # read by tasks only
            start = torch.as_tensor(nominal, dtype=torch.float32, device=self.device)
            return start.expand(shape).clone()
        return warp.to_torch(array).reshape(shape)

    def data_field(self, name: str) -> Field:
        """See `Fields`."""
        live = self.live(name)
        if name != _SENSORS and name not in _LATE:
            return device_array(live), True
        if name not in self.late:
            self.late[name] = live.clone()
        return device_array(self.late[name]), True

    def model_field(self, name: str) -> Field:
        """See `Fields`. Integers stay in NumPy: tasks use them as indices."""
        if name in self.own:
            return device_array(self.own[name]), True
        official = self.model._official
        if is_structure(name):
            return fixed_field(official, name), False
        field = getattr(official, name)
        if isinstance(field, np.ndarray) and field.dtype.kind == "f":
            return constant(field, self.device), False
        return field, False

    @property
    def own_fields(self) -> dict[str, DeviceArray]:
        """Model fields that differ by row, for `physics.model.opt`."""
        return {name: device_array(values) for name, values in self.own.items()}


def bytes_per_row(model: MjModel, own_fields: Sequence[str], sizes: Sizes) -> int:
    """Memory that a row takes on a device, bytes: the difference between one row and two."""
    with warp.ScopedDevice("cpu"):
        official = _for_warp(model)
        one, two = (
            sum(
                a.capacity
                for a in _arrays(
                    mujoco_warp.make_data(official, rows, sizes.nconmax, njmax=sizes.njmax)
                )
            )
            for rows in (1, 2)
        )
    own = sum(model_fields.values(official, name).size * 4 for name in own_fields)
    return two - one + own


def _arrays(struct: "mujoco_warp.Data") -> Iterator["warp.array"]:
    for field in dataclasses.fields(struct):
        value = getattr(struct, field.name)
        if isinstance(value, warp.array):
            yield value
        elif dataclasses.is_dataclass(value):
            yield from _arrays(value)


def _for_warp(model: MjModel) -> mujoco.MjModel:
    """A copy of the model for MuJoCo Warp."""
    official = copy.copy(model.without_textures()._official)
    # Without this flag MuJoCo Warp 4.0 loses contacts between boxes.
    official.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_NATIVECCD
    return official


def _put_model(official: mujoco.MjModel, batch_sizes: dict[str, int]) -> "mujoco_warp.Model":
    try:
        with warnings.catch_warnings():
            # It uses the larger of a friction and MJ_MINMU, like the C engine.
            warnings.filterwarnings("ignore", ".*MJ_MINMU.* may cause NaN", UserWarning)
            model = mujoco_warp.put_model(official, batch_sizes=batch_sizes)
    except NotImplementedError as error:
        raise ValueError(
            f"MuJoCo Warp cannot simulate this model: {error} Use the CPU: "
            "limberjack.gym.load_vector"
        ) from error
    model.opt.warn_overflow = 0  # counted, not printed: see `take_overflow`
    model.callback.contactfilter = _as_in_c
    return model


def _late_columns(official: mujoco.MjModel) -> np.ndarray:
    late = official.sensor_needstage == mujoco.mjtStage.mjSTAGE_ACC.value
    return np.repeat(late, official.sensor_dim)


class _Graphs:
    """Records sequences of kernels, and replays them with one call each.

        graphs = _Graphs(device, uses_graphs=True)
        graphs.run(("advance", 5), lambda: advance(5))      # runs it
        graphs.run(("advance", 5), lambda: advance(5))      # records it and replays the record
        graphs.run(("advance", 5), lambda: advance(5))      # replays

    A record keeps pointers: the arrays that it reads and writes must stay where they are.
    """

    def __init__(self, device: object, uses_graphs: bool) -> None:
        """Without `uses_graphs`, nothing is recorded and every call runs `body`."""
        self._device = str(device)
        self._uses_graphs = uses_graphs
        self._has_run: set[Hashable] = set()
        self._records: dict[Hashable, object] = {}

    def run(self, key: Hashable, body: Callable[[], None]) -> None:
        """Runs the kernels of `body`, which is the same function for the same key."""
        record = self._records.get(key)
        if record is not None:
            warp.capture_launch(record)
            return
        if not self._uses_graphs or key not in self._has_run:
            self._has_run.add(key)  # the first time, modules are compiled and loaded
            body()
            return
        with _no_collection(), warp.ScopedCapture(self._device) as capture:
            body()
        self._records[key] = capture.graph
        warp.capture_launch(capture.graph)


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Context without garbage collection: freeing an array would be recorded too."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _as_in_c(model: "mujoco_warp.Model", data: "mujoco_warp.Data") -> None:
    """Changes the contacts of all rows to those of MuJoCo's C engine; normals stay.

    - The first tangent of a capsule on a plane points along the capsule. MuJoCo Warp 4.0 chooses
      another one if the capsule is within 30 degrees of the plane's normal, as the thigh or shin of
      a leg may be. Friction depends on the tangents, since its cone is a pyramid.
    - Geoms that only just touch in double precision, as the toes of quadruped fetch do when an
      episode begins, are not in contact. In single precision the rounding of their positions would
      decide.
    """
    contact = data.contact
    warp.launch(
        _correct,
        dim=contact.frame.shape[0],
        inputs=[
            *(model.geom_type, data.geom_xmat, data.nacon),
            *(contact.geom, contact.worldid, contact.includemargin),
        ],
        outputs=[contact.dist, contact.frame],
    )


@warp.kernel
def _correct(
    geom_type: warp.array[int],
    geom_xmat: warp.array2d[warp.mat33],
    count: warp.array[int],
    geoms: warp.array[warp.vec2i],
    rows: warp.array[int],
    margins: warp.array[float],
    distances: warp.array[float],
    frames: warp.array[warp.mat33],
):
    contact = warp.tid()
    if contact >= count[0]:
        return
    if margins[contact] - distances[contact] < _ROUNDING:
        distances[contact] = warp.max(distances[contact], margins[contact])  # exerts no force
    capsule = geoms[contact][1]
    if geom_type[geoms[contact][0]] != _PLANE or geom_type[capsule] != _CAPSULE:
        return
    frame, pose = frames[contact], geom_xmat[rows[contact], capsule]
    normal = warp.vec3(frame[0, 0], frame[0, 1], frame[0, 2])
    axis = warp.vec3(pose[0, 2], pose[1, 2], pose[2, 2])
    along = axis - normal * warp.dot(normal, axis)
    if warp.length(along) < _NORMAL:
        return
    first = warp.normalize(along)
    second = warp.cross(normal, first)
    frames[contact] = warp.matrix_from_rows(normal, first, second)
