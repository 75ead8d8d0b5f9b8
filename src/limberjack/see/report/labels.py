"""Names and units of what a policy sees and does: traced to the model, and declared by the domain.

    labels = labels_of(environment)
    labels.observations["joint_angles"][0]      # Label('abdomen_z', 'rad')
    labels.actions[0]                           # Label('abdomen_y', '40 N·m')
    fields_of(model)["qpos"][0]                 # Label('root x', 'm')

The names and units of the model's own numbers (positions, velocities, sensors, controls) are read
from the compiled model; a number without a unit has the empty string.

A domain declares no names. Every number of a copy of the simulation's state is replaced by a
distinct random one, and the task observes that copy: a number of the observation that is one of
them, or its sine, cosine or log1p, has its name and unit. A number that is computed from several is
named after the body, joint or sensor that it alone depends on, and what remains has its index. Both
have the unit that `OBSERVATIONS` of the task's module declares for all numbers of the observation.
An observation of more than a thousand numbers, such as a picture, has no labels.
"""

import copy
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from limberjack.mujoco import Physics, fields
from limberjack.mujoco.official import mujoco
from limberjack.rl.control import Environment, flatten_observation
from limberjack.rl.memory import stand_in
from limberjack.suite.base import Observed

if TYPE_CHECKING:
    from mujoco import MjModel

__all__ = ["MOST_NUMBERS", "Label", "Labels", "controls", "fields_of", "labels_of"]

MOST_NUMBERS = 1000  # of an observation that has labels and a chart; a picture has more

_Joint, _Sensor, _Transmission = mujoco.mjtJoint, mujoco.mjtSensor, mujoco.mjtTrn

_LEAST, _MOST = 0.1, 0.9  # of the random numbers: positive, so that logarithms and roots exist
_SAME = 1e-12  # relative; functions of arrays may round the last bit by position
_MOST_ROWS = 2000  # of all fields together; the task observes once for each, in about 0.1 ms
_AXES = "xyz"
_AND = "; "  # between the units of an observation whose numbers have several


class Label(NamedTuple):
    """The name and the unit of a number."""

    name: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


# Fields of MjData with one unit for all of their numbers.
_UNITS = {
    **dict.fromkeys(
        ("xpos", "xipos", "xanchor", "geom_xpos", "site_xpos", "cam_xpos", "light_xpos"), "m"
    ),
    **dict.fromkeys(("subtree_com", "mocap_pos"), "m"),
    **dict.fromkeys(("xquat", "xmat", "ximat", "xaxis", "geom_xmat", "site_xmat", "cam_xmat"), ""),
    **dict.fromkeys(("light_xdir", "mocap_quat", "act"), ""),
    "subtree_linvel": "m/s",
    "subtree_angmom": "kg·m²/s",
    # Those of a tendon depend on the joints that it couples.
    **dict.fromkeys(("ten_length", "ten_velocity"), ""),
}
_SENSOR_UNITS = {
    "m": "RANGEFINDER FRAMEPOS SUBTREECOM GEOMDIST GEOMFROMTO",
    "m/s": "VELOCIMETER FRAMELINVEL SUBTREELINVEL",
    "m/s²": "ACCELEROMETER FRAMELINACC",
    "rad/s": "GYRO BALLANGVEL FRAMEANGVEL",
    "rad/s²": "FRAMEANGACC",
    "N": "TOUCH FORCE",
    "N·m": "TORQUE",
    "T": "MAGNETOMETER",
    "kg·m²/s": "SUBTREEANGMOM",
    "J": "E_POTENTIAL E_KINETIC",
    "s": "CLOCK",
}
_UNIT_OF_SENSOR = {kind: unit for unit, kinds in _SENSOR_UNITS.items() for kind in kinds.split()}
# Sensors of a joint: their units where it slides and where it turns.
_OF_JOINT = {
    "JOINTPOS": ("m", "rad"),
    "JOINTVEL": ("m/s", "rad/s"),
    "JOINTACTFRC": ("N", "N·m"),
    "JOINTLIMITPOS": ("m", "rad"),
    "JOINTLIMITVEL": ("m/s", "rad/s"),
    "JOINTLIMITFRC": ("N", "N·m"),
}
_VECTOR, _QUATERNION = fields.COLUMN_NAMES["xyz"], fields.COLUMN_NAMES["quat"]
_TURNED = [(f" {part}", "") for part in _QUATERNION]
_POSITIONS = {  # of a joint's kind: the parts of its names and their units
    _Joint.mjJNT_FREE: [*((f" {axis}", "m") for axis in _VECTOR), *_TURNED],
    _Joint.mjJNT_BALL: _TURNED,
    _Joint.mjJNT_SLIDE: [("", "m")],
    _Joint.mjJNT_HINGE: [("", "rad")],
}
_TURNING = [(f" about {axis}", "rad/s") for axis in _VECTOR]
_VELOCITIES = {
    _Joint.mjJNT_FREE: [*((f" {axis}", "m/s") for axis in _VECTOR), *_TURNING],
    _Joint.mjJNT_BALL: _TURNING,
    _Joint.mjJNT_SLIDE: [("", "m/s")],
    _Joint.mjJNT_HINGE: [("", "rad/s")],
}


