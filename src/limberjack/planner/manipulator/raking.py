"""`Rake`: raking of an object that is out of reach, inwards with a fingertip.

    rake = Rake(peg)
    rake.judge(data, is_within=False)  # several plannings in a row
    if rake.goal is not None:  # x, metres
        cost = rake.at().cost(batch_data, rake.goal)  # (N,)

A fingertip goes behind a site of the object and pulls it inwards. A peg may lean on something, or
lie behind it, so that no fingertip gets behind its middle, or only presses it against the obstacle;
then it is pulled away from there, or pressed down, by one of its ends.
"""

import dataclasses

import numpy as np

from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, PLANE, TIP_ASIDE, TIP_REACH, TIPS
from limberjack.planner.arm.kinematics import hand_poses
from limberjack.planner.arm.proposals import Proposal
from limberjack.planner.arm.watchdog import Watchdog
from limberjack.planner.manipulator.props import HAND, Ball, Peg, downwards, height_above_ground
from limberjack.utils import arrays

__all__ = ["Rake", "Spot", "next_spot"]

# Metres by which a peg must come nearer to the goal, or a fingertip to the spot, to count.
_HEADWAY = 0.03
_OUTWARDS = 0.2  # metres by which an end is pulled away from the goal
_FURTHEST = 0.45  # metres from the middle: an end that is pulled further goes up a wall
_MOVED = 0.03  # metres; a peg that has moved so far may be reached where it was not before
_FREED = 0.08  # metres; a peg that has been pulled so far is away from its obstacle
_LOW = 0.05  # metres above the ground, below which an end is not pressed down
_LEANS = 0.05  # metres by which the handle of a peg that leans is above its tip
_BEHIND, _ABOVE = 0.03, 0.02  # metres from a site to a fingertip that begins to pull it
_LED = 0.1  # of a planning without headway counts, for an arm that a path leads to the spot
_PATIENCE = 16  # plannings without headway, after which a peg is raked from another spot


