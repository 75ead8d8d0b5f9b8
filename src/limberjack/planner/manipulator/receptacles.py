"""`Receptacle`: the manipulator's cup and slot, and how far an object is from being inside.

    slot = Receptacle.for_object("peg")
    up, beside = slot.offset(data, "peg_tip")  # (N,) each, metres

Places are measured in the frame of the target, which the receptacle surrounds: how far up along
the axis, how far beside it. The mouth is at the upper end. Quantities are those of a batch, (N,),
or of one simulation.
"""

import dataclasses

import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.collision import Obstacle
from limberjack.planner.arm.hand import ARM, PLANE, PLAY, in_frame, in_hand, near
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_poses
from limberjack.planner.manipulator.props import HAND, Ball, Peg, grasp_place, in_world

__all__ = ["Receptacle"]


@dataclasses.dataclass(frozen=True)
class Receptacle:
    """A receptacle that an object enters along an axis; lengths in metres."""

    body: str  # its name
    target: str  # the site of the target inside it
    # Of the object, to be at those of the target: the first goes in first, the last is its middle.
    sites: tuple[str, ...]
    prop: type[Ball] | type[Peg]  # the object
    before: float  # how far up the first site is before it goes in
    over: tuple[float, ...]  # above that, where a path may end; lower ones may be nearer to the arm
    held: tuple[float, ...]  # distances from the wrist to be kept clear of the walls on the path
    width: float  # how far beside the axis it may be then
    side: float  # how far beside the axis object and hand are clear of the walls
    falls: tuple[float, float]  # how far up and beside the object falls into its place by itself
    is_narrow: bool  # whether a path may end close to the walls
    patience: int  # plannings before the mouth after which insertion is tried from elsewhere
    noise_scale: float  # of plans before the mouth

    @classmethod
    def for_object(cls, name: str) -> "Receptacle":
        """The one for 'ball' or 'peg'."""
        return {"ball": _CUP, "peg": _SLOT}[name]

    def axes(self, data: NamedFields) -> np.ndarray:
        """The directions up and beside in the plane, (2, 2), of a single simulation."""
        frame = data.site_xmat[self.target]
        return np.stack([frame[[2, 8]], frame[[0, 6]]])

    def offset(self, data: NamedFields, site: str) -> tuple[np.ndarray, np.ndarray]:
        """Distances of a site above its place along the axis, and beside it, (N,) each."""
        away = data.site_xpos[site] - data.site_xpos[f"target_{site}"]
        return in_frame(away, data.site_xmat[self.target])

    def offsets(self, data: NamedFields) -> list[tuple[np.ndarray, np.ndarray]]:
        """The same for each of the object's sites."""
        return [self.offset(data, site) for site in self.sites]

    def facing(self, data: NamedFields) -> np.ndarray:
        """The cosine between the hand and the path in, (N,)."""
        frame, hand = data.site_xmat[self.target], data.site_xmat["grasp"]
        return -frame[..., 2] * hand[..., 2] - frame[..., 8] * hand[..., 8]

    def distance(self, offsets: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Distance that remains, around the walls and in along the axis, (N,), metres."""
        up, beside = offsets[0]
        aside = np.max([np.abs(b) for _, b in offsets], axis=0)
        on_axis = np.clip(2.0 - aside / self.width, 0.0, 1.0) * (up > -self.width)
        before = sum(np.hypot(u - self.before, b) for u, b in offsets) / len(offsets)
        below = np.clip((self.before - up) / 0.04 - 0.2, 0.0, 1.0)  # around the walls from there
        around = below * np.maximum(self.side - np.abs(beside), 0.0)
        outside = self.before + before + 1.5 * around
        return on_axis * (np.abs(up) + aside) + (1.0 - on_axis) * outside

    def from_mouth(self, data: NamedFields) -> float:
        """Distance of the object of a single simulation from before the mouth, metres."""
        offsets = self.offsets(data)
        away = max(float(np.hypot(max(u - self.before, 0.0), b)) for u, b in offsets)
        up, beside = offsets[0]
        entering = up > 0 and abs(beside) < self.width
        return away if entering else away + max(self.before - 0.02 - float(up), 0.0)

    def holds(self, offset: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Certainty that an object falls or stays in place by itself, 0 to 1, (N,).

        The offset is that of the first of its sites.
        """
        up, beside = offset
        above = np.where(up > 0, up, 6.0 * up)  # below it is outside again
        height, width = self.falls
        return np.minimum(PLAY * near(above, height) * near(beside, width), 1.0)

    def poses(
        self, data: NamedFields, random: np.random.Generator, up: float, beside: float, count: int
    ) -> np.ndarray:
        """Arm joints that have the held object at a place up and beside, (n, 4), n <= count."""
        now, prop, middle = data.qpos[ARM], self.prop, self.sites[-1]
        axis, across = self.axes(data)
        goal = grasp_place(data, self.target, prop)
        point = goal[PLANE] + up * axis + beside * across
        ahead, aside = in_hand(data, grasp_place(data, middle, prop))
        angle, tilt = angle_of(-axis), 0.6
        if prop.forward is not None:
            held = angle_of(in_world(data.site_xmat[middle], prop.forward)[PLANE])
            angle, tilt = angle + float(now.sum()) - held, 0.01
        return hand_poses(random, point, GRASP + ahead, now, count, angle, tilt, aside)

    def walls(self, physics: Physics) -> Obstacle:
        """Its capsules and boxes as thick lines."""
        model, data = physics.model, physics.data
        ends, radii = [], []
        for geom in np.flatnonzero(model.geom_bodyid == model.name2id(self.body, "body")):
            size = model.geom_size[geom]
            frame = data.geom_xmat[geom].reshape(3, 3)
            is_capsule = size[2] == 0.0
            sizes = (size[0], size[0] + size[1]) if is_capsule else (size[0], size[2])
            axis = frame[:, 0] if sizes[0] > sizes[1] else frame[:, 2]
            half = abs(sizes[0] - sizes[1]) * axis[PLANE]
            middle = data.geom_xpos[geom][PLANE]
            ends.append([middle - half, middle + half])
            radii.append(min(sizes))
        return Obstacle(np.array(ends), np.array(radii))


# The fingers reach beyond the ball, so that it is released above the cup's rim.
_CUP = Receptacle(
    body="cup",
    target="target_ball",
    sites=("ball",),
    prop=Ball,
    before=0.112,
    over=(0.02,),
    held=(Ball.held,),
    width=0.012,
    side=0.09,
    falls=(0.16, 0.018),
    is_narrow=False,
    patience=20,
    noise_scale=1.0,
)
# The slot is 0.8 mm wider than the peg, whose tip is round.
_SLOT = Receptacle(
    body="slot",
    target="target_peg",
    sites=("peg_tip", "peg"),
    prop=Peg,
    before=0.08,
    over=(0.02, -0.01),
    held=(Peg.held, HAND),
    width=0.004,
    side=0.08,
    falls=(0.02, 0.02),
    is_narrow=True,
    patience=60,
    noise_scale=0.1,
)
