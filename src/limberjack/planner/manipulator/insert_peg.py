"""`PegInsertion`: how the arm gets to the peg around the slot, and the peg into it.

insertion = PegInsertion(fetch, slot, knots=5)
path = insertion.path_to_object(data, attempt=0)

A peg is harder to reach than a ball. The slot may be in the way; the peg may lean on the slot, or
lie where no hand gets to its handle; then it is raked, from where a path leads to.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle
from limberjack.planner.arm.hand import ARM, PLANE
from limberjack.planner.arm.kinematics import direction, nudged
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.fetch import STRETCHED, Fetch
from limberjack.planner.manipulator.grips import BACK, pose_of
from limberjack.planner.manipulator.guide import FEW, GOALS
from limberjack.planner.manipulator.peg import BLADE, HAND, HELD
from limberjack.planner.manipulator.pushes import pushes
from limberjack.planner.manipulator.receptacles import Receptacle

__all__ = ["PegInsertion"]

_CLOSE = 0.01  # metres; distance from the peg of a path's end if there is no path to `BACK`
# Metres above the raked spot: a fingertip reaches it from there where the hand would be in a wall.
_HIGHER = 0.0, 0.03, 0.06


class PegInsertion:
    """Paths and proposals for the peg; the attributes are those of `BallInsertion`."""

    attempts, long, noise_scale = 8, 60, 0.1  # the slot is narrow
    # The lower ends are nearer to the arm, if the mouth is far away.
    over, held, close = (0.02, -0.01), (HELD, HAND), True

    def __init__(self, fetch: Fetch, slot: Receptacle, knots: int) -> None:
        """Takes the fetching of the peg, the slot, and the number of knots of a plan."""
        self._fetch, self._slot, self._knots = fetch, slot, knots

    def path_to_object(self, data: Any, attempt: int) -> Path | None:
        """The arm's path around the slot: to before the peg, to rake it, or to let it fall."""
        fetch, now = self._fetch, data.qpos[ARM]
        if fetch.rake.goal is not None:
            return self._path_to_rake(data, fetch.rake.goal)
        if fetch.lies_on_arm:
            room = fetch.draws.uniform(-STRETCHED, STRETCHED, (8, 4))
            return find_path(now, room, HAND, fetch.walls)
        if fetch.is_fast(data):
            return None
        # From where the hand gets on to the peg: there, too, the walls must leave it room.
        (poses,) = fetch.poses_around([pose_of(data, "peg")], now, fetch.draws, GOALS)
        if attempt:
            poses = poses[fetch.draws.permutation(len(poses))[:FEW]]
        path = None
        # The peg is an obstacle too: on its path the hand would push it away.
        for back, start in ((BACK, "peg_grasp"), (_CLOSE, "peg")):
            goals = nudged(poses, -back * direction(poses.sum(axis=-1)), 0.0)
            peg = data.site_xpos[[start, "peg_tip"]][None][..., PLANE]
            ends = np.concatenate([fetch.walls.ends, peg])
            around = Obstacle(ends, np.append(fetch.walls.radii, BLADE))
            path = path or find_path(now, goals, HAND, around, close=True)
        fetch.rake.misses = 0 if path is not None else fetch.rake.misses + 1
        return path

    def _path_to_rake(self, data: Any, goal: float) -> Path | None:
        """The arm's path to the spot where it rakes, or to above it."""
        spot, walls = self._fetch.rake.spot, self._fetch.walls
        if spot is None:
            return None
        for higher in _HIGHER:
            poses = spot.poses(data, goal, walls, higher)
            path = find_path(data.qpos[ARM], poses, HAND, walls, close=True)
            if path is not None:
                return path
        return None

    def proposals_in(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to push the peg in."""
        slot = self._slot
        return pushes(random, data, slot, data.qpos[ARM], self._knots, slot.grip.shut)
