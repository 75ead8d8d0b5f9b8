"""`Spot`: the site at which an object is raked, and the direction in which it is pulled.

    spot = next_spot(data, None, goal=-0.12, walls=slot.walls(physics))
    poses = spot.poses(data, goal, walls)  # (n, 4), that have a fingertip there

A fingertip goes behind the site and pulls it inwards. A peg may lean on something, or lie behind
it, so that no fingertip gets behind its middle, or only presses it against the obstacle; then it is
pulled away from there, or pressed down, by one of its ends.
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, PLANE, TIP_ASIDE, TIP_REACH, TIPS
from limberjack.planner.arm.kinematics import hand_poses
from limberjack.planner.arm.proposals import Proposal
from limberjack.planner.manipulator.grips import downwards, height_above_ground
from limberjack.planner.manipulator.props import HAND
from limberjack.utils import arrays

__all__ = ["Spot", "next_spot"]

_FAR = 0.2  # metres; how far outwards a peg is raked that leans inwards
_POSES, _KEPT = 400, 64  # that are drawn, few of which are clear of the walls, and kept
# Metres; so far the fingers' middle lines may be in the walls and in the ground, which give way.
_IN_WALLS, _IN_GROUND = -0.004, -0.009
_LOW = 0.05  # metres; an end that is so near to the ground is not pressed down
_BEHIND = np.array([0.03, 0.0, 0.0]), np.array([0.0, 0.0, 0.02])  # metres; outwards, and up
_OVER = np.array([0.0, 0.0, 0.03])  # metres; offset of a fingertip that presses down
_LEANS = 0.05  # metres; a peg whose handle is so much above its tip leans on something
_UPHILL = 0.45  # metres from the middle; an end pulled to there pushes the peg up a wall


@dataclasses.dataclass(frozen=True)
class Spot:
    """A site of an object, and the kind of pull: 'there' to the goal, 'away' from it, or 'down'."""

    site: str
    kind: str

    def goal(self, data: Any, goal: float) -> float:
        """Position to rake to when the final goal is another: x, metres."""
        if self.kind != "away":
            return goal
        place = float(data.site_xpos[self.site][0])
        return place - _FAR * float(np.sign(goal - place))

    def cost(self, data: Any, goal: float) -> np.ndarray:
        """Cost of a fingertip's distance from its start, and of the site's from the goal, (N,)."""
        place = data.site_xpos[self.site]
        left = place[..., 2] if self.kind == "down" else np.abs(place[..., 0] - goal)
        return 4.0 * self.missing(data, goal) + 10.0 * left

    def missing(self, data: Any, goal: float) -> np.ndarray:
        """Distance of the nearer fingertip from its start, (N,), metres."""
        start = self._start(data, goal)
        return arrays.minimum_of([arrays.norm(data.geom_xpos[tip] - start) for tip in TIPS])

    def _start(self, data: Any, goal: float) -> np.ndarray:
        """Position at which a fingertip begins to rake, (..., 3), metres."""
        place = data.site_xpos[self.site]
        return place + _OVER if self.kind == "down" else _behind(place, goal)

    def proposals(self, random: np.random.Generator, data: Any, goal: float) -> list[Proposal]:
        """Proposals that put a fingertip behind the site, and then pull it inwards.

        Args:
          random: draws them.
          data: of a single simulation.
          goal: x, metres.
        """
        place, now = data.site_xpos[self.site], data.qpos[ARM]
        start = _behind(place, goal)[PLANE]
        # The root turns from x to -x over the top, and so the other way below.
        turn = 0.3 * np.sign(goal - place[0]) * np.array([1.0, 0.0, 0.0, 0.0])
        proposals: list[Proposal] = []
        for pose in hand_poses(random, start, TIP_REACH, now, 12, lateral=TIP_ASIDE):
            proposals.append(Proposal([pose], [OPEN_ANGLE], 2))
            proposals.append(Proposal([pose, pose + turn], [OPEN_ANGLE], 2))
        return proposals

    def poses(self, data: Any, goal: float, walls: Obstacle, higher: float = 0.0) -> np.ndarray:
        """Arm joints that have a fingertip where raking begins, (n, 4), if that helps.

        Args:
          data: of a single simulation.
          goal: x to which the peg is raked, metres.
          walls: obstacles for the hand.
          higher: distance of the fingertip above there, metres.
        """
        place = data.site_xpos[self.site]
        if self.kind == "down" and height_above_ground(place) < _LOW:
            return np.zeros((0, 4))
        tip = (self._start(data, goal) - higher * downwards(place))[PLANE]
        random, now = np.random.default_rng(0), data.qpos[ARM]
        found = [
            hand_poses(random, tip, TIP_REACH, now, _POSES, lateral=aside)
            for aside in (TIP_ASIDE, -TIP_ASIDE)
        ]
        poses = np.concatenate(found)
        if not len(poses):
            return poses
        clear = clearance(poses, HAND, walls)
        poses = poses[(clear[:, 0] > _IN_WALLS) & (clear[:, 3] > _IN_GROUND)]
        return poses[:: max(1, len(poses) // _KEPT)]


_BY_THE_HANDLE = Spot("peg_grasp", "there")
_SPOTS = [
    Spot("peg", "there"),
    Spot("peg_grasp", "away"),
    Spot("peg_grasp", "down"),
    Spot("peg_tip", "down"),
    Spot("peg_tip", "away"),
    _BY_THE_HANDLE,
    Spot("peg", "away"),
    Spot("peg_tip", "there"),
]


def next_spot(data: Any, spot: Spot | None, goal: float, walls: Obstacle) -> Spot:
    """The spot to try after another one, which a fingertip can reach.

    The first is a peg's middle, or the handle of one that leans with it upwards, so that it falls.
    """
    if spot is None:
        leans = data.site_xpos["peg_grasp"][2] - data.site_xpos["peg_tip"][2] > _LEANS
        return _BY_THE_HANDLE if leans else _SPOTS[0]
    first = 1 + _SPOTS.index(spot)
    order = [_SPOTS[(first + place) % len(_SPOTS)] for place in range(len(_SPOTS))]
    sensible = [s for s in order if s.kind != "away" or abs(s.goal(data, goal)) < _UPHILL]
    for candidate in sensible:
        if len(candidate.poses(data, candidate.goal(data, goal), walls)):
            return candidate
    return sensible[0]


def _behind(place: np.ndarray, goal: float) -> np.ndarray:
    """Position of a fingertip that rakes a place to a goal, (..., 3) -> (..., 3), metres."""
    outwards = np.where(place[..., :1] < goal, -1.0, 1.0)
    return place + outwards * _BEHIND[0] + _BEHIND[1]
