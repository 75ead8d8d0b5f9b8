"""`PegInsertion`: how the arm gets to the peg around the slot, and the peg into it.

insertion = PegInsertion(fetch, slot, knots=5)
path = insertion.path_to_object(data, attempt=0)

A peg is harder to reach than a ball. The slot may be in the way; the peg may lean on the slot, or
lie where no hand gets to its handle; then it is raked, from where a path leads to. The peg is
pushed into the slot by small straight steps.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle
from limberjack.planner.arm.hand import ARM, PLANE
from limberjack.planner.arm.kinematics import GRASP, direction, nudged
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.fetch import STRETCHED, Fetch
from limberjack.planner.manipulator.grips import BACK, pose_of
from limberjack.planner.manipulator.guide import GOALS, few_of
from limberjack.planner.manipulator.props import BLADE, HAND, Peg
from limberjack.planner.manipulator.receptacles import Receptacle

__all__ = ["PegInsertion"]

_STEPS = (0.02, 0.04, 0.08) * 4  # metres; from one pose to the next along the axis, in proposals


class PegInsertion:
    """Paths and proposals for the peg; the attributes are those of `BallInsertion`."""

    attempts, long, noise_scale = 8, 60, 0.1  # the slot is narrow
    # The lower ends are nearer to the arm, if the mouth is far away.
    over, held, close = (0.02, -0.01), (Peg.held, HAND), True

    def __init__(self, fetch: Fetch, slot: Receptacle, knots: int) -> None:
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
            poses = few_of(fetch.draws, poses)
        path = None
        # The peg is an obstacle too: on its path the hand would push it away. If no path leads to
        # well before the peg, one may end 1 cm before it.
        for back, start in ((BACK, "peg_grasp"), (0.01, "peg")):
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
        # From above the spot a fingertip reaches it where the hand would be in a wall.
        for higher in (0.0, 0.03, 0.06):
            poses = spot.poses(data, goal, walls, higher)
            path = find_path(data.qpos[ARM], poses, HAND, walls, close=True)
            if path is not None:
                return path
        return None

    def proposals_in(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals that bring the peg over the slot, then along the axis into it."""
        slot, now, press = self._slot, data.qpos[ARM], self._slot.grip.shut
        offsets = ((float(u), float(b)) for u, b in slot.offsets(data))
        (up, beside), (middle_up, middle_beside) = offsets
        lean = np.arctan2(middle_beside - beside, middle_up - up + 0.05)  # upright 5 cm further on
        to_world = slot.axes(data)
        to_wrist = data.site_xpos["grasp"][PLANE] - GRASP * direction(now.sum())
        to_wrist = to_wrist - data.site_xpos["peg_tip"][PLANE]
        aside = max(abs(beside), abs(middle_beside))
        top = min(up, slot.before)
        before = [slot.before] if aside > 0.75 * slot.width and up > 0.06 else []
        moves: list[np.ndarray] = []
        turns: list[float] = []
        # Metres and radians by which the proposals differ: the slot is narrow.
        draws = random.normal(0.0, [0.0015, 0.01], (len(_STEPS), 2))
        for step, (off, turn) in zip(_STEPS, draws, strict=True):
            turned = _turned(to_wrist, turn + lean)
            heights = [*before, *np.arange(top - step, -step, -step).tolist()][: self._knots - 1]
            places = np.reshape([[height - up, off - beside] for height in heights], (-1, 2))
            moves.append(places @ to_world + turned - to_wrist)
            turns.extend([turn + lean] * len(heights))
        waypoints = nudged(now, np.concatenate(moves), np.array(turns))
        proposals: list[Proposal] = []
        for passed in np.split(waypoints, np.cumsum([len(some) for some in moves])[:-1]):
            proposals.append(Proposal(passed, [press]))
            proposals.append(Proposal(passed[:1], [press], 2))
        return proposals


def _turned(vector: np.ndarray, angle: float) -> np.ndarray:
    """A vector (2,) turned by an angle."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])
