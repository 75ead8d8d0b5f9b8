"""Shortest paths of the arm around an obstacle, in a roadmap of random poses.

    path = find_path(now, goals, held=0.085, obstacle=Obstacle(ends, radii))  # or None
    path.advance(now)
    path.remaining(joints)  # (n, 4) -> (n,), radians

The roadmap's poses are the same in every process. A search keeps those that are clear of the
obstacle, and looks for the shortest path through them with A*, checking edges only when they are
needed. Forces are not considered: an arm that follows a path may cut its corners.
"""

import dataclasses
import functools
import heapq

import numpy as np

from limberjack.planner.arm.collision import LIMITS, Obstacle, clearance
from limberjack.planner.arm.geometry import GEOMETRY
from limberjack.planner.arm.path import Path, joint_sum

__all__ = ["find_path", "roadmap"]

_MARGIN = 0.008  # metres that the arm keeps from everything
_AT_ENDS = 80  # neighbours of a path's ends, which may be in a corner
_AT_ONCE = 64  # edges that are checked together
_EARLY = 100  # steps of a search, which then stops if no edge leads to a goal
_VIEW = 40  # points of a path; no more are covered within a plan

_Entry = tuple[float, float, int, int]  # least length by way of a node, to it, node, node before


def find_path(
    now: np.ndarray,  # the arm's joints, (4,)
    goals: np.ndarray,  # joints, (m, 4)
    held: float,  # from the wrist to the far end of a held object, metres
    obstacle: Obstacle,
    close: bool = False,  # whether to keep less clear if all goals are close to something
    budget: int = 3000,  # steps that the search may take; each takes about 0.1 ms
) -> Path | None:
    """A path from now to one of the goals, or None; straight to one of the nearest if it can."""
    if not len(goals):
        return None
    # Parts that are within the margin at the start may be so close there, and have to get away.
    least = clearance(now[None], held, obstacle)[0] - 0.001
    at_goals = clearance(goals, held, obstacle)
    most = np.full(len(least), _MARGIN)
    # Fingers may be near the floor all along, on which the object may lie.
    most[3] = min(least[3], np.median(at_goals[:, 3]) - 0.001, _MARGIN)
    scene = _Scene(held, obstacle, now, least, most)
    is_free = scene.is_free(goals, at_goals)
    if close and not is_free.any():
        usual = np.quantile(at_goals, 0.75, axis=0) - 0.001
        scene = dataclasses.replace(scene, most=np.minimum(most, np.maximum(usual, -0.004)))
        is_free = scene.is_free(goals, at_goals)
    goals = goals[is_free]
    if not len(goals):
        return None
    goals = now + _between(now, goals)
    nearest = np.argsort(np.abs(goals - now).sum(axis=-1), kind="stable")
    for goal in goals[nearest[:6]]:
        if scene.is_edge_free(now, goal - now):
            return Path(np.stack([now, goal]), joint_sum, view=_VIEW)
    chain = _Search(now, goals, scene).run(budget)
    if chain is None:
        return None
    # The root turns without jumps.
    chain = np.concatenate([chain[:1], chain[0] + _between(chain[:-1], chain[1:]).cumsum(axis=0)])
    sights = functools.partial(_Sights, scene)
    return Path(_shortened(chain, scene), joint_sum, view=_VIEW, sights=sights)


