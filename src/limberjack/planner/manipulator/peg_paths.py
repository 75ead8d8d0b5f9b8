"""`PegPaths`: the arm's paths to a peg that lies still and, once it is held, to the target.

    paths = PegPaths(random)
    paths.search_target(now, up, find_goals)
    cost = paths.cost_to_target(joints, near_cost)  # (N,)

Far from the end of a path its remaining length costs; near the end, the positions of hand and peg.
These alone are not enough: a peg near the target, or a hand near the peg, would never turn round.

The paths are straight or have one waypoint in between. Unlike in the roadmap, nothing but the
ground and a line is in the way, and a path is needed at every planning step: waypoints are drawn,
and the shortest clear pair of straight paths wins (`Detours`).
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from limberjack.planner.arm.collision import hand_gap, hand_height, is_clear
from limberjack.planner.arm.hand import PLANE
from limberjack.planner.arm.kinematics import direction, nudged
from limberjack.planner.arm.path import Path, joint_time
from limberjack.planner.arm.proposals import Proposal, plans_of
from limberjack.planner.manipulator.props import Peg, Pose, in_world

__all__ = ["Detours", "PegPaths"]

_COUNT = 6  # paths that are kept
_HAND, _HAND_AND_PEG = 0.1, 0.178  # metres; from the wrist to the end
_INTERVAL = 2  # plannings between searches for better paths
_AT_PEG = 0.3  # radians from the end of the path to a peg, within which the hand counts

_Goals = Callable[[], np.ndarray]  # draws joints, (n, 4)


@dataclasses.dataclass(frozen=True)
class Detours:
    """A search for the shortest clear paths."""

    reach: float  # from the wrist to the far end of a held object, metres
    around: np.ndarray | None = None  # a line of which the hand keeps clear, (2, 2), metres
    first: np.ndarray | None = None  # joints to pass first, (4,), away from where nothing is clear

    def find(
        self,
        random: np.random.Generator,
        now: np.ndarray,  # the arm's joints, (4,)
        goals: np.ndarray,  # joints to reach, and others to pass from there on, (n, m, 4)
        known: Sequence[Path] = (),
    ) -> list[Path]:
        """The shortest clear paths, at most `_COUNT`; none if nothing is clear.

        The waypoints of known paths are tried again, so that the arm keeps to one of them. The root
        may turn either way.
        """
        if not len(goals):
            return []
        begin = self._begin(now)
        now = begin[-1]
        turn = 2 * np.pi * np.array([1.0, 0.0, 0.0, 0.0])
        goals = np.concatenate([goals, goals + turn, goals - turn])
        nearest = np.argsort(joint_time(now, goals[:, 0]), kind="stable")
        goals = goals[nearest[: max(len(goals) // 3, 24)]]
        ends = goals[:, 0]
        draws = 80 if known else 320  # a first search is more thorough
        drawn = now + random.uniform(-1.0, 1.0, (draws, 4)) * np.array([np.pi, 3.0, 3.0, 2.5])
        drawn = np.concatenate([*(path.via[None] for path in known if path.via is not None), drawn])
        drawn = drawn[is_clear(drawn, self.reach) & self._is_straight_clear(now, drawn)]
        direct = self._is_straight_clear(now, ends)
        found = [_path(begin, goal) for goal in goals[direct][:_COUNT]]
        for via, end in self._onwards(now, drawn, ends):
            found.append(_path(begin, goals[end], drawn[via]))
        return sorted(found, key=lambda path: path.length)[:_COUNT]

    def keep(self, now: np.ndarray, known: Sequence[Path]) -> list[Path]:
        """The known paths that are still clear from now on, without their waypoints if possible.

        Much quicker than `find`: it searches for no others.
        """
        if not known:
            return []
        begin = self._begin(now)
        ends = [path.goal[0] for path in known]
        ends += [path.goal[0] if path.via is None else path.via for path in known]
        direct, to_via = np.split(self._is_straight_clear(begin[-1], np.array(ends)), 2)
        found = [
            _path(begin, path.goal, None if is_direct else path.via)
            for path, is_direct, is_clear_to_via in zip(known, direct, to_via, strict=True)
            if is_direct or is_clear_to_via
        ]
        return sorted(found, key=lambda path: path.length)

    def _begin(self, now: np.ndarray) -> np.ndarray:
        """Joints with which all paths begin, (1 or 2, 4)."""
        return now[None] if self.first is None else np.stack([now, self.first])

    def _onwards(
        self, now: np.ndarray, drawn: np.ndarray, ends: np.ndarray
    ) -> list[tuple[int, int]]:
        """The waypoints (n, 4) with the shortest clear paths to an end (m, 4), and those ends.

        The shortest are checked first, 96 at a time, until enough waypoints have been found.
        """
        lengths = joint_time(now, drawn)[:, None] + joint_time(drawn[:, None], ends)
        shortest = np.argsort(lengths, axis=None, kind="stable")
        found: dict[int, int] = {}
        for first in range(0, len(shortest), 96):
            via, end = np.divmod(shortest[first : first + 96], len(ends))
            clear = self._is_straight_clear(drawn[via], ends[end])
            for one, other in zip(via[clear].tolist(), end[clear].tolist(), strict=True):
                found.setdefault(one, other)
            if len(found) >= _COUNT:
                break
        return list(found.items())[:_COUNT]

    def _is_straight_clear(self, start: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Whether straight joint paths are clear at six points, (..., 4) -> (...).

        The hand's middle lines keep 12 mm from the ground and 25 mm from the line around which they
        go. A part that is nearer now, as of a hand that grasps, may be as near later.
        """
        start = np.broadcast_to(start, np.broadcast_shapes(start.shape, ends.shape))[..., None, :]
        points = start + np.arange(1, 7)[:, None] / 6 * (ends[..., None, :] - start)
        low = np.minimum(hand_height(start) - 0.001, 0.012)
        clear = is_clear(points, self.reach) & (hand_height(points) > low)
        if self.around is not None:
            least = np.minimum(hand_gap(start, self.around) - 0.001, 0.025)
            clear &= hand_gap(points, self.around) > least
        return np.all(clear, axis=-1)


