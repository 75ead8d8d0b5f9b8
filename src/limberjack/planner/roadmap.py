"""Ways of the planar arm around an obstacle, found in a map of random poses.

    way = find_way(now, goals, held=0.178, obstacle=Obstacle(ends, radii))  # or None
    way.go_on(now)
    left = way.remaining(joints)  # (n, 4) -> (n,), radians

The map's poses are the same in every process; each search keeps those that are clear of the
obstacle and looks for the shortest way through them (A*). Links, hand and what the hand holds keep
clear of the obstacle, of the arm itself, of floor and walls. It knows nothing of forces: what
follows a way may cut its corners.
"""

import dataclasses
import functools
import heapq

import numpy as np

from limberjack.planner.planar_ik import BASE_HEIGHT, LENGTHS, LIMITS, WALL

__all__ = ["Obstacle", "Way", "clearance", "find_way"]

_BASE = np.array([0.0, BASE_HEIGHT])  # metres
_MARGIN = 0.008  # metres; how far the arm keeps from everything
_TOUCHING = -0.004  # metres; at the goals it may be so near if need be
_NODES, _NEIGHBOURS = 2000, 14
_AT_ENDS = 80  # neighbours of a way's ends, which may be in a corner
_LOCAL, _AROUND = 64, 0.8  # poses around the beginning, radians
_STEP = 0.12  # radians; between the poses that are checked along a way
_FINER, _NEAR = 4, 0.05  # by so much finer where an obstacle is so near, metres
_HAND_TO_FLOOR = 3  # of what is kept clear: from obstacle, from the arm, links and hand from floor
_LEAVES = 0.03  # metres per radian; how soon a way leaves what the arm is too near to
_LINKS = 3  # of the lines that are checked against the floor: two links and the hand's axis
_SPACING = 0.1  # radians, of all joints together; between the poses of a way
_IN_VIEW = 40  # poses of a way; no more are passed within a plan
_RETURN = 1.3  # how much a radian beside a way counts, against one along it

# Radians beside poses that are behind what the way goes around, and how much one more counts: who
# takes the short cut to them ends at the obstacle.
_CORNER, _CUT = 0.35, 5.0

# The hand's and fingers' middle lines in the hand's frame, metres: (aside, ahead) of both ends.
_HAND = np.array(
    [
        [[0.0, 0.0], [0.0, 0.03]],
        [[0.0, 0.03], [-0.034, 0.045]],
        [[0.0, 0.03], [0.034, 0.045]],
        [[-0.034, 0.045], [-0.034, 0.098]],
        [[0.034, 0.045], [0.034, 0.098]],
    ]
)
_RADII = np.array([0.02, 0.017, 0.014, 0.011, 0.008, 0.008, 0.01, 0.01, 0.005])
_ITSELF = ((0, 2), (0, 3), (0, 6), (0, 7), (0, 8), (1, 3), (1, 6), (1, 7), (1, 8))


@dataclasses.dataclass(frozen=True)
class Obstacle:
    """Thick lines: ends (m, 2, 2) and radii (m,), metres."""

    ends: np.ndarray
    radii: np.ndarray