@dataclasses.dataclass(frozen=True)
class Spot:
    """A site of an object, and the kind of pull: 'there' to the goal, 'away' from it, or 'down'."""

    site: str
    kind: str

    def goal(self, data: NamedFields, goal: float) -> float:
        """Position to rake to when the final goal is another: x, metres; 'away' 0.2 outwards."""
        if self.kind != "away":
            return goal
        place = float(data.site_xpos[self.site][0])
        return place - _OUTWARDS * float(np.sign(goal - place))

    def cost(self, data: NamedFields, goal: float) -> np.ndarray:
        """Cost of a fingertip's distance from its start, and of the site's from the goal, (N,)."""
        place = data.site_xpos[self.site]
        left = place[..., 2] if self.kind == "down" else np.abs(place[..., 0] - goal)
        return 4.0 * self.missing(data, goal) + 10.0 * left

    def missing(self, data: NamedFields, goal: float) -> np.ndarray:
        """Distance of the nearer fingertip from its start, (N,), metres."""
        start = self._start(data, goal)
        return arrays.minimum_of([arrays.norm(data.geom_xpos[tip] - start) for tip in TIPS])

    def _start(self, data: NamedFields, goal: float) -> np.ndarray:
        """Position at which a fingertip begins to rake, (..., 3), metres."""
        place = data.site_xpos[self.site]
        return (
            place + np.array([0.0, 0.0, _BEHIND]) if self.kind == "down" else _behind(place, goal)
        )

    def proposals(
        self, random: np.random.Generator, data: NamedFields, goal: float
    ) -> list[Proposal]:
        """Proposals that put a fingertip behind the site, and then pull it to a goal (x, metres).

        The data are those of a single simulation.
        """
        place, now = data.site_xpos[self.site], data.qpos[ARM]
        start = _behind(place, goal)[PLANE]
        # The root turns from x to -x over the top, and so the other way below.
        turn = 0.3 * np.sign(goal - place[0]) * np.array([1.0, 0.0, 0.0, 0.0])
        poses = hand_poses(random, start, TIP_REACH, now, 12, lateral=TIP_ASIDE)
        pulls = [[pose, *pulled] for pose in poses for pulled in ([], [pose + turn])]
        return [Proposal(waypoints, [OPEN_ANGLE], 2) for waypoints in pulls]

    def poses(
        self, data: NamedFields, goal: float, walls: Obstacle, higher: float = 0.0
    ) -> np.ndarray:
        """Arm joints that have a fingertip where raking begins, or higher (n, 4), if that helps."""
        place = data.site_xpos[self.site]
        # An end that is near to the ground is not pressed down.
        if self.kind == "down" and height_above_ground(place) < _LOW:
            return np.zeros((0, 4))
        tip = (self._start(data, goal) - higher * downwards(place))[PLANE]
        random, now = np.random.default_rng(0), data.qpos[ARM]
        # Many are drawn: few are clear of the walls.
        sides = TIP_ASIDE, -TIP_ASIDE
        found = [hand_poses(random, tip, TIP_REACH, now, 400, lateral=side) for side in sides]
        poses = np.concatenate(found)
        # The fingers' middle lines may be a little in the walls and in the ground, which give way.
        clear = clearance(poses, HAND, walls)
        poses = poses[(clear[:, 0] > -0.004) & (clear[:, 3] > -0.009)]
        return poses[:: max(1, len(poses) // 64)]


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


def next_spot(data: NamedFields, spot: Spot | None, goal: float, walls: Obstacle) -> Spot:
    """The spot to try after another one, which a fingertip can reach.

    The first is a peg's middle, or the handle of one that leans with it upwards, so that it falls.
    """
    if spot is None:
        leans = data.site_xpos["peg_grasp"][2] - data.site_xpos["peg_tip"][2] > _LEANS
        return Spot("peg_grasp", "there") if leans else _SPOTS[0]
    first = 1 + _SPOTS.index(spot)
    order = _SPOTS[first:] + _SPOTS[:first]
    sensible = [s for s in order if s.kind != "away" or abs(s.goal(data, goal)) < _FURTHEST]
    reached = (s for s in sensible if len(s.poses(data, s.goal(data, goal), walls)))
    return next(reached, sensible[0])


def _behind(place: np.ndarray, goal: float) -> np.ndarray:
    """Position of a fingertip that rakes a place to a goal, (..., 3) -> (..., 3), metres."""
    outwards = np.where(place[..., :1] < goal, -1.0, 1.0)
    return place + outwards * np.array([_BEHIND, 0.0, 0.0]) + np.array([0.0, 0.0, _ABOVE])


class Rake:
    """The goal and the spot of raking; a peg that does not come nearer is raked from elsewhere."""

    def __init__(self, prop: Ball | Peg) -> None:
        self._prop = prop
        self._doubts = Watchdog(2)  # of the known reach of the object, which plannings contradict
        self._stayed_at = np.zeros(3)  # place of the object at the first of the misses
        self.goal: float | None = None  # x, metres; None while the object is not raked
        self.misses = 0  # failed searches for a path to the object since it has moved
        self._forget()

    def _forget(self) -> None:
        """Discards the spot and all headway."""
        self.spot: Spot | None = None  # none yet, or for a ball
        self._pulled_from = np.zeros(3)  # place of the peg when that spot was chosen
        self._watchdog = Watchdog(_PATIENCE, _HEADWAY)  # of peg and fingertip

    def stop(self) -> None:
        """Does not rake the object any more."""
        self.goal, self.misses = None, 0

    def note_search(self, is_found: bool) -> None:
        """Counts searches for a path to the object that have failed in a row."""
        self.misses = 0 if is_found else self.misses + 1

    def judge(self, data: NamedFields, is_within: bool) -> bool:
        """Begins or ends raking when the object's reach has changed three times in a row.

        Returns whether raking has just ended.
        """
        was_within = self.goal is None
        if is_within == was_within:
            self._doubts.begin()
        elif not self._doubts.watch():
            is_within = was_within
        self.goal = None if is_within else self._prop.rake_goal(data)
        return is_within and not was_within

    def choose_spot(self, data: NamedFields, walls: Obstacle, is_led: bool, moves: bool) -> None:
        """Decides at which spot a peg is raked, and rakes one to which no path leads.

        The first spot is chosen once the peg is at rest, another one without headway for long; an
        arm that is led to the spot has more time.
        """
        place = data.site_xpos[self._prop.name]
        if arrays.norm(place - self._stayed_at) > _MOVED:
            self._stayed_at, self.misses = place.copy(), 0
        if self.misses >= 2 and self.goal is None:
            self.goal = self._prop.rake_goal(data)
        if self.goal is None:
            self._forget()
            return
        is_pulled = arrays.norm(place - self._pulled_from) > _FREED
        if self.spot is not None and self.spot.kind != "there" and is_pulled:
            self._forget()
        is_stuck = self._watchdog.watch(self._left(data, self.goal), part=_LED if is_led else 1.0)
        if (self.spot is None and not moves) or is_stuck:
            self._watchdog.begin("fingertip")
            self._pulled_from = place.copy()
            self.spot = next_spot(data, self.spot, self.goal, walls)
        if self.spot is not None:
            self.goal = self.spot.goal(data, self.goal)

    def _left(self, data: NamedFields, goal: float) -> dict[str, float]:
        """Distances of the peg from the goal, and of a fingertip from the spot, metres."""
        left = {"peg": abs(float(data.site_xpos["peg"][0]) - goal)}
        if self.spot is not None:
            left["fingertip"] = float(self.spot.missing(data, self.spot.goal(data, goal)))
        return left

    def at(self) -> Spot:
        """The spot, or else the object's middle."""
        return self.spot or Spot(self._prop.name, "there")