def _path(begin: np.ndarray, goal: np.ndarray, via: np.ndarray | None = None) -> Path:
    """A path from joints (k, 4) to a goal's (m, 4), by way of others (4,)."""
    waypoints = [begin, goal] if via is None else [begin, via[None], goal]
    return Path(np.concatenate(waypoints), joint_time, goal, via)


class PegPaths:
    """Paths that are kept as long as they are clear, so that the arm keeps to one of them.

    Searches take the arm's joints, (4,), and a function that draws goals.
    """

    def __init__(self, random: np.random.Generator) -> None:
        """Knows no path yet; the random stream is that of the searches."""
        self._random = random
        self._to_peg: list[Path] = []  # to before a peg, and on to it
        self._to_target: list[Path] = []
        self._goals = np.zeros((0, 4))  # joints that have a held peg at the target
        self._before = np.zeros((0, 2, 4))  # joints that have the hand before a peg, and at it
        self._lay = np.zeros(12)  # the peg's pose for which these are
        self._age = 0  # plannings since better paths were searched

    def forget(self) -> None:
        """Discards all paths, as for a peg that moves or is out of reach."""
        self._to_peg, self._to_target = [], []

    def search_target(self, now: np.ndarray, up: np.ndarray, find: _Goals) -> bool:
        """Searches for better paths to the target with a held peg; returns whether one is known.

        A hand lower than 35 mm is first lifted in the direction `up`, (2,).
        """
        self._to_peg = []
        if not self._to_target:  # none yet, or all of these are blocked
            self._goals = find()
        lift = 0.035 - float(hand_height(now))
        first = nudged(now, lift * up, 0.0) if lift > 0 else None
        detours = Detours(_HAND_AND_PEG, first=first)
        self._to_target = self._better(detours, now, self._goals[:, None], self._to_target)
        return len(self._to_target) > 0

    def _better(
        self, detours: Detours, now: np.ndarray, goals: np.ndarray, known: list[Path]
    ) -> list[Path]:
        """Known paths that are clear from now on; others if none is, or if a search is due."""
        self._age = (self._age + 1) % _INTERVAL
        kept = detours.keep(now, known) if self._age else []
        return kept or detours.find(self._random, now, goals, known)

    def search_peg(self, now: np.ndarray, peg: Pose, find: _Goals) -> None:
        """Searches for better paths to a peg that do not go across it."""
        self._to_target = []
        pose = np.concatenate(peg)
        # A peg that has moved by more than a centimetre, or that much of its frame, needs others.
        if not self._to_peg or np.abs(pose - self._lay).max() > 0.01:
            self._lay, poses = pose, find()
            self._age = _INTERVAL - 1  # the paths that are known lead elsewhere
            back = nudged(poses, -0.07 * direction(poses.sum(axis=-1)), 0.0)  # clear of the peg
            self._before = np.stack([back, poses], axis=1)
        place, frame = peg
        line = np.stack([place + in_world(frame, Peg.place), place - 0.05 * frame[2::3]])
        detours = Detours(_HAND, around=line[:, PLANE])
        self._to_peg = self._better(detours, now, self._before, self._to_peg)

    def search_room(self, now: np.ndarray, widest: np.ndarray) -> None:
        """Searches for paths to joints of at most `widest` radians, (4,), so that the peg falls."""
        self._to_target = []
        goals = np.random.default_rng(0).uniform(-widest, widest, (8, 1, 4))
        self._to_peg = Detours(_HAND).find(self._random, now, goals, self._to_peg)

    def cost_to_peg(self, joints: np.ndarray, near_cost: np.ndarray) -> np.ndarray:
        """Cost of the rest of the path to the peg and, at its end, of the hand, (N,)."""
        return _cost(self._to_peg, joints, near_cost, (_AT_PEG, 1.0, 1.0))

    def cost_to_target(self, joints: np.ndarray, near_cost: np.ndarray) -> np.ndarray:
        """Cost of the rest of the path to the target and, at its end, of the peg, (N,)."""
        return _cost(self._to_target, joints, near_cost, (0.4, 1.2, 2.0))

    def plans(self, now: np.ndarray, knots: int) -> np.ndarray:
        """Targets along the shortest path, at several speeds, (n, knots, 5)."""
        if self._to_target:
            path, grasp = self._to_target[0], Peg.shut
        elif self._to_peg and self._to_peg[0].length > _AT_PEG:
            path, grasp = self._to_peg[0], Peg.ready
        else:
            return np.zeros((0, knots, 5))
        strides = 0.3, 1.0, 3.0  # radians from one knot to the next
        return plans_of(now, [Proposal(path.ahead(s, knots - 1), [grasp]) for s in strides], knots)


def _cost(
    paths: list[Path], joints: np.ndarray, near_cost: np.ndarray, scales: tuple[float, float, float]
) -> np.ndarray:
    """Cost of the rest of the shortest path and, within `near` radians of its end, the other, (N,).

    Twice as far from the end the other does not count. The scales are `near`, the cost per radian,
    and a cost of being far.
    """
    near, per_radian, besides = scales
    if not paths:
        return near_cost
    left = paths[0].remaining(joints)
    far = np.clip(left / near - 1.0, 0.0, 1.0)
    return far * (per_radian * left + besides) + (1.0 - far) * near_cost