class Way:
    """Poses to pass one after the other.

    Attributes:
      is_straight: there is nothing in the way to the goal.
    """

    def __init__(self, stations: np.ndarray, scene: "_Scene | None" = None) -> None:
        """Takes the poses at which the way bends, and its ends, (n, 4), and what it goes around."""
        self.is_straight = len(stations) == 2
        lengths = np.abs(np.diff(stations, axis=0)).sum(axis=-1)
        passed = np.concatenate([[0.0], lengths.cumsum()])
        places = np.linspace(0.0, passed[-1], 2 + int(passed[-1] / _SPACING))
        self._poses = np.stack([np.interp(places, passed, s) for s in stations.T], axis=-1)
        self._left = passed[-1] - places
        self._passed = 0  # poses
        last = len(places) - 1
        self._sight = np.full(last + 1, last)  # the last pose to which it is clear straight on
        if scene is not None:
            self._sight = _sights(self._poses, scene)

    def go_on(self, joints: np.ndarray) -> None:
        """Notes how far the arm has come, whose joints are these now, (4,)."""
        self._passed += int(self._aside(joints[None])[0].argmin())

    def remaining(self, joints: np.ndarray) -> np.ndarray:
        """How far it is to the end, (n, 4) -> (n,), radians of all joints together."""
        left, aside = self._left[self._passed : self._passed + _IN_VIEW], self._aside(joints)
        is_behind = np.arange(len(left)) > self._sight[self._passed] - self._passed
        cut = is_behind * np.maximum(aside - _CORNER, 0.0)
        return (_RETURN * aside + _CUT * cut + left).min(axis=-1)

    def astray(self, joints: np.ndarray) -> np.ndarray:
        """How far joints are from the way, (n, 4) -> (n,), radians of all joints together."""
        return self._aside(joints).min(axis=-1)

    def ahead(self, stride: int) -> list[np.ndarray]:
        """Poses to pass from now on, one in so many, the last one always."""
        return [*self._poses[self._passed + stride :: stride], self._poses[-1]]

    def _aside(self, joints: np.ndarray) -> np.ndarray:
        """How far joints (n, 4) are from each pose that is next, (n, poses)."""
        # Not from all: the end may be near, but behind what the way goes around.
        poses = self._poses[self._passed : self._passed + _IN_VIEW]
        return np.abs(joints[:, None] - poses).sum(axis=-1)


def find_way(
    now: np.ndarray, goals: np.ndarray, held: float, obstacle: Obstacle, close: bool = False
) -> Way | None:
    """A way from now to one of the goals, or None; straight to the nearest if that is possible.

    Args:
      now: the arm's joints, (4,).
      goals: joints, (m, 4).
      held: how far ahead of the wrist the end of what is held is, metres.
      obstacle: what to keep clear of.
      close: whether to keep less clear if all goals are near to something.
    """
    if not len(goals):
        return None
    # What is nearer than the margin to begin with may be as near there, and has to get away.
    least = clearance(now[None], held, obstacle)[0] - 0.001
    most = np.full(len(least), _MARGIN)
    # Fingers may be near to the floor all the way, on which the object may lie.
    floor = np.median(clearance(goals, held, obstacle)[:, _HAND_TO_FLOOR])
    most[_HAND_TO_FLOOR] = min(least[_HAND_TO_FLOOR], floor - 0.001, _MARGIN)
    scene = _Scene(held, obstacle, now, least, most)
    is_free = scene.is_free(goals)
    if close and not is_free.any():
        usual = np.quantile(clearance(goals, held, obstacle), 0.75, axis=0) - 0.001
        scene = dataclasses.replace(scene, most=np.minimum(most, np.maximum(usual, _TOUCHING)))
        is_free = scene.is_free(goals)
    goals = goals[is_free]
    if not len(goals):
        return None
    goals = now + _between(now, goals)
    nearest = np.argsort(np.abs(goals - now).sum(axis=-1), kind="stable")
    for goal in goals[nearest[:6]]:
        if scene.is_way_free(now, goal - now):
            return Way(np.stack([now, goal]))
    chain = _search(now, goals, scene)
    return None if chain is None else Way(_shortened(_unwrapped(chain), scene), scene)


def _search(now: np.ndarray, goals: np.ndarray, scene: "_Scene") -> np.ndarray | None:
    """Poses of the map from now to a goal, both included, (n, 4); A*."""
    nodes, neighbours = _map()
    # Poses nearby too: an arm that is in a corner first has to get out of it.
    around = np.random.default_rng(0).uniform(-_AROUND, _AROUND, (_LOCAL, 4))
    around = now + np.linspace(0.1, 1.0, _LOCAL)[:, None] * around
    poses = np.concatenate([nodes, now[None], goals, around])
    usable = scene.is_free(poses)
    start, first_goal = len(nodes), len(nodes) + 1
    first_local = first_goal + len(goals)
    goals_near: dict[int, list[int]] = {}
    for goal in range(first_goal, len(poses)):
        for node in _nearest(poses[goal], nodes, _AT_ENDS):
            goals_near.setdefault(node, []).append(goal)
    ahead = np.min([_distance(poses, goal) for goal in goals], axis=0)
    came: dict[int, int] = {}
    queue = [(float(ahead[start]), 0.0, start, -1)]
    while queue:
        _, passed, node, before = heapq.heappop(queue)
        # Only ways that a shortest one may use are looked at closely.
        if node in came:
            continue
        if before >= 0 and not scene.is_way_free(
            poses[before], _between(poses[before], poses[node])
        ):
            continue
        came[node] = before
        if first_goal <= node < first_local:
            chain = [node]
            while came[chain[-1]] >= 0:
                chain.append(came[chain[-1]])
            return poses[chain[::-1]]
        near = neighbours[node] if node < start else _nearest(poses[node], nodes, _AT_ENDS)
        if node >= start:
            near = [*near, *range(first_local, len(poses))]
        others = [n for n in [*near, *goals_near.get(node, [])] if usable[n] and n not in came]
        lengths = passed + _distance(poses[others], poses[node])
        for other, length in zip(others, lengths.tolist(), strict=True):
            heapq.heappush(queue, (length + float(ahead[other]), length, other, node))
    return None


