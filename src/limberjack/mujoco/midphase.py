"""Whether simulations of a model find contacts with the world's planes without a midphase.

Before MuJoCo looks for contacts of two bodies with several geoms, it goes through two trees of
boxes around these, its midphase. With a world of planes it does so in vain: a plane's box is half
of all space. Where the world has no tree each geom is tried with each plane at once, which makes a
step of the arm's tasks a tenth quicker and one of the humanoid's a little.

That must not change a bit. The contacts come in the same order, plane by plane. They are the same
if no box rules out what touches, which it may:

- Boxes of 1e10 metres are rounded to a micrometre. For a plane through the origin along the axes
  nothing is; for any other the error never changes, and only its sign counts. MuJoCo itself tells
  it: spheres touch the plane by a picometre, with radii for which rounding does the most harm.
- Who changes a geom's size or place in the model leaves its boxes behind.
"""

import functools
from collections.abc import Iterable, Iterator

import mujoco
import numpy as np

__all__ = ["is_needless"]

_PLANE = mujoco.mjtGeom.mjGEOM_PLANE.value
_MIDPHASE = mujoco.mjtDisableBit.mjDSBL_MIDPHASE.value
_OVERRIDE = mujoco.mjtEnableBit.mjENBL_OVERRIDE.value
# Sensors that may look for geoms in the trees, too.
_SEEING = [mujoco.mjtSensor.mjSENS_RANGEFINDER.value, mujoco.mjtSensor.mjSENS_TACTILE.value]
# What a simulation may have for itself, as no box depends on it: of these, and besides.
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
_HARMLESS_TOO = {
    *("body_gravcomp", "body_inertia", "body_mass", "body_pos", "body_quat"),
    *("geom_condim", "geom_friction", "geom_priority", "geom_rgba"),
    *("geom_solimp", "geom_solmix", "geom_solref"),
    *("opt.density", "opt.gravity", "opt.timestep", "opt.viscosity", "opt.wind"),
}
_FEW = 8  # planes
_GRID = 2.0**-20  # metres; to which numbers of 5e9 metres, half of a plane's box, are rounded
_TOUCH = 1e-12  # metres
_RADII = (2**14 + 5003 * np.arange(8) + 0.5) * _GRID - _TOUCH  # metres; just rounded down
_ROUNDED = 1e-12  # metres; by so much a box may be smaller than what it is made for


def is_needless(model: mujoco.MjModel, own_fields: Iterable[str] = ()) -> bool:
    """Whether contacts are the same, bit for bit, without the tree of the world's geoms.

    Args:
      model: an `mujoco.MjModel`.
      own_fields: of the model, that each simulation has for itself.
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
    """Whether nothing but the geoms' shapes and places says what touches."""
    special = model.nflex or model.npair or model.nplugin or model.opt.enableflags & _OVERRIDE
    margins = model.geom_margin.any() or model.geom_gap.any()
    return not (special or margins or np.isin(model.sensor_type, _SEEING).any())


def _is_harmless(field: str) -> bool:
    return field.startswith(_HARMLESS) or field in _HARMLESS_TOO


def _are_in_their_boxes(model: mujoco.MjModel) -> bool:
    """Whether all boxes of the bodies' trees hold the geoms that they are made for."""
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
    """The geoms of a tree, each with the nodes from the root to its own."""
    paths = [[0]]
    while paths:
        path = paths.pop()
        children = [c for c in model.bvh_child[first + path[-1]].tolist() if c >= 0]
        paths += [[*path, child] for child in children]
        if not children:
            yield int(model.bvh_nodeid[first + path[-1]]), path


def _half_sizes(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Half of a geom's extent along its axes, (3,)."""
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
        case _:  # of a mesh it is known from the box alone
            return model.geom_aabb[geom, 3:]


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    """The rotation matrix, (3, 3)."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


@functools.lru_cache(maxsize=64)
def _finds_touches(frames: tuple[tuple[float, ...], ...]) -> bool:
    """Whether the midphase rules out no sphere that touches a plane.

    Args:
      frames: position and quaternion of each plane of the world.
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
    """A world of planes, and a body of two spheres: one alone needs no tree."""
    spec = mujoco.MjSpec()
    for frame in frames:
        plane = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
        plane.pos, plane.quat = frame[:3], frame[3:]
    body = spec.worldbody.add_body()
    body.add_freejoint()
    for _ in range(2):
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0])
    return spec.compile()


def _touches(model: mujoco.MjModel, data: mujoco.MjData, disabled: int) -> list:
    """Which geoms touch, in MuJoCo's order."""
    model.opt.disableflags = disabled
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    return data.contact.geom.tolist()
