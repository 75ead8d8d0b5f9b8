"""Integer fields of a model: which are fixed, and which are checked at each write.

    modes = checked_field(official, "cam_mode")
    modes[0] = 3        # ValueError, and nothing changes, unless the model as a whole stays valid

MuJoCo checks references and types when it compiles or reads a model and never again: a wrong one
makes it read out of bounds, which ends the process. `is_structure` fields (parents, addresses,
counts) cannot be written at all. `is_checked` fields can, if MuJoCo's compiler would accept the
model with the new values. Fields that are valid only together, such as `geom_type` with
`geom_dataid` and `geom_size`, are checked together, so a program writes the data first.

After a write of `geom_type` or `geom_dataid`, the bounding volumes of the geoms are recomputed, as
MuJoCo would otherwise miss contacts. Masses and inertias stay as compiled.
"""

import functools
from collections.abc import Callable, Container, Mapping

import mujoco
import numpy as np

from limberjack.mujoco.allocating import copy_of, data_of
from limberjack.mujoco.exit_guard import pass_exit_guard
from limberjack.mujoco.read_only import Checked, ReadOnly

__all__ = [
    "FIXED",
    "NO_TEXTURES",
    "check_values",
    "checked_field",
    "empty_model",
    "fixed_field",
    "is_checked",
    "is_structure",
    "rows_field",
]

FIXED = "{} is part of the model's structure and read-only: change the MJCF and compile it again"
NO_TEXTURES = (
    "a batch initialises episodes in a simulation without textures: the start of an episode cannot "
    "read or change tex_data; change the model before creating the batch"
)

_AT_A_START = "{} of a row is read-only: only the task's initialize_episode can set it"

# Suffixes of integer fields that may have any value: masks, priorities, groups and pixels.
_ANY_VALUE = ("contype", "conaffinity", "priority", "group", "tex_data")

# Booleans by which MuJoCo's compiler has chosen the sizes of other fields.
_FIXED_FLAGS = ("flex_centered", "flex_rigid", "flexedge_rigid")

_TYPE = mujoco.mjtGeom
_PLANE, _HFIELD = _TYPE.mjGEOM_PLANE.value, _TYPE.mjGEOM_HFIELD.value
_MESH, _SDF = _TYPE.mjGEOM_MESH.value, _TYPE.mjGEOM_SDF.value
# Shapes that need no data, and how many positive sizes each has.
_SIZES = {
    _PLANE: 0,
    _TYPE.mjGEOM_SPHERE.value: 1,
    _TYPE.mjGEOM_CAPSULE.value: 2,
    _TYPE.mjGEOM_ELLIPSOID.value: 3,
    _TYPE.mjGEOM_CYLINDER.value: 2,
    _TYPE.mjGEOM_BOX.value: 3,
}
# Shapes that are stored elsewhere, and the size of the model that counts them.
_ASSETS = {_HFIELD: ("height field", "nhfield"), _MESH: ("mesh", "nmesh")}
_KINDS = {*_SIZES, *_ASSETS}
_SAME_FRAME = mujoco.mjtSameFrame.mjSAMEFRAME_BODY.value
_NO_TURN = (1.0, 0.0, 0.0, 0.0)  # as a quaternion
_FLAT = mujoco.mjtTexture.mjTEXTURE_2D.value
_FACES = 6  # of a cube
_CHANNELS = (3, 4)  # that MuJoCo can upload; it would keep showing the earlier pixels for others
_LARGEST = 16_384  # pixels; side of a texture that OpenGL implementations accept
_CONTACT_DIMENSIONS = (1, 3, 4, 6)
_RANGEFINDER = mujoco.mjtSensor.mjSENS_RANGEFINDER.value
_CAMERA = mujoco.mjtObj.mjOBJ_CAMERA.value
# Actuators whose force is affine in their input, length and velocity.
_AFFINE_GAINS = (mujoco.mjtGain.mjGAIN_FIXED.value, mujoco.mjtGain.mjGAIN_AFFINE.value)
_AFFINE_BIASES = (mujoco.mjtBias.mjBIAS_NONE.value, mujoco.mjtBias.mjBIAS_AFFINE.value)

# The new values of a whole field.
_Check = Callable[[mujoco.MjModel, str, np.ndarray], None]
_Allowed = Callable[[mujoco.MjModel], tuple[Container[int], str]]


@functools.cache
def is_structure(name: str) -> bool:
    """Whether a field of MjModel must not be written without a check."""
    field = getattr(empty_model(), name, None)
    is_integer = isinstance(field, np.ndarray) and field.dtype.kind in "iu"
    return name in _FIXED_FLAGS or (is_integer and not name.endswith(_ANY_VALUE))