@functools.cache
def _map() -> tuple[np.ndarray, list[list[int]]]:
    """Poses (n, 4) and the nearest others of each."""
    random = np.random.default_rng(0)
    widest = np.array([np.pi, *LIMITS])
    poses = random.uniform(-widest, widest, (_NODES, 4))
    return poses, [_nearest(pose, poses, 1 + _NEIGHBOURS)[1:] for pose in poses]


def _nearest(pose: np.ndarray, others: np.ndarray, count: int) -> list[int]:
    return np.argsort(_distance(others, pose), kind="stable")[:count].tolist()


def _distance(poses: np.ndarray, other: np.ndarray) -> np.ndarray:
    """From poses (n, 4) to another one, (n,), radians of all joints together."""
    return np.abs(_between(other, poses)).sum(axis=-1)


def _between(pose: np.ndarray, others: np.ndarray) -> np.ndarray:
    """From one pose to others, (..., 4), the root by the shorter way round."""
    way = others - pose
    way[..., 0] = (way[..., 0] + np.pi) % (2 * np.pi) - np.pi
    return way


def _unwrapped(poses: np.ndarray) -> np.ndarray:
    """The same poses with the root turning without jumps, (n, 4)."""
    ways = _between(poses[:-1], poses[1:])
    return np.concatenate([poses[:1], poses[0] + np.cumsum(ways, axis=0)])


def _shortened(stations: np.ndarray, scene: "_Scene") -> np.ndarray:
    """The same way without the stations that are not needed, (n, 4)."""
    kept, last = [0], len(stations) - 1
    while kept[-1] < last:
        here, there = kept[-1], last
        while there > here + 1 and not scene.is_way_free(
            stations[here], stations[there] - stations[here]
        ):
            there -= 1
        kept.append(there)
    return stations[kept]


@dataclasses.dataclass(frozen=True)
class _Scene:
    """What an arm that holds something must keep clear of, and how far: see `clearance`.

    Attributes:
      held: how far ahead of the wrist the end of what is held is, metres.
      obstacle: what to keep clear of.
      begin: where the way begins, (4,).
      least: how near to everything it may be there, (4,), metres.
      most: how far it must keep elsewhere, (4,).
    """

    held: float
    obstacle: Obstacle
    begin: np.ndarray
    least: np.ndarray
    most: np.ndarray

    def is_free(self, poses: np.ndarray) -> np.ndarray:
        """Whether poses (n, 4) are within limits and clear of everything, (n,)."""
        within = np.all(np.abs(poses[:, 1:]) <= LIMITS + 0.05, axis=-1)
        return within & np.all(self._clearance(poses) > self._allowed(poses), axis=-1)

    def is_way_free(self, begin: np.ndarray, way: np.ndarray) -> bool:
        """Whether an arm can go straight on from a pose, (4,) each."""
        count = int(np.ceil(np.abs(way).max() / _STEP))
        poses = begin + np.linspace(0.0, 1.0, 1 + count)[1:, None] * way
        if not self.is_free(poses).all():
            return False
        # From one pose to the next a hand far from the base would jump over a wall.
        near = self._clearance(poses)[:, 0] < _NEAR
        back = np.arange(1, _FINER)[:, None, None] / (_FINER * count) * way
        between = (poses[near] - back).reshape(-1, 4)
        touched = self._allowed(between)[:, 0] - _MARGIN
        return bool((self._clearance(between)[:, 0] > touched).all())

    def _clearance(self, poses: np.ndarray) -> np.ndarray:
        return clearance(poses, self.held, self.obstacle)

    def _allowed(self, poses: np.ndarray) -> np.ndarray:
        """How near poses (n, 4) may be to everything, (n, 4), metres."""
        away = _LEAVES * _distance(poses, self.begin)[:, None]
        return np.minimum(self.least + away, self.most)


