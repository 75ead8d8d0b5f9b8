"""`as_in_c`: contacts as MuJoCo's C engine has them, where MuJoCo Warp 4.0 finds others.

    model.callback.contactfilter = contacts.as_in_c     # a model of MuJoCo Warp

- The first tangent of a capsule on a plane points along the capsule. MuJoCo Warp chooses another
  one if the capsule is within 30 degrees of the plane's normal, as the thigh or shin of a leg may
  be. Friction depends on the tangents, since its cone is a pyramid.
- Geoms that only just touch in double precision, as the toes of quadruped fetch do when an episode
  begins, are not in contact. In single precision the rounding of their positions would decide.
"""

import mujoco

from limberjack.gpu.backend import mujoco_warp, warp

__all__ = ["as_in_c"]

_PLANE, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_NORMAL = 1e-6  # sine of an angle; a capsule that is closer to the normal has no direction
_ROUNDING = 5e-7  # metres; above what float32 rounds off positions some metres from the origin


def as_in_c(model: "mujoco_warp.Model", data: "mujoco_warp.Data") -> None:
    """Changes the contacts of all rows; normals stay."""
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
