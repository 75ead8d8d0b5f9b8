"""`align`: the contact frames that MuJoCo's C engine gives capsules on planes.

    model.callback.contactfilter = contact_frames.align     # a model of MuJoCo Warp

Friction depends on the directions of a contact's tangents, since its cone is a pyramid. The C
engine points the first tangent along the capsule. MuJoCo Warp 4.0 does so too, but not if the
capsule is within 30 degrees of the plane's normal, as the thigh or shin of a leg may be: there the
velocity of a slide would differ by a percent after one time step.
"""

import mujoco

from limberjack.gpu.backend import mujoco_warp, warp

__all__ = ["align"]

_PLANE, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_NORMAL = 1e-6  # sine of an angle; a capsule that is closer to the normal has no direction


def align(model: "mujoco_warp.Model", data: "mujoco_warp.Data") -> None:
    """Turns the frames of all contacts of capsules with planes; normals stay."""
    contact = data.contact
    warp.launch(
        _align,
        dim=contact.frame.shape[0],
        inputs=[model.geom_type, data.geom_xmat, data.nacon, contact.geom, contact.worldid],
        outputs=[contact.frame],
    )


@warp.kernel
def _align(
    geom_type: warp.array[int],
    geom_xmat: warp.array2d[warp.mat33],
    count: warp.array[int],
    geoms: warp.array[warp.vec2i],
    rows: warp.array[int],
    frames: warp.array[warp.mat33],
):
    contact = warp.tid()
    if contact >= count[0]:
        return
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