class _Search:
    """A* from the start over the roadmap to the goals."""

    def __init__(self, now: np.ndarray, goals: np.ndarray, scene: "_Scene") -> None:
        self._scene = scene
        self._nodes, self._neighbours = roadmap()
        # 64 poses nearby too: an arm that is in a corner first has to get out of it.
        around = np.random.default_rng(0).uniform(-0.8, 0.8, (64, 4))
        around = now + np.linspace(0.1, 1.0, 64)[:, None] * around
        self._poses = np.concatenate([self._nodes, now[None], goals, around])
        parts = np.array_split(self._poses, 10)  # which fit into the processor's cache
        self._usable = np.concatenate([scene.is_free(part) for part in parts])
        self._start = len(self._nodes)
        self._goals = range(self._start + 1, self._start + 1 + len(goals))
        self._ends_near: dict[int, list[int]] = {}  # goals and poses nearby, by node
        first = self._start + 1
        far = _distance(self._poses, self._poses[first:, None])  # from goals and poses nearby
        for end in np.flatnonzero(self._usable[first:]).tolist():
            near = far[end, : self._start].argpartition(_AT_ENDS)[:_AT_ENDS]
            for node in near[self._usable[near]].tolist():
                self._ends_near.setdefault(node, []).append(first + end)
        self._ahead = far[: len(goals)].min(axis=0)
        self._clear: dict[tuple[int, int], bool] = {}  # edges that have been checked

    def run(self, budget: int) -> np.ndarray | None:
        """Poses from start to goal, both included, (n, 4); None if there are none in budget."""
        poses, came = self._poses, dict[int, int]()
        queue = [(float(self._ahead[self._start]), 0.0, self._start, -1)]
        late = budget - _EARLY
        while queue and budget > 0:
            _, passed, node, before = heapq.heappop(queue)
            if node in came:
                continue
            budget -= 1
            if budget == late and self._is_enclosed():
                return None
            # Only edges that a shortest path may use are checked.
            if before >= 0 and not self._is_clear(before, node, queue):
                continue
            came[node] = before
            if node in self._goals:
                chain = [node]
                while came[chain[-1]] >= 0:
                    chain.append(came[chain[-1]])
                return poses[chain[::-1]]
            others = [n for n in self._beside(node) if self._usable[n] and n not in came]
            lengths = passed + _distance(poses[others], poses[node])
            for other, length in zip(others, lengths.tolist(), strict=True):
                entry = length + float(self._ahead[other]), length, other, node
                heapq.heappush(queue, entry)
        return None

    def _is_enclosed(self) -> bool:
        """Whether no edge of the roadmap leads to a goal."""
        for goal in self._goals:
            begins = self._nodes[[n for n, ends in self._ends_near.items() if goal in ends]]
            turns = _between(begins, self._poses[goal])
            if self._scene.are_edges_free(begins, turns).any():
                return False
        return True

    def _is_clear(self, before: int, node: int, queue: list[_Entry]) -> bool:
        """Whether an edge is clear.

        The next ones in the queue are checked with it: NumPy takes hardly longer for many.
        """
        if (before, node) not in self._clear:
            edges = [(b, n) for _, _, n, b in queue[:_AT_ONCE] if (b, n) not in self._clear]
            edges.append((before, node))
            begins, ends = self._poses[np.transpose(edges)]
            clear = self._scene.are_edges_free(begins, _between(begins, ends))
            self._clear.update(zip(edges, clear.tolist(), strict=True))
        return self._clear[before, node]

    def _beside(self, node: int) -> list[int]:
        """The poses that are connected with one."""
        if node < self._start:
            return [*self._neighbours[node], *self._ends_near.get(node, [])]
        local = range(self._goals.stop, len(self._poses))
        return [*_nearest(self._poses[node], self._nodes, _AT_ENDS), *local]


@functools.cache
def roadmap() -> tuple[np.ndarray, list[list[int]]]:
    """Poses (2000, 4) and the 14 nearest others of each; drawing them takes a part of a second."""
    widest = np.array([np.pi, *LIMITS])
    poses = np.random.default_rng(0).uniform(-widest, widest, (2000, 4))
    return poses, [_nearest(pose, poses, 15)[1:] for pose in poses]


def _nearest(pose: np.ndarray, others: np.ndarray, count: int) -> list[int]:
    """Indices of the poses (n, 4) nearest to one, nearest first."""
    far = _distance(others, pose)
    near = far.argpartition(count)[:count]
    return near[far[near].argsort(kind="stable")].tolist()


