"""The arm's lengths, radii and limits, read once from the suite's own model.

    GEOMETRY.lengths      # of upper, middle and lower arm, metres
    GEOMETRY.grasp        # from the wrist to the site between the fingers, metres

All figures of kinematics and collisions come from here; margins are chosen where they are used.
Reading compiles the model once, when the first cost of an arm's task is made.
"""

import dataclasses

import mujoco

from limberjack import suite

__all__ = ["GEOMETRY", "ArmGeometry"]


@dataclasses.dataclass(frozen=True)
class ArmGeometry:
    """Figures of the arm, its pit and the peg; metres and radians."""

    base_height: float  # of the root's axis above the floor
    lengths: tuple[float, float, float]  # of the three links
    radii: tuple[float, ...]  # of three links, the hand, two palms and, last, the peg's blade
    limits: tuple[float, ...]  # of shoulder, elbow and wrist, the same to both sides
    floor: float  # half its width; at its edges the walls rise at 45 degrees
    hand: float  # length of the hand's own link
    knuckle: tuple[float, float]  # a finger's joint: from the hand's middle line, and the wrist
    finger: tuple[float, float]  # from that joint to the tip, ahead and aside, at an angle of 0
    open_angle: float  # of the fingers, at their limit
    grasp: float  # from the wrist to the sites between the fingers
    pinch: float
    peg: float  # from the peg's handle to its tip
    peg_grasp: float  # from the peg's middle back to the sites where it is held
    peg_pinch: float

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "ArmGeometry":
        """The figures in a raw `mujoco.MjModel` with the arm and a peg."""
        body, joint, site, geom = model.body, model.joint, model.site, model.geom
        chain = ("middle_arm", "lower_arm", "hand")
        upper, middle, lower = (float(body(name).pos[2]) for name in chain)
        thick = ("upper_arm", *chain, "palm1", "palm2", "blade")
        thumb, tip = body("thumb").pos, body("thumbtip").pos + geom("thumbtip2").pos
        handle, peg_middle = float(site("peg_grasp").pos[2]), float(site("peg").pos[2])
        return cls(
            base_height=float(body("upper_arm").pos[2]),
            lengths=(upper, middle, lower),
            radii=tuple(float(geom(name).size[0]) for name in thick),
            limits=tuple(float(joint(f"arm_{j}").range[1]) for j in ("shoulder", "elbow", "wrist")),
            floor=float(geom("floor").size[0]),
            hand=2.0 * float(geom("hand").size[1]),
            knuckle=(float(thumb[0]), float(thumb[2])),
            # To a nanometre: a sum of two figures of the model may differ in the last bit.
            finger=(round(float(tip[0]), 9), round(-float(tip[2]), 9)),
            open_angle=float(joint("thumb").range[0]),
            grasp=float(site("grasp").pos[2]),
            pinch=float(body("pinch site").pos[2]),
            peg=handle - float(site("peg_tip").pos[2]),
            peg_grasp=handle - peg_middle,
            peg_pinch=float(site("peg_pinch").pos[2]) - peg_middle,
        )


GEOMETRY = ArmGeometry.of(suite.load("manipulator", "bring_peg", {"random": 0}).physics.model.ptr)
