"""`is_needless`: whether a model's midphase for the world's planes can be skipped.

To find contacts between two bodies with several geoms, MuJoCo first traverses their trees of
bounding boxes (the midphase). If the world's geoms are planes this is wasted work, since a plane's
box is half of all space. Without the world's tree, every geom is tested against every plane
directly, which makes a step of the arm's tasks 10 % faster and one of the humanoid slightly faster.

The result must be bitwise equal. Contacts come in the same order, plane by plane. They are the same
ones unless a box rules out geoms that touch, which can happen in two ways:

- Boxes of 1e10 metres are rounded to about a micrometre. For an axis-aligned plane through the
  origin there is no rounding; for any other plane the error is constant, and only its sign matters.
  The sign is found with MuJoCo itself: spheres penetrate the plane by a picometre, with radii for
  which rounding has the largest effect.
- Code that changes a geom's size or position in the model does not update the boxes.
"""

import functools
from collections.abc import Iterable, Iterator

import mujoco
import numpy as np

__all__ = ["is_needless"]

_PLANE = mujoco.mjtGeom.mjGEOM_PLANE.value
_MIDPHASE = mujoco.mjtDisableBit.mjDSBL_MIDPHASE.value
_OVERRIDE = mujoco.mjtEnableBit.mjENBL_OVERRIDE.value
# Sensors that also search the trees for geoms.
_SEEING = [mujoco.mjtSensor.mjSENS_RANGEFINDER.value, mujoco.mjtSensor.mjSENS_TACTILE.value]
# Prefixes of model fields on which no box depends, so that they may differ per row.
_HARMLESS = (
    "actuator_",
    "cam_",
    "dof_",
    "eq_",
    "jnt_",
    "light_",
    "mat_",
    "qpos",
    "site_",
    "tendon_",
)
_HARMLESS_TOO = {  # further such fields
    *("body_gravcomp", "body_inertia", "body_mass", "body_pos", "body_quat"),
    *("geom_condim", "geom_friction", "geom_priority", "geom_rgba"),
    *("geom_solimp", "geom_solmix", "geom_solref"),
    *("opt.density", "opt.gravity", "opt.timestep", "opt.viscosity", "opt.wind"),
}
_FEW = 8  # planes
_GRID = 2.0**-20  # metres; spacing of floats near 5e9 metres, half the size of a plane's box
_TOUCH = 1e-12  # metres
_RADII = (2**14 + 5003 * np.arange(8) + 0.5) * _GRID - _TOUCH  # metres; barely rounded down
_ROUNDED = 1e-12  # metres; tolerance for a box that is smaller than its geoms


def is_needless(model: mujoco.MjModel, own_fields: Iterable[str] = ()) -> bool:
    """Whether contacts are bitwise equal without the bounding volume tree of the world body.

    Args:
      model: an `mujoco.MjModel`.
      own_fields: model fields that differ per row.
    """
    planes = np.flatnonzero(_collides(model) & (model.geom_bodyid == 0))
    if not 0 < len(planes) <= _FEW or (model.geom_type[planes] != _PLANE).any():
        return False
    if not _is_usual(model) or not all(map(_is_harmless, own_fields)):
        return False
    frames = np.concatenate([model.geom_pos[planes], model.geom_quat[planes]], axis=1)
    return _are_in_their_boxes(model) and _finds_touches(tuple(map(tuple, frames.tolist())))


def _collides(model: mujoco.MjModel) -> np.ndarray:
    return (model.geom_contype | model.geom_conaffinity) != 0


def _is_usual(model: mujoco.MjModel) -> bool:
    """Whether contacts depend only on the shapes and poses of the geoms."""
    special = model.nflex or model.npair or model.nplugin or model.opt.enableflags & _OVERRIDE
    margins = model.geom_margin.any() or model.geom_gap.any()
    return not (special or margins or np.isin(model.sensor_type, _SEEING).any())


def _is_harmless(field: str) -> bool:
    return field.startswith(_HARMLESS) or field in _HARMLESS_TOO


def _are_in_their_boxes(model: mujoco.MjModel) -> bool:
    """Whether all boxes of the bodies' trees still enclose their geoms."""
    for body in range(1, model.nbody):
        turn, place = _matrix(model.body_iquat[body]).T, model.body_ipos[body]
        first = model.body_bvhadr[body]
        for geom, nodes in _leaves(model, first) if first >= 0 else ():
            half = _half_sizes(model, geom)
            if (half > model.geom_aabb[geom, 3:] + _ROUNDED).any():
                return False
            frame = turn @ _matrix(model.geom_quat[geom])
            middle = turn @ (model.geom_pos[geom] - place) + frame @ model.geom_aabb[geom, :3]
            boxes = model.bvh_aabb[first + np.array(nodes)]
            out = np.abs(middle - boxes[:, :3]) + np.abs(frame) @ half - boxes[:, 3:]
            if (out > _ROUNDED).any():
                return False
    return True


def _leaves(model: mujoco.MjModel, first: int) -> Iterator[tuple[int, list[int]]]:
    """The geoms of a tree, each with its path of nodes from the root."""
    paths = [[0]]
    while paths:
        path = paths.pop()
        children = [c for c in model.bvh_child[first + path[-1]].tolist() if c >= 0]
        paths += [[*path, child] for child in children]
        if not children:
            yield int(model.bvh_nodeid[first + path[-1]]), path


def _half_sizes(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Half extents of a geom along its axes, (3,), metres."""
    size, geoms = model.geom_size[geom], mujoco.mjtGeom
    match geoms(model.geom_type[geom]):
        case geoms.mjGEOM_SPHERE:
            return size[[0, 0, 0]]
        case geoms.mjGEOM_CAPSULE:
            return size[[0, 0, 1]] + [0, 0, size[0]]
        case geoms.mjGEOM_CYLINDER:
            return size[[0, 0, 1]]
        case geoms.mjGEOM_BOX | geoms.mjGEOM_ELLIPSOID:
            return size
        case _:  # the box is all that is known of a mesh
            return model.geom_aabb[geom, 3:]


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    """The rotation matrix, (3, 3)."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


@functools.lru_cache(maxsize=64)
def _finds_touches(frames: tuple[tuple[float, ...], ...]) -> bool:
    """Whether the midphase keeps every sphere that touches a plane.

    Args:
      frames: position and quaternion of each of the world's planes.
    """
    for radius in _RADII.tolist():
        model = _world_with_spheres(frames, radius)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for plane in range(len(frames)):
            normal = data.geom_xmat[plane].reshape(3, 3)[:, 2]
            data.qpos[:3] = data.geom_xpos[plane] + (radius - _TOUCH) * normal
            if _touches(model, data, 0) != _touches(model, data, _MIDPHASE):
                return False
    return True


def _world_with_spheres(frames: tuple[tuple[float, ...], ...], radius: float) -> mujoco.MjModel:
    """A world of planes and a body with two spheres, since a single geom has no tree."""
    spec = mujoco.MjSpec()
    for frame in frames:
        plane = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
        plane.pos, plane.quat = frame[:3], frame[3:]
    body = spec.worldbody.add_body()
    body.add_freejoint()
    for _ in range(2):
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0])
    return spec.compile()


def _touches(model: mujoco.MjModel, data: mujoco.MjData, disabled: int) -> list[list[int]]:
    """Pairs of geoms in contact, in MuJoCo's order."""
    model.opt.disableflags = disabled
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    return data.contact.geom.tolist()