def _distance(poses: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Distances of poses (n, 4) from another one, (n,), radians of all joints together."""
    return np.abs(_between(other, poses)).sum(axis=-1)


def _between(pose: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Turns from one pose to others, (..., 4), the root in the shorter direction."""
    turn = others - pose
    turn[..., 0] = (turn[..., 0] + np.pi) % (2 * np.pi) - np.pi
    return turn


def _shortened(waypoints: np.ndarray, scene: "_Scene") -> np.ndarray:
    """The same path without the waypoints that are not needed, (n, 4)."""
    kept, last = [0], len(waypoints) - 1
    while kept[-1] < last:
        here, there = kept[-1], last
        while there > here + 1 and not scene.is_edge_free(
            waypoints[here], waypoints[there] - waypoints[here]
        ):
            there -= 1
        kept.append(there)
    return waypoints[kept]


@dataclasses.dataclass(frozen=True)
class _Scene:
    """Distances that an arm with a held object must keep: see `clearance`."""

    held: float  # metres from the wrist to the far end of a held object
    obstacle: Obstacle
    begin: np.ndarray  # the path's start, (4,)
    least: np.ndarray  # smallest distances there, (4,), metres
    most: np.ndarray  # smallest distances elsewhere, (4,)

    def is_free(self, poses: np.ndarray, gaps: np.ndarray | None = None) -> np.ndarray:
        """Whether poses (n, 4) are within limits and clear of everything, (n,)."""
        gaps = self._clearance(poses) if gaps is None else gaps
        within = np.all(np.abs(poses[:, 1:]) <= GEOMETRY.limits, axis=-1)
        return within & np.all(gaps > self._allowed(poses), axis=-1)

    def is_edge_free(self, begin: np.ndarray, turn: np.ndarray) -> bool:
        """Whether an arm can turn straight on from a pose, (4,) each."""
        return bool(self.are_edges_free(begin[None], turn[None])[0])

    def are_edges_free(self, begins: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Whether arms can turn straight on from poses, (n, 4) each -> (n,).

        They are checked every 0.12 radians, and four times as often near an obstacle: from one pose
        to the next a hand far from the base could jump over a wall.
        """
        counts = np.maximum(np.ceil(np.abs(turns).max(axis=-1) / 0.12).astype(int), 1)
        edge, first = np.arange(len(turns)).repeat(counts), counts.cumsum() - counts
        turn, count = turns[edge], counts[edge]
        steps = np.arange(len(edge)) - first[edge] + 1
        poses = begins[edge] + (steps / count)[:, None] * turn
        gaps = self._clearance(poses)
        free = np.logical_and.reduceat(self.is_free(poses, gaps), first)
        near = free[edge] & (gaps[:, 0] < 0.05)
        if near.any():
            back = np.arange(1, 4)[:, None, None] / (4 * count[near, None]) * turn[near]
            between = (poses[near] - back).reshape(-1, 4)
            touched = self._allowed(between)[:, 0] - _MARGIN
            clear = (self._clearance(between)[:, 0] > touched).reshape(3, -1).all(axis=0)
            free[edge[near][~clear]] = False
        return free

    def _clearance(self, poses: np.ndarray) -> np.ndarray:
        return clearance(poses, self.held, self.obstacle)

    def _allowed(self, poses: np.ndarray) -> np.ndarray:
        """Smallest distances at poses (n, 4), (n, 4), metres; a path leaves those at its start."""
        away = 0.03 * _distance(poses, self.begin)[:, None]  # metres per radian
        return np.minimum(self.least + away, self.most)


class _Sights:
    """The last point of a path to which the arm can go straight from a point, when asked for it."""

    def __init__(self, scene: _Scene, poses: np.ndarray) -> None:
        self._poses, self._scene = poses, scene
        self._known: list[int] = []  # of the first points

    def __call__(self, point: int) -> int:
        while len(self._known) <= point:
            self._known.append(self._next())
        return self._known[point]

    def _next(self) -> int:
        """That of the first point for which it is not known; no less than of the point before."""
        here = len(self._known)
        last = max([*self._known[-1:], min(here + 1, len(self._poses) - 1)])
        ahead, is_free = self._poses[last + 1 : last + 3], True
        while is_free and len(ahead):
            begins = np.broadcast_to(self._poses[here], ahead.shape)
            free = self._scene.are_edges_free(begins, ahead - begins)
            is_free = bool(free.all())
            last += len(ahead) if is_free else int(free.argmin())
            ahead = self._poses[last + 1 : last + 3]
        return last
