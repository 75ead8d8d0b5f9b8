"""Short paths of the arm between floor and walls, straight or with one waypoint in between.

    found = find_detours(random, now=qpos[:4], goals=poses[:, None], reach=0.178)  # shortest first
    kept = keep_clear(now, found, reach=0.178)  # at the next planning step

Unlike in the roadmap, nothing but the ground and a line is in the way, and a path is needed at
every planning step: waypoints are drawn, and the shortest clear pair of straight paths wins.
"""

from collections.abc import Sequence

import numpy as np

from limberjack.planner.arm.collision import hand_gap, hand_height, is_clear
from limberjack.planner.arm.path import Path, joint_time

__all__ = ["find_detours", "keep_clear"]

_COUNT = 6  # paths that are kept
_WAYPOINTS = 80  # that are drawn
_POINTS = np.arange(1, 7) / 6  # of a straight path, at which it is checked
_ENDS = 24  # least number of goals that are tried, counting those with the root a turn off
_AT_ONCE = 96  # straight paths that are checked together
_KEPT = 0.012  # metres; distance of a hand's middle lines from floor and walls
_GAP = 0.025  # metres; the same from the line that the hand goes around


def find_detours(
    random: np.random.Generator,
    now: np.ndarray,
    goals: np.ndarray,
    reach: float,
    known: Sequence[Path] = (),
    around: np.ndarray | None = None,
    first: np.ndarray | None = None,
) -> list[Path]:
    """The shortest clear paths, at most `_COUNT`; none if nothing is clear.

    Args:
      random: draws the waypoints.
      now: the arm's joints, (4,).
      goals: joints to reach, and others to pass from there on in any case, (n, m, 4); the root may
        turn either way.
      reach: from the wrist to the far end of a held object, metres.
      known: earlier paths, whose waypoints are tried again, so that the arm keeps to one of them.
      around: a line that the hand keeps clear of up to the goal, (2, 2) of its ends, metres.
      first: joints to pass first, (4,), to get away from where nothing is clear.
    """
    if not len(goals):
        return []
    begin = now[None] if first is None else np.stack([now, first])
    now = begin[-1]
    turn = 2 * np.pi * np.array([1.0, 0.0, 0.0, 0.0])
    goals = np.concatenate([goals, goals + turn, goals - turn])
    nearest = np.argsort(joint_time(now, goals[:, 0]), kind="stable")
    goals = goals[nearest[: max(len(goals) // 3, _ENDS)]]
    ends = goals[:, 0]
    draws = _WAYPOINTS if known else 4 * _WAYPOINTS  # a first search is more thorough
    drawn = now + random.uniform(-1.0, 1.0, (draws, 4)) * np.array([np.pi, 3.0, 3.0, 2.5])
    drawn = np.concatenate([*(path.via[None] for path in known if path.via is not None), drawn])
    drawn = drawn[is_clear(drawn, reach) & _is_straight_clear(now, drawn, reach, around)]
    direct = _is_straight_clear(now, ends, reach, around)
    found = [_path(begin, goal) for goal in goals[direct][:_COUNT]]
    for via, end in _onwards(now, drawn, ends, reach, around):
        found.append(_path(begin, goals[end], drawn[via]))
    return sorted(found, key=lambda path: path.length)[:_COUNT]


def keep_clear(
    now: np.ndarray,
    known: Sequence[Path],
    reach: float,
    around: np.ndarray | None = None,
    first: np.ndarray | None = None,
) -> list[Path]:
    """The known paths that are still clear from now on, without their waypoints if possible.

    Takes the same arguments as `find_detours` and is much quicker: it searches for no others.
    """
    if not known:
        return []
    begin = now[None] if first is None else np.stack([now, first])
    ends = [path.goal[0] for path in known]
    ends += [path.goal[0] if path.via is None else path.via for path in known]
    direct, to_via = np.split(_is_straight_clear(begin[-1], np.array(ends), reach, around), 2)
    found = [
        _path(begin, path.goal, None if is_direct else path.via)
        for path, is_direct, is_clear_to_via in zip(known, direct, to_via, strict=True)
        if is_direct or is_clear_to_via
    ]
    return sorted(found, key=lambda path: path.length)


def _path(begin: np.ndarray, goal: np.ndarray, via: np.ndarray | None = None) -> Path:
    """A path from joints (k, 4) to a goal's (m, 4), by way of others (4,)."""
    waypoints = [begin, goal] if via is None else [begin, via[None], goal]
    return Path(np.concatenate(waypoints), joint_time, goal, via)


def _onwards(
    now: np.ndarray,
    drawn: np.ndarray,
    ends: np.ndarray,
    reach: float,
    around: np.ndarray | None,
) -> list[tuple[int, int]]:
    """The waypoints (n, 4) with the shortest clear paths from now to an end (m, 4), and those ends.

    Few are checked: the shortest first, until that many waypoints have been found, or a few more.
    """
    lengths = joint_time(now, drawn)[:, None] + joint_time(drawn[:, None], ends)
    shortest = np.argsort(lengths, axis=None, kind="stable")
    found: dict[int, int] = {}
    for first in range(0, len(shortest), _AT_ONCE):
        via, end = np.divmod(shortest[first : first + _AT_ONCE], len(ends))
        clear = _is_straight_clear(drawn[via], ends[end], reach, around)
        for one, other in zip(via[clear].tolist(), end[clear].tolist(), strict=True):
            found.setdefault(one, other)
        if len(found) >= _COUNT:
            break
    return list(found.items())[:_COUNT]


def _is_straight_clear(
    start: np.ndarray, ends: np.ndarray, reach: float, around: np.ndarray | None
) -> np.ndarray:
    """Whether straight joint paths keep clear, (..., 4) -> (...)."""
    start = np.broadcast_to(start, np.broadcast_shapes(start.shape, ends.shape))[..., None, :]
    points = start + _POINTS[:, None] * (ends[..., None, :] - start)
    # A part that is nearer to the floor now, as of a hand that grasps, may be as near later.
    low = np.minimum(hand_height(start) - 0.001, _KEPT)
    clear = is_clear(points, reach) & (hand_height(points) > low)
    if around is not None:
        clear &= hand_gap(points, around) > np.minimum(hand_gap(start, around) - 0.001, _GAP)
    return np.all(clear, axis=-1)