def is_checked(name: str) -> bool:
    """Whether a field of MjModel can be written where `checked_field` accepts the values."""
    return name in _CHECKS


def fixed_field(model: mujoco.MjModel, name: str) -> np.ndarray:
    """A structural field as a read-only view."""
    return ReadOnly.of(getattr(model, name), FIXED.format(name))


def checked_field(model: mujoco.MjModel, name: str) -> np.ndarray:
    """A checked field as a view that refuses values with which the model is invalid."""
    return Checked.of(getattr(model, name), functools.partial(_write, model, name))


def check_values(model: mujoco.MjModel, values: Mapping[str, np.ndarray]) -> None:
    """Checks new values of fields of a model, by name, of which some may be checked fields.

    Raises:
      ValueError: with them, the model would be invalid.
    """
    for name in filter(is_checked, values):
        if name not in _OF_GEOMS:
            _CHECKS[name](model, name, np.asarray(values[name]))
    if any(name in values for name in _OF_GEOMS):
        of_geoms = {name: np.asarray(values.get(name, getattr(model, name))) for name in _GEOMS}
        _check_shapes(model, **of_geoms)


def rows_field(model: mujoco.MjModel, name: str, rows: np.ndarray) -> np.ndarray:
    """An integer field of several simulations of a model, (num_envs, ...), as `checked_field`."""
    if not is_checked(name) or name in _OF_GEOMS:
        return ReadOnly.of(rows, _AT_A_START.format(name))

    def write(values: np.ndarray) -> None:
        for row in np.flatnonzero((rows != values).reshape(len(rows), -1).any(axis=-1)):
            check_values(model, {name: values[row]})
        np.copyto(rows, values)

    return Checked.of(rows, write)


@functools.cache
def empty_model() -> mujoco.MjModel:
    """A model without objects, which has every field."""
    # Not parsed from XML, which would make it the model that `mj_saveLastXML` writes.
    return mujoco.MjSpec().compile()


def _write(model: mujoco.MjModel, name: str, values: np.ndarray) -> None:
    """Sets a checked field and what is derived from it, or raises ValueError and sets nothing."""
    before = getattr(model, name)
    if before.tobytes() == values.tobytes():
        return
    pass_exit_guard()
    _CHECKS[name](model, name, values)
    if name not in _OF_GEOMS:
        np.copyto(before, values)
        return
    changed = np.flatnonzero(before != values)
    bounds = _bounds(model, name, values, changed)
    np.copyto(before, values)
    for field, derived in bounds.items():
        np.copyto(getattr(model, field), derived)


def _refused(name: str, index: object, value: object, expected: str) -> ValueError:
    place = f"{name}[{index}]"
    return ValueError(f"{place} cannot be {value}: expected {expected}; nothing was changed")


def _one_of(allowed: _Allowed) -> _Check:
    """A check of each new value on its own."""

    def check(model: mujoco.MjModel, name: str, values: np.ndarray) -> None:
        valid, expected = allowed(model)
        for place in np.argwhere(getattr(model, name) != values):
            value = int(values[tuple(place)])
            if value not in valid:
                index = ", ".join(map(str, place.tolist()))
                raise _refused(name, index, value, expected)

    return check


def _numbers_of(size: str, what: str) -> _Check:
    """A check of references to objects of a kind, or to none."""

    def allowed(model: mujoco.MjModel) -> tuple[Container[int], str]:
        count = getattr(model, size)
        expected = f"-1 for none, or the number of a {what}, of which the model has {count}"
        return range(-1, count), expected

    return _one_of(allowed)


def _values(valid: Container[int], expected: str) -> _Check:
    return _one_of(lambda _: (valid, expected))


def _members(enum: str) -> _Check:
    """A check of the members of one of MuJoCo's enums, by name, that count from 0."""
    members = getattr(mujoco, enum).__members__
    count = sum(not name.startswith("mjN") for name in members)
    return _values(range(count), f"a mujoco.{enum}, 0 to {count - 1}")


def _check_resolution(model: mujoco.MjModel, name: str, values: np.ndarray) -> None:
    _values(range(1, 2**31), "a positive number of pixels")(model, name, values)
    for camera in np.flatnonzero((model.cam_resolution != values).any(axis=-1)).tolist():
        ranges = (model.sensor_type == _RANGEFINDER) & (model.sensor_objtype == _CAMERA)
        if (ranges & (model.sensor_objid == camera)).any():
            expected = (
                f"{model.cam_resolution[camera]}, since a rangefinder has one reading for each "
                "pixel: change the MJCF and compile it again"
            )
            raise _refused(name, camera, values[camera], expected)