def fields_of(model: "MjModel") -> dict[str, list[Label]]:
    """The labels of the numbers of MjData's fields, in row-major order, by field."""
    found = {
        "qpos": _of_joints(model, _POSITIONS),
        "qvel": _of_joints(model, _VELOCITIES),
        "ctrl": controls(model),
        "sensordata": [label for i in range(model.nsensor) for label in _of_sensor(model, i)],
    }
    data = mujoco.MjData(model)
    for name, unit in _UNITS.items():
        found[name] = _of_field(model, name, unit, getattr(data, name).shape)
    return found


def controls(model: "MjModel") -> list[Label]:
    """The labels of the actuators' controls, (nu,).

    The unit is what a control of 1 stands for: a force or torque for a motor, a position or
    velocity for a servo; the empty string for anything else.
    """
    names = _names(model, "actuator")
    if len(names) != model.nu:
        return [Label(f"control {i}") for i in range(model.nu)]
    return [Label(name, _unit_of_control(model, i)) for i, name in enumerate(names)]


def _of_joints(model: "MjModel", parts: dict[object, list[tuple[str, str]]]) -> list[Label]:
    kinds = [_Joint(kind) for kind in model.jnt_type]
    return [
        Label(name + part, unit)
        for name, kind in zip(_names(model, "jnt"), kinds, strict=True)
        for part, unit in parts[kind]
    ]


def _of_sensor(model: "MjModel", number: int) -> list[Label]:
    """The labels of a sensor's numbers."""
    kind = _Sensor(model.sensor_type[number]).name.removeprefix("mjSENS_")
    name, size = _names(model, "sensor")[number], model.sensor_dim[number]
    unit = _UNIT_OF_SENSOR.get(kind, "")
    if kind in _OF_JOINT:
        joint = model.jnt_type[model.sensor_objid[number]]
        unit = _OF_JOINT[kind][joint == _Joint.mjJNT_HINGE]
    if size == 1:
        return [Label(name, unit)]
    parts = {3: _VECTOR, 4: _QUATERNION}.get(size, list(map(str, range(size))))
    return [Label(f"{name} {part}", unit) for part in parts]


def _of_field(model: "MjModel", name: str, unit: str, shape: Sequence[int]) -> list[Label]:
    """The labels of a field whose rows are objects, and whose columns have names or are none."""
    size = fields.axes_of("MjData", name, len(shape))[0]
    if size is None:
        return []
    if size == "nmocap":
        bodies = sorted(range(model.nbody), key=lambda body: model.body_mocapid[body])
        kept = bodies[model.nbody - model.nmocap :]
        rows = [_names(model, "body")[body] for body in kept]
    else:
        kinds = fields.OBJECTS | dict.fromkeys(fields.ACTUATORS, "actuator")
        kind = fields.RAGGED[size][0] if size in fields.RAGGED else kinds[size]
        rows = _names(model, kind)
    if len(rows) != shape[0]:  # objects with several numbers, or none, as activations
        return []
    columns = _columns(shape)
    return [Label(f"{row}{column}", unit) for row in rows for column in columns]


def _columns(shape: Sequence[int]) -> list[str]:
    """The suffixes of an object's name for the numbers of its row."""
    if len(shape) == 1:
        return [""]
    named = {3: "xyz", 4: "quat", 9: "mat"}
    return [f" {part}" for part in fields.COLUMN_NAMES[named[shape[1]]]]


