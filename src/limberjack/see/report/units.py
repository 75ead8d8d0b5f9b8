"""Names and units of the numbers of a MuJoCo model: positions, velocities, sensors, controls.

    for name, label in fields_of(model).items():
        print(name, label[0])               # 'qpos', [Label('root x', 'm'), ...]
    controls(model)                         # [Label('abdomen_y', '40 N·m'), ...]

Everything is read from the compiled model, so it serves any domain. A number without a unit has
the empty string.
"""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from limberjack.mujoco import fields
from limberjack.mujoco.official import mujoco

if TYPE_CHECKING:
    from mujoco import MjModel

__all__ = ["Label", "controls", "fields_of"]

_Joint, _Sensor, _Transmission = mujoco.mjtJoint, mujoco.mjtSensor, mujoco.mjtTrn


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
    size = fields.axes_of("MjData", name, tuple(shape), model)[0]
    if size is None:
        return []
    if size == "nmocap":
        bodies = sorted(range(model.nbody), key=lambda body: model.body_mocapid[body])
        kept = bodies[model.nbody - model.nmocap :]
        rows = [_names(model, "body")[body] for body in kept]
    else:
        kind = fields.RAGGED[size][0] if size in fields.RAGGED else fields.OBJECTS[size]
        rows = _names(model, kind)
    if len(rows) != shape[0]:  # objects with several numbers, as activations
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
