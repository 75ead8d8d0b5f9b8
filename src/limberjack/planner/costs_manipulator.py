"""What the planner avoids in the manipulator's tasks: an object far from the hand or the target.

The object is fetched first: the open hand comes from ahead of it, then closes. Once it is held,
being far from the target costs. How well it is held is a number between 0 and 1, so that fetching
and carrying blend within one plan. What is to be inserted must first come to the mouth of its
receptacle; there it need no longer be held.

The peg can be held by its handle or, to bring it, by its tip: `look` chooses what the arm can
reach at the target.
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.arm import (
    ARM,
    CLOSED,
    OPEN,
    OPEN_ANGLE,
    PLANE,
    SETTINGS,
    closing,
    in_hand,
    lifts,
    loose,
    near,
    outward_speed,
    path,
)
from limberjack.planner.cost import Cost
from limberjack.planner.planar_ik import GRASP, angle_of, hand_poses
from limberjack.utils import arrays

__all__ = ["Bring"]

_LOOSE = 6.0  # what an object costs that is not held: more than any that is
_LONGEST = 0.25  # metres; what scales distances: about half of the arm's reach
_PLAY = 1.3  # how much better than needed the best hold is: a little slip costs nothing
_BACK = 0.06  # metres; how far the hand stands off before it closes in


@dataclasses.dataclass(frozen=True)
class _Grip:
    """A way to hold an object.

    Attributes:
      place, ahead: sites of the object between which the hand points; the first is to be where the
        grasp is. The ball may be held from any side, so it has no second one.
      angle: of the fingers around it, radians, measured.
      press: the control that holds it. The full one squeezes a peg out of the fingers.
    """

    place: str
    ahead: str | None
    angle: float
    press: float


_TIPS = ["fingertip2", "thumbtip2"]  # geoms
_AT_REST = 0.02  # metres or radians per second
_RAKED = 0.12  # metres; how far beyond the middle a peg is raked
_TIP_REACH, _TIP_ASIDE = 0.098, 0.04  # metres; where an open fingertip is in the hand

_BALL = _Grip("ball", None, np.radians(20.0), 0.6)
_HANDLE = _Grip("peg_grasp", "peg_tip", np.radians(32.0), 0.25)
_TIP = _Grip("peg_tip", "peg_grasp", np.radians(36.0), 0.25)


@dataclasses.dataclass(frozen=True)
class _Mouth:
    """The way into a receptacle, along its axis.

    Attributes:
      entering: the site of the object that goes in first, and its place at the target.
      height: above that place, metres, from which it may go in.
      width: how far beside the axis it may be then.
    """

    entering: str
    place: str
    height: float
    width: float


# The cup's rim, and the fingers, which reach beyond the ball.
_CUP = _Mouth("ball", "target_ball", 0.115, 0.012)
_SLOT = _Mouth("peg_tip", "target_peg_tip", 0.072, 0.006)


class Bring(Cost):
    """Fetches the object, and brings it to the target or inserts it."""

    settings = SETTINGS

    def __init__(self, task: Any) -> None:
        """Takes a `manipulator.Bring` task."""
        super().__init__(task)
        self._has_peg: bool = task._use_peg
        self._object = "peg" if self._has_peg else "ball"
        self._mouth: _Mouth | None = None
        if task._insert:
            self._mouth = _SLOT if self._has_peg else _CUP
        self.reset()

    def reset(self) -> None:
        """Chooses the usual grip."""
        self._grip = _HANDLE if self._has_peg else _BALL
        self._rake_to: float | None = None  # x, metres, while the object is out of reach

    def step_cost(self, physics: Any) -> np.ndarray:
        """Fetching costs more than carrying, and both less the nearer, (N,)."""
        data = physics.named.data
        low = 5.0 * np.maximum(0.03 - data.site_xpos["grasp", "z"], 0.0)
        if self._rake_to is not None:
            return 2.0 * _LOOSE + self._raking(data, self._rake_to) + low
        held = self._held(data)
        missing = 1.0 - self.task.get_reward(physics)
        carry = self._gap(data) + missing + loose(physics, self._grip.press)
        secure = held
        if self._mouth is not None:
            secure = np.maximum(held, self._inside(data))
            carry = carry + held * self._fingers_in_mouth(data)
        fetch = _LOOSE + self._fetching(data)
        return secure * carry + (1.0 - secure) * fetch + low

    def _raking(self, data: Any, goal: float) -> np.ndarray:
        """How far a fingertip is from behind the object, and the object from the goal, (N,)."""
        middle = data.site_xpos[self._object]
        behind = _behind(middle, goal)
        tips = [arrays.norm(data.geom_xpos[tip] - behind) for tip in _TIPS]
        return 4.0 * arrays.minimum_of(tips) + 10.0 * np.abs(middle[..., 0] - goal)

    def _held(self, data: Any) -> np.ndarray:
        """How well the hand holds the object, 0 to 1, (N,)."""
        ahead, aside = in_hand(data, data.site_xpos[self._grip.place])
        closed = np.clip(closing(data) / (self._grip.angle - OPEN_ANGLE), 0.0, 1.0)
        firm = near(np.hypot(ahead, aside), 0.012) * near(self._misalignment(data), 0.15) * closed
        # A little play in the hand is no reason to stand still.
        return np.minimum(_PLAY * firm, 1.0)

    def _misalignment(self, data: Any) -> Any:
        """One less the cosine between the hand and the grip's direction, (...)."""
        if self._grip.ahead is None:
            return 0.0 * data.site_xpos[self._grip.place][..., 0]
        forward = data.site_xpos[self._grip.ahead] - data.site_xpos[self._grip.place]
        forward = forward / arrays.norm(forward)[..., None]
        frame = data.site_xmat["grasp"]
        return 1.0 - forward[..., 0] * frame[..., 2] - forward[..., 2] * frame[..., 8]

    def _fetching(self, data: Any) -> np.ndarray:
        """How far the hand is from holding the object, (N,)."""
        ahead, aside = in_hand(data, data.site_xpos[self._grip.place])
        distance = np.hypot(ahead, aside)
        turn = self._misalignment(data)
        # With the object beside it the hand must first back off: the fingers are in the way.
        beside = np.abs(aside) - 0.012 + 0.05 * turn
        detour = np.maximum(np.clip(1.5 * beside, 0.0, 0.07) - ahead, 0.0)
        is_far = np.clip((distance - 0.02) / 0.03, 0.0, 1.0)
        shut = np.clip(closing(data) / (self._grip.angle - OPEN_ANGLE) - 0.4, 0.0, 2.0)
        outwards = outward_speed(data, self.task._object_joints[0], self._object)
        return 4.0 * (distance + detour) + 0.5 * turn + 0.5 * is_far * shut + outwards

    def _gap(self, data: Any) -> np.ndarray:
        """How far the object is from its place, by the way that it can go, (N,), about 0 to 2."""
        places = data.site_xpos
        if self._has_peg:
            gaps = [arrays.norm(places[s] - places[f"target_{s}"]) for s in ("peg", "peg_tip")]
            gap = (gaps[0] + gaps[1]) / 2
        else:
            gap = arrays.norm(places["ball"] - places["target_ball"])
        if self._mouth is not None:
            up, beside = self._in_mouth(data)
            outside = np.clip((beside - self._mouth.width / 2) / self._mouth.width, 0.0, 1.0)
            gap = gap + np.maximum(outside * self._mouth.height - up, 0.0)
        return gap / _LONGEST

    def _fingers_in_mouth(self, data: Any) -> np.ndarray:
        """How far a hand that holds the ball is too low to open between the cup's walls, (N,)."""
        assert self._mouth is not None
        if self._has_peg:
            return 0.0 * data.site_xpos["peg"][..., 0]
        up, _ = self._in_mouth(data)
        return 2.0 * np.maximum(self._mouth.height - up, 0.0) / _LONGEST

    def _in_mouth(self, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """How far the object is above its place along the axis, and how far beside it, (N,)."""
        assert self._mouth is not None
        offset = data.site_xpos[self._mouth.entering] - data.site_xpos[self._mouth.place]
        frame = data.site_xmat[self._mouth.place]
        up = offset[..., 0] * frame[..., 2] + offset[..., 2] * frame[..., 8]
        beside = offset[..., 0] * frame[..., 0] + offset[..., 2] * frame[..., 6]
        return up, np.abs(beside)

    def _inside(self, data: Any) -> np.ndarray:
        """How surely the object stays where it is to be without the hand, 0 to 1, (N,)."""
        assert self._mouth is not None
        if self._has_peg:
            return 0.0 * data.site_xpos["peg"][..., 0]
        up, beside = self._in_mouth(data)
        above = np.where(up > 0, up, 6.0 * up)  # below it is outside again
        surely = near(beside, 1.5 * self._mouth.width) * near(above, 1.4 * self._mouth.height)
        return np.minimum(_PLAY * surely, 1.0)

    def look(self, physics: Any) -> None:
        """Chooses the grip that is possible here and at the target; without one, rakes."""
        data = physics.named.data
        if self._held(data) > 0.3:
            self._rake_to = None
            return
        random = np.random.default_rng(0)  # its own: a look must not shift the samples' stream
        grips = [_HANDLE, _TIP] if self._has_peg and self._mouth is None else [self._grip]
        usable = [g for g in grips if len(self._poses(data, random, g, "target_", 1))] or grips
        ready = [grip for grip in usable if len(self._poses(data, random, grip, "", 2))]
        self._grip = (ready or usable)[0]
        speed = np.abs(data.qvel[self.task._object_joints]).max()
        if ready:
            self._rake_to = None
        elif self._rake_to is not None or speed < _AT_REST:  # what rolls may come by itself
            self._rake_to = self._rake_goal(data)

    def _rake_goal(self, data: Any) -> float:
        """Where the object would be in reach: x, metres."""
        if self._grip.ahead is None:
            return 0.0
        # The hand comes from the handle's side, so it needs more room there.
        ahead = data.site_xpos[self._grip.ahead, "x"] - data.site_xpos[self._grip.place, "x"]
        return _RAKED if ahead > 0 else -_RAKED

    def _poses(
        self,
        data: Any,
        random: np.random.Generator,
        grip: _Grip,
        prefix: str,
        count: int,
        back: float = 0.0,
    ) -> np.ndarray:
        """Arm joints that have the hand at a grip, (n, 4).

        Args:
          data: of a single simulation.
          random: draws the redundancy.
          grip: where.
          prefix: 'target_' for the object at the target.
          count: how many at most.
          back: how far the hand is to stand off.
        """
        place = data.site_xpos[prefix + grip.place][PLANE]
        now = data.qpos[ARM]
        if grip.ahead is None:
            if self._mouth is None or not prefix:
                return hand_poses(random, place, GRASP + back, now, count)
            axis = data.site_xmat[self._mouth.place][[2, 8]]
            above = place + self._mouth.height * axis
            return hand_poses(random, above, GRASP, now, count, angle_of(-axis), 0.6)
        angle = angle_of(data.site_xpos[prefix + grip.ahead][PLANE] - place)
        if self._mouth is not None and prefix:
            axis = data.site_xmat[self._mouth.place][[2, 8]]
            place = place + back * axis
            back = 0.0
        # Exactly at the target, roughly at an object that the hand will straighten.
        tilt = 0.02 if prefix else 0.3
        return hand_poses(random, place, GRASP + back, now, count, angle, tilt)

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Straight joint paths that fetch the object or carry it to the target."""
        data = physics.named.data
        now = data.qpos[ARM]
        count = self.settings.knots
        press = self._grip.press
        paths: list[np.ndarray] = []
        if self._rake_to is not None:
            middle = data.site_xpos[self._object]
            behind = _behind(middle, self._rake_to)[PLANE]
            for pose in hand_poses(random, behind, _TIP_REACH, now, 12, lateral=_TIP_ASIDE):
                # The root turns from x to -x over the top, and so the other way below.
                turn = 0.3 * np.sign(self._rake_to - middle[0])
                inwards = pose + turn * np.array([1.0, 0.0, 0.0, 0.0])
                paths.append(path(now, [pose], count, [OPEN], 2))
                paths.append(path(now, [pose, inwards], count, [OPEN], 2))
        elif self._held(data) > 0.3:
            heights = [0.0] if self._mouth is None else [0.0, self._mouth.height]
            for back in heights:
                for pose in self._poses(data, random, self._grip, "target_", 6, back):
                    paths.extend(path(now, [pose], count, [press], slow) for slow in (1, 2, 4))
            place, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
            paths.extend(lifts(random, place, angle, now, count, press))
            paths.append(path(now, [now], count, [press]))
        else:
            paths.append(path(now, [now], count, [CLOSED]))
            for pose in self._poses(data, random, self._grip, "", 6):
                paths.append(path(now, [pose], count, [CLOSED]))
                paths.append(path(now, [pose], count, [OPEN, OPEN, OPEN, CLOSED, CLOSED], 2))
                paths.append(path(now, [pose], count, [OPEN, OPEN, OPEN, OPEN, CLOSED], 4))
            for pose in self._poses(data, random, self._grip, "", 8, _BACK):
                paths.append(path(now, [pose], count, [OPEN], 2))
        paths.append(path(now, [now], count, [OPEN]))
        order = random.permutation(len(paths))
        return np.array(paths)[order]


def _behind(place: np.ndarray, goal: float) -> np.ndarray:
    """Where a fingertip rakes an object from, towards a goal, (..., 3) -> (..., 3), metres."""
    outwards = np.where(place[..., :1] < goal, -1.0, 1.0)
    return place + outwards * np.array([0.03, 0.0, 0.0]) + np.array([0.0, 0.0, 0.02])