def _unit_of_control(model: "MjModel", number: int) -> str:
    kind = _Transmission(model.actuator_trntype[number])
    if kind not in (_Transmission.mjTRN_JOINT, _Transmission.mjTRN_JOINTINPARENT):
        return ""
    slides = model.jnt_type[model.actuator_trnid[number, 0]] == _Joint.mjJNT_SLIDE
    gain, gear = model.actuator_gainprm[number, 0], model.actuator_gear[number, 0]
    is_plain = model.actuator_dyntype[number] == mujoco.mjtDyn.mjDYN_NONE
    if not is_plain or model.actuator_gaintype[number] != mujoco.mjtGain.mjGAIN_FIXED:
        return ""
    if model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_NONE:
        return f"{gain * gear:g} {'N' if slides else 'N·m'}"
    _, stiffness, damping = model.actuator_biasprm[number, :3]
    if gear != 1 or gain not in (-stiffness, -damping):
        return ""
    length = "m" if slides else "rad"
    return length if gain == -stiffness else f"{length}/s"


def _names(model: "MjModel", kind: str) -> list[str]:
    """The names of all objects of a kind, in order; those without one have their number."""
    starts: Iterable[int] = getattr(model, f"name_{kind}adr").ravel().tolist()
    names = (model.names[start : model.names.find(b"\0", start)].decode() for start in starts)
    return [name or f"{kind} {number}" for number, name in enumerate(names)]


class Labels(NamedTuple):
    """Labels of an environment's observations, by name, and of its actions; row-major order."""

    observations: Mapping[str, Sequence[Label]]
    actions: Sequence[Label]


def labels_of(environment: Environment) -> Labels:
    """The labels of an environment's flattened observations and actions.

    Observations without names and units are absent; there are no actions unless each is a control
    of an actuator. The environment is not changed, nor what its task remembers.
    """
    physics = environment.physics
    if not isinstance(physics, Physics):
        return Labels({}, ())
    model = physics.model._official
    names = controls(model)
    spec = environment.action_spec()
    actions = names if getattr(spec, "shape", None) == (len(names),) else ()
    with stand_in(environment.task, physics):
        try:
            observed = _Probe(environment, physics).observed()
        except Exception:  # of a task that computes with the state: charts then show indices
            return Labels({}, actions)
    return Labels(observed, actions)


