"""`Spot`: where, and whereto, a peg is raked that leans on something or lies behind it.

    spot = next_spot(data, None, goal=-0.12, walls=slot.walls(physics))
    poses = spot.poses(data, goal, walls)  # (n, 4), that have a fingertip there

The middle of such a peg may be where no fingertip gets, or it is only pressed against what it leans
on; then it is pulled away from there, or pressed down, by one of its ends.
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.arm import ARM, PLANE, TIP_ASIDE, TIP_REACH, TIPS
from limberjack.planner.grips import height_above_ground
from limberjack.planner.planar_ik import GRASP, hand_poses
from limberjack.planner.raking import raking_cost
from limberjack.planner.roadmap import Obstacle, clearance
from limberjack.utils import arrays

__all__ = ["Spot", "Spots", "next_spot"]

_FAR = 0.2  # metres; how far outwards a peg is raked that leans inwards
_POSES, _KEPT = 400, 64  # that are looked at, few of which are clear of the walls, and kept
# Metres; so far the fingers' middle lines may be in the walls and in the ground, which give way.
_IN_WALLS, _IN_GROUND = -0.004, -0.009
_LOW = 0.05  # metres; what is so near to the ground is not pressed down
_OVER = np.array([0.0, 0.0, 0.03])  # metres; where a fingertip is that presses down
_STIRRED = 0.03  # metres; so much nearer a peg that is raked must come
_PULLED = 0.08  # metres; so far a peg is pulled away from what it leans on
_IN_VAIN = 24  # plannings; after so many a peg that has not come nearer is raked from elsewhere
_NEAR, _ON_THE_WAY = 0.14, 0.3  # metres; what counts a planning for which the hand is not so near


@dataclasses.dataclass(frozen=True)
class Spot:
    """A site of the peg, and whereto it is raked: 'there' where it is wanted, 'away' or 'down'."""

    site: str
    way: str

    def goal(self, data: Any, goal: float) -> float:
        """Where to rake what is wanted at a goal in the end: x, metres."""
        if self.way != "away":
            return goal
        place = float(data.site_xpos[self.site][0])
        return place - _FAR * float(np.sign(goal - place))

    def cost(self, data: Any, goal: float) -> np.ndarray:
        """How far a fingertip is from where it rakes, and the site from where it is to be, (N,)."""
        if self.way != "down":
            return raking_cost(data, self.site, goal)
        place = data.site_xpos[self.site]
        tips = [arrays.norm(data.geom_xpos[tip] - place - _OVER) for tip in TIPS]
        return 4.0 * arrays.minimum_of(tips) + 10.0 * place[..., 2]

    def poses(self, data: Any, goal: float, walls: Obstacle) -> np.ndarray:
        """Arm joints that have a fingertip where raking to a goal begins, (n, 4), if that helps."""
        place = data.site_xpos[self.site]
        if self.way == "down" and height_above_ground(place) < _LOW:
            return np.zeros((0, 4))
        offset = np.array([-0.03 if place[0] < goal else 0.03, 0.0, 0.02])
        tip = (place + (_OVER if self.way == "down" else offset))[PLANE]
        random, now = np.random.default_rng(0), data.qpos[ARM]
        found = [
            hand_poses(random, tip, TIP_REACH, now, _POSES, lateral=aside)
            for aside in (TIP_ASIDE, -TIP_ASIDE)
        ]
        poses = np.concatenate(found)
        if not len(poses):
            return poses
        clear = clearance(poses, GRASP + 0.02, walls)
        poses = poses[(clear[:, 0] > _IN_WALLS) & (clear[:, 3] > _IN_GROUND)]
        return poses[:: max(1, len(poses) // _KEPT)]


_SPOTS = [
    Spot("peg", "there"),
    Spot("peg_grasp", "away"),
    Spot("peg_grasp", "down"),
    Spot("peg_tip", "down"),
    Spot("peg_tip", "away"),
    Spot("peg_grasp", "there"),
    Spot("peg", "away"),
    Spot("peg_tip", "there"),
]


def next_spot(data: Any, spot: Spot | None, goal: float, walls: Obstacle) -> Spot:
    """The spot to try after another one, which a fingertip can reach; the peg's middle first."""
    if spot is None:
        return _SPOTS[0]
    first = 1 + _SPOTS.index(spot)
    order = [_SPOTS[(first + place) % len(_SPOTS)] for place in range(len(_SPOTS))]
    for candidate in order:
        if len(candidate.poses(data, candidate.goal(data, goal), walls)):
            return candidate
    return order[0]


class Spots:
    """Which spot of a peg is raked: another one once that has been in vain.

    Attributes:
      now: that spot; None while none is raked.
    """

    def __init__(self) -> None:
        """Rakes nothing yet."""
        self.forget()

    def forget(self) -> None:
        """Begins anew, as for a peg that is not raked."""
        self.now: Spot | None = None
        self._pulled_from = np.zeros(3)  # where the peg was when that spot was chosen
        self._nearest = np.inf  # metres; how near it has come to where it is wanted
        self._in_vain = 0.0  # plannings without any headway

    def choose(
        self, data: Any, goal: float, walls: Obstacle, is_led: bool, moves: bool
    ) -> Spot | None:
        """The spot to rake now, or None while that must be seen.

        Args:
          data: of a single simulation.
          goal: where the peg is wanted in the end: x, metres.
          walls: of what a fingertip is not to get into.
          is_led: whether the arm is still on a way to where it rakes.
          moves: whether the peg does not lie still yet.
        """
        place = data.site_xpos["peg"]
        is_pulled = arrays.norm(place - self._pulled_from) > _PULLED
        if self.now is not None and self.now.way != "there" and is_pulled:
            self.forget()
        off = abs(float(place[0]) - goal)
        if off < self._nearest - _STIRRED:
            self._nearest, self._in_vain = off, 0.0
        if not is_led:
            is_there = arrays.norm(data.site_xpos["grasp"] - place) < _NEAR
            self._in_vain += 1.0 if is_there else _ON_THE_WAY
        if (self.now is None and not moves) or self._in_vain > _IN_VAIN:
            self._in_vain, self._pulled_from = 0.0, place.copy()
            self.now = next_spot(data, self.now, goal, walls)
        return self.now