def _both(affine: tuple[int, ...]) -> _Check:
    """A check of actuators' gains or biases, which stay affine."""
    expected = (
        f"{' or '.join(map(str, affine))}, for an actuator that has one of these: other types need "
        "parameters from the compiler, so change the MJCF and compile it again"
    )

    def check(model: mujoco.MjModel, name: str, values: np.ndarray) -> None:
        before = getattr(model, name)
        for index in np.flatnonzero(before != values).tolist():
            if before[index] not in affine or values[index] not in affine:
                raise _refused(name, index, values[index], expected)

    return check


def _check_frames(model: mujoco.MjModel, name: str, values: np.ndarray) -> None:
    """A frame may be marked as different, or as equal to another one if it is."""
    changed = np.flatnonzero(getattr(model, name) != values)
    if not values[changed].any():
        return
    true = getattr(_with_constants(copy_of(model)), name)
    if name == "body_sameframe":  # MuJoCo leaves out bodies that do not move
        is_same = (model.body_ipos == 0).all(axis=-1) & (model.body_iquat == _NO_TURN).all(axis=-1)
        true[is_same] = _SAME_FRAME
    for index in changed.tolist():
        if values[index] not in (0, true[index]):
            only = f"0, or {true[index]} for its present pose" if true[index] else "0"
            raise _refused(name, index, values[index], f"{only}: MuJoCo skips the transformation")


def _check_textures(model: mujoco.MjModel, name: str, values: np.ndarray) -> None:
    """Every texture that changes must lie in the stored pixels."""
    if not model.ntexdata:
        raise ValueError(NO_TEXTURES)
    sizes = {field: getattr(model, field) for field in _OF_TEXTURES} | {name: values}
    for texture in np.flatnonzero(getattr(model, name) != values).tolist():
        height, width, channels, start = (int(sizes[f][texture]) for f in _OF_TEXTURES)
        value = values[texture]
        if channels not in _CHANNELS:
            raise _refused(name, texture, value, "3 or 4 channels")
        if not (1 <= height <= _LARGEST and 1 <= width <= _LARGEST):
            raise _refused(name, texture, value, f"1 to {_LARGEST} pixels")
        is_cube = model.tex_type[texture] != _FLAT and height != width
        # MuJoCo reads the faces; when a saved model is loaded, it also checks the product.
        rows = max(height, _FACES * width) if is_cube else height
        count = channels * width * rows
        if start < 0 or start + count > model.ntexdata:
            why = " (a cube whose height is not its width has six faces of width squared)"
            expected = (
                f"a texture within tex_data: {height} by {width} pixels of {channels} bytes"
                f"{why if is_cube else ''} end at {start + count} of {model.ntexdata}; write "
                "smaller sizes, the smaller one first, or compile a model with a larger texture"
            )
            raise _refused(name, texture, value, expected)


def _check_geoms(model: mujoco.MjModel, name: str, values: np.ndarray) -> None:
    check_values(model, {name: values})


def _check_shapes(
    model: mujoco.MjModel, geom_type: np.ndarray, geom_dataid: np.ndarray, geom_size: np.ndarray
) -> None:
    """Every geom that changes must have a shape that can collide, with the data that it needs."""
    for name, values in (("geom_type", geom_type), ("geom_dataid", geom_dataid)):
        for geom in np.flatnonzero(getattr(model, name) != values).tolist():
            shape = int(geom_type[geom]), int(geom_dataid[geom]), geom_size[geom]
            expected = _geom_needs(model, geom, *shape)
            if expected is not None:
                raise _refused(name, geom, values[geom], expected)


def _geom_needs(
    model: mujoco.MjModel, geom: int, kind: int, data: int, size: np.ndarray
) -> str | None:
    """The values that would be valid for a geom of this shape; None if it is valid."""
    if kind not in _KINDS or model.geom_type[geom] == _SDF:
        return (
            "a type that collides and needs no plugin, mujoco.mjtGeom 0 to 7: change the MJCF and "
            "compile it again"
        )
    body = model.geom_bodyid[geom]
    if kind == _PLANE and model.body_weldid[body]:
        return f"another type: a plane cannot be attached to body {body}, which moves"
    if kind in _ASSETS:
        what, number = _ASSETS[kind]
        count = getattr(model, number)
        if 0 <= data < count:
            return None
        if not count:
            return f"another type, since the model has no {what}: add one to the MJCF"
        return (
            f"a geom_dataid from 0 to {count - 1} for the type of a {what}, but it is {data}: "
            "write geom_dataid first, then geom_type; a geom of the other type with data becomes "
            "a sphere before that"
        )
    most = max(model.nmesh, model.nhfield)
    if not -1 <= data < most:
        return f"-1 for none, or the number of a mesh or height field, below {most}"
    if not (size[: _SIZES[kind]] > 0).all():
        return (
            f"{_SIZES[kind]} positive sizes for a geom of type {kind}, but geom_size is {size}: "
            "write geom_size first"
        )
    return None