class _Probe:
    """A copy of a simulation whose numbers are set at will, and the task that observes it."""

    def __init__(self, environment: Environment, physics: Physics) -> None:
        self._task = environment.task
        self._is_flat = environment._flat_observation
        self._physics = physics.copy(share_model=True)
        data = self._physics.data._data
        labels = fields_of(physics.model._official)
        self._labels = {name: of for name, of in labels.items() if of}
        self._arrays = {name: getattr(data, name) for name in self._labels}
        self._stream = np.random.RandomState(0)
        for array in self._arrays.values():
            array[...] = self._stream.uniform(_LEAST, _MOST, array.shape)
        self._base = {name: array.copy() for name, array in self._arrays.items()}

    def observed(self) -> dict[str, list[Label]]:
        """The labels of each observation that has any."""
        values, units = self._observe(), self._units()
        found = {name: self._matching(value) for name, value in values.items()}
        has_all = all(label is not None for labels in found.values() for label in labels)
        is_quick = values.keys() == units.keys()  # a picture is drawn again for each row
        if not has_all and is_quick and sum(map(len, self._arrays.values())) <= _MOST_ROWS:
            for name, derived in self._derived(values, units).items():
                pairs = zip(found[name], derived, strict=True)
                found[name] = [label or other for label, other in pairs]
        return {
            name: [label or _unnamed(name, units[name], i) for i, label in enumerate(labels)]
            for name, labels in found.items()
            if any(labels) or any(units[name])
        }

    def _observe(self) -> dict[str, np.ndarray]:
        with np.errstate(all="ignore"):
            observation = self._task.get_observation(self._physics)
            if self._is_flat:
                observation = flatten_observation(observation)
        return {
            name: np.array(value, float).ravel()
            for name, value in observation.items()
            if np.size(value) <= MOST_NUMBERS
        }

    def _matching(self, values: np.ndarray) -> list[Label | None]:
        """The labels of numbers that are those of a field, or a function of one."""
        base = np.concatenate([array.ravel() for array in self._base.values()])
        labels = [label for name in self._base for label in self._labels[name]]
        found: list[Label | None] = [None] * len(values)
        for form, function in _FUNCTIONS.items():
            known = function(base)
            for i, value in enumerate(values):
                nearest = int(np.argmin(abs(known - value)))
                if found[i] is None and abs(known[nearest] - value) <= _SAME * abs(value):
                    found[i] = _in_form(labels[nearest], form)
        return found

    def _derived(
        self, values: dict[str, np.ndarray], units: dict[str, list[str]]
    ) -> dict[str, list[Label | None]]:
        """The labels of numbers by the one object that they alone depend on."""
        objects: dict[str, list[set[str]]] = {n: [set() for _ in v] for n, v in values.items()}
        for field, array in self._arrays.items():
            for row in range(len(array)):
                changed = self._changed(values, field, row)
                of_row = self._object(field, row)
                for name, is_changed in changed.items():
                    for i in np.flatnonzero(is_changed):
                        objects[name][i].add(of_row)
        return {name: _named(objects[name], units[name]) for name in values}

    def _object(self, field: str, row: int) -> str:
        """The name of the object of a field's row, without the axis."""
        labels = self._labels[field]
        array = self._arrays[field]
        name = labels[row * (array.size // len(array))].name
        return name if array.ndim == 1 else name.rsplit(" ", 1)[0]

    def _changed(
        self, values: dict[str, np.ndarray], field: str, row: int
    ) -> dict[str, np.ndarray]:
        """Masks of the observations' numbers that depend on a row of a field."""
        array = self._arrays[field]
        array[row] = self._stream.uniform(_LEAST, _MOST, array.shape[1:])
        seen = self._observe()
        self._restore()
        return {name: seen[name] != value for name, value in values.items()}

    def _units(self) -> dict[str, list[str]]:
        """The unit that is declared for each number of the observations; empty if none is."""
        declared = _declared_units(self._task)
        units = copy.copy(self._task.get_observation(self._physics))
        for name, value in units.items():
            units[name] = np.full(np.shape(value), declared.get(name, ""), object)
        if self._is_flat:
            units = flatten_observation(units)
        return {name: list(np.ravel(of)) for name, of in units.items()}

    def _restore(self) -> None:
        for name, array in self._arrays.items():
            array[...] = self._base[name]


_FUNCTIONS = {"{}": np.array, "sin {}": np.sin, "cos {}": np.cos, "log(1 + {})": np.log1p}


def _declared_units(task: object) -> dict[str, str]:
    """The units of observations whose numbers all have the same one, by name."""
    units: dict[str, str] = {}
    for kind in reversed(type(task).__mro__):
        declared = getattr(sys.modules.get(kind.__module__), "OBSERVATIONS", None)
        if isinstance(declared, Mapping):
            units |= {name: of.unit for name, of in declared.items() if isinstance(of, Observed)}
    return {name: unit for name, unit in units.items() if _AND not in unit}


def _unnamed(name: str, units: Sequence[str], index: int) -> Label:
    """The label of a number of an observation that depends on no single object."""
    return Label(name if len(units) == 1 else str(index), units[index])


def _in_form(label: Label, form: str) -> Label:
    if form == "{}":
        return label
    # A function of a number: its unit stands with that number.
    inner = label.name if "sin" in form or "cos" in form else str(label)
    return Label(form.format(inner))


def _named(objects: list[set[str]], units: list[str]) -> list[Label | None]:
    """Labels of one observation's numbers, from the objects that each depends on."""
    shared = set.intersection(*objects) if len(objects) > 1 else set()
    own = [sorted(of_number - shared) for of_number in objects]
    labels: list[Label | None] = []
    for i, names in enumerate(own):
        if len(names) != 1:
            labels.append(None)
            continue
        run = [j for j, others in enumerate(own) if others == names]
        is_vector = len(run) == len(_AXES) and run == list(range(run[0], run[0] + len(_AXES)))
        axis = f" {_AXES[i - run[0]]}" if is_vector else ""
        labels.append(Label(names[0] + axis, units[i]))
    return labels