def _sights(poses: np.ndarray, scene: _Scene) -> np.ndarray:
    """For each pose of a way the last one to which the arm can go straight, (n,)."""
    last, sights = 0, []
    for here, pose in enumerate(poses):
        last = max(last, min(here + 1, len(poses) - 1))
        while last + 1 < len(poses) and scene.is_way_free(pose, poses[last + 1] - pose):
            last += 1
        sights.append(last)
    return np.array(sights)


def clearance(poses: np.ndarray, held: float, obstacle: Obstacle) -> np.ndarray:
    """How far poses (n, 4) are from the obstacle, from themselves, from floor and walls, (n, 4)."""
    lines = _lines(poses, held)
    gaps = _gaps(lines[:, :, None], obstacle.ends[None, None])
    apart = gaps - _RADII[:, None] - obstacle.radii
    first, second = np.array(_ITSELF).T
    itself = _gaps(lines[:, first], lines[:, second]) - _RADII[first] - _RADII[second]
    x, z = lines[:, 1:, :, 0], lines[:, 1:, :, 1]
    wall = np.minimum(z, (z + WALL - np.abs(x)) / np.sqrt(2)) - _RADII[1:, None]
    links, hand = wall[:, :_LINKS].min(axis=(1, 2)), wall[:, _LINKS:].min(axis=(1, 2))
    apart = apart.min(axis=(1, 2), initial=np.inf)  # there may be no obstacle
    return np.stack([apart, itself.min(axis=1), links, hand], axis=-1)


def _lines(poses: np.ndarray, held: float) -> np.ndarray:
    """The middle lines of links, hand, fingers and what is held, (n, 9, 2, 2), metres."""
    angles = np.cumsum(poses, axis=-1)
    ahead = np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
    joints = _BASE + np.cumsum(ahead[:, :3] * np.array(LENGTHS)[:, None], axis=1)
    starts = np.concatenate([np.broadcast_to(_BASE, (len(poses), 1, 2)), joints[:, :2]], axis=1)
    links = np.stack([starts, joints], axis=2)
    forward = ahead[:, 3]
    sideways = np.stack([forward[:, 1], -forward[:, 0]], axis=-1)
    parts = np.concatenate([_HAND, [[[0.0, 0.065], [0.0, held]]]])
    hand = (
        joints[:, 2, None, None]
        + parts[..., :1] * sideways[:, None, None]
        + parts[..., 1:] * forward[:, None, None]
    )
    return np.concatenate([links, hand], axis=1)


def _gaps(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances between lines, both (..., 2, 2) of ends -> (...); 0 where they cross.

    Where lines do not cross, one of the four ends is nearest to the other line.
    """
    first, second = np.moveaxis(first, (-1, -2), (0, 1)), np.moveaxis(second, (-1, -2), (0, 1))
    shape = np.broadcast_shapes(first.shape[2:], second.shape[2:])
    # From the start of a line to the ends of the other one: x and z, the ends, the lines.
    to, along = np.empty((2, 4, *shape)), np.empty((2, 4, *shape))
    np.subtract(first, second[:, :1], out=to[:, :2])
    np.subtract(second, first[:, :1], out=to[:, 2:])
    along[:, :2] = second[:, 1:] - second[:, :1]
    along[:, 2:] = first[:, 1:] - first[:, :1]
    (to_x, to_z), (x, z) = to, along
    side = x * to_z - z * to_x
    crossing = (side[0] * side[1] < 0) & (side[2] * side[3] < 0)
    part = (x * to_x + z * to_z) / (x * x + z * z)
    part = np.minimum(np.maximum(part, 0.0), 1.0)
    gaps = np.hypot(to_x - part * x, to_z - part * z)
    return np.where(crossing, 0.0, gaps.min(axis=0))