def _bounds(
    model: mujoco.MjModel, name: str, values: np.ndarray, geoms: np.ndarray
) -> dict[str, np.ndarray]:
    """The fields that bound geoms, once some of them have new types or data."""
    changed = copy_of(model)
    np.copyto(getattr(changed, name), values)
    meshes = [geom for geom in geoms.tolist() if changed.geom_type[geom] == _MESH]
    for geom in meshes:
        number = changed.geom_dataid[geom]
        start = changed.mesh_vertadr[number]
        vertices = changed.mesh_vert[start : start + changed.mesh_vertnum[number]].astype(float)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        changed.geom_aabb[geom] = [*(low + high) / 2, *(high - low) / 2]
    _with_constants(changed)
    for geom in meshes:
        middle, half = changed.geom_aabb[geom, :3], changed.geom_aabb[geom, 3:]
        changed.geom_rbound[geom] = np.linalg.norm(abs(middle) + half)
    derived = {field: getattr(model, field).copy() for field in _BOUNDS}
    for field, array in derived.items():
        array[geoms] = getattr(changed, field)[geoms]
    boxes = model.bvh_aabb.copy()
    for body in np.unique(model.geom_bodyid[geoms]).tolist():
        start = model.body_bvhadr[body]
        tree = slice(start, start + model.body_bvhnum[body])
        if start >= 0:
            boxes[tree] = changed.bvh_aabb[tree]
    return {**derived, "bvh_aabb": boxes}


def _with_constants(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model, after MuJoCo has recomputed what it derives from other fields."""
    try:
        mujoco.mj_setConst(model, data_of(model))
    except mujoco.FatalError:
        # It refuses geoms that were made to collide and have no box in the tree of their body.
        of_bodies = model.bvh_nodeid[: model.body_bvhnum.sum()]  # before those of flexes and meshes
        has_box = np.isin(np.arange(model.ngeom), of_bodies)
        model.geom_contype[~has_box] = model.geom_conaffinity[~has_box] = 0
        mujoco.mj_setConst(model, data_of(model))
    return model


_BOUNDS = ("geom_rbound", "geom_aabb", "geom_fluid")
_OF_GEOMS = ("geom_type", "geom_dataid")
_GEOMS = (*_OF_GEOMS, "geom_size")  # fields that are valid together
_OF_TEXTURES = ("tex_height", "tex_width", "tex_nchannel", "tex_adr")
_MATERIAL = _numbers_of("nmat", "material")
_TEXTURE = _numbers_of("ntex", "texture")
_TARGET = _numbers_of("nbody", "body")
_TRACKING = _members("mjtCamLight")
_DIMENSION = _values(_CONTACT_DIMENSIONS, "1, 3, 4 or 6")
_SHAPE = _values([2, 3, 4, 5, 6], "a sphere, capsule, ellipsoid, cylinder or box, 2 to 6")

_CHECKS: dict[str, _Check] = {
    "actuator_biastype": _both(_AFFINE_BIASES),
    "actuator_gaintype": _both(_AFFINE_GAINS),
    "body_sameframe": _check_frames,
    "cam_mode": _TRACKING,
    "cam_output": _values(range(2**mujoco.mjtCamOutBit.mjNCAMOUT.value), "a mask of mjtCamOutBit"),
    "cam_projection": _members("mjtProjection"),
    "cam_resolution": _check_resolution,
    "cam_targetbodyid": _TARGET,
    "flex_condim": _DIMENSION,
    "flex_matid": _MATERIAL,
    "geom_condim": _DIMENSION,
    "geom_dataid": _check_geoms,
    "geom_matid": _MATERIAL,
    "geom_sameframe": _check_frames,
    "geom_type": _check_geoms,
    "light_mode": _TRACKING,
    "light_targetbodyid": _TARGET,
    "light_texid": _TEXTURE,
    "light_type": _members("mjtLightType"),
    "mat_texid": _TEXTURE,
    "pair_dim": _DIMENSION,
    "site_matid": _MATERIAL,
    "site_sameframe": _check_frames,
    "site_type": _SHAPE,
    "skin_matid": _MATERIAL,
    "tendon_matid": _MATERIAL,
    **dict.fromkeys(_OF_TEXTURES, _check_textures),
}
