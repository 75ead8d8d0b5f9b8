"""Short paths of the arm between floor and walls, straight or with one waypoint in between.

    detours = Detours(reach=0.178)
    found = detours.find(random, now=qpos[:4], goals=poses[:, None])  # shortest first
    kept = detours.keep(now, found)                                   # at the next planning step

Unlike in the roadmap, nothing but the ground and a line is in the way, and a path is needed at
every planning step: waypoints are drawn, and the shortest clear pair of straight paths wins.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from limberjack.planner.arm.collision import hand_gap, hand_height, is_clear
from limberjack.planner.arm.path import Path, joint_time

__all__ = ["Detours"]

_COUNT = 6  # paths that are kept


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
