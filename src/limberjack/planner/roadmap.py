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

__all__ = ["Obstacle", "Way", "clearance", "draw_map", "find_way"]

_BASE = BASE_HEIGHT * 1j  # x + z i, metres
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

# Both ends of the middle lines of hand and fingers in the hand's frame: aside + ahead i, metres.
_HAND = np.array(
    [
        [0.0j, 0.03j, 0.03j, 0.045j - 0.034, 0.045j + 0.034],
        [0.03j, 0.045j - 0.034, 0.045j + 0.034, 0.098j - 0.034, 0.098j + 0.034],
    ]
)
_RADII = np.array([0.02, 0.017, 0.014, 0.011, 0.008, 0.008, 0.01, 0.01, 0.005])
# Lines that keep clear of each other.
_FIRST, _SECOND = np.array([0, 0, 0, 0, 0, 1, 1, 1, 1]), np.array([2, 3, 6, 7, 8, 3, 6, 7, 8])


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
        aside = np.zeros((len(joints), len(poses)))
        for joint in range(4):  # quicker than a sum over so short an axis
            aside += np.abs(joints[:, joint, None] - poses[:, joint])
        return aside


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
        near = _distance(nodes, poses[goal]).argpartition(_AT_ENDS)[:_AT_ENDS]
        for node in near[usable[near]].tolist():
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


def draw_map() -> None:
    """Draws the map, if it has not been drawn yet, which takes a part of a second."""
    _map()


def _nearest(pose: np.ndarray, others: np.ndarray, count: int) -> list[int]:
    """The nearest of poses (n, 4) to one, nearest first."""
    far = _distance(others, pose)
    near = far.argpartition(count)[:count]
    return near[far[near].argsort(kind="stable")].tolist()


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
        return self._is_free(poses, self._clearance(poses))

    def _is_free(self, poses: np.ndarray, gaps: np.ndarray) -> np.ndarray:
        within = np.all(np.abs(poses[:, 1:]) <= LIMITS + 0.05, axis=-1)
        return within & np.all(gaps > self._allowed(poses), axis=-1)

    def is_way_free(self, begin: np.ndarray, way: np.ndarray) -> bool:
        """Whether an arm can go straight on from a pose, (4,) each."""
        count = int(np.ceil(np.abs(way).max() / _STEP))
        poses = begin + np.linspace(0.0, 1.0, 1 + count)[1:, None] * way
        gaps = self._clearance(poses)
        if not self._is_free(poses, gaps).all():
            return False
        # From one pose to the next a hand far from the base would jump over a wall.
        near = gaps[:, 0] < _NEAR
        if not near.any():
            return True
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
    parts, others = lines.shape[-1], len(obstacle.ends)
    ends = (obstacle.ends[..., 0] + 1j * obstacle.ends[..., 1]).T[:, None]
    beside = np.broadcast_to(np.tile(ends, parts), (2, len(poses), parts * others))
    # Each part beside each of the obstacle's lines, then the arm's parts beside each other.
    first = np.concatenate([lines.repeat(others, axis=-1), lines[..., _FIRST]], axis=-1)
    second = np.concatenate([beside, lines[..., _SECOND]], axis=-1)
    radii = (_RADII[:, None] + obstacle.radii).ravel(), _RADII[_FIRST] + _RADII[_SECOND]
    gaps = _gaps(first, second) - np.concatenate(radii)
    x, z = np.real(lines[..., 1:]), np.imag(lines[..., 1:])
    wall = np.minimum(z, (z + WALL - np.abs(x)) / np.sqrt(2)).min(axis=0) - _RADII[1:]
    found = np.empty((len(poses), 4))
    found[:, 0] = gaps[:, : parts * others].min(axis=1, initial=np.inf)  # there may be no obstacle
    found[:, 1] = gaps[:, parts * others :].min(axis=1)
    found[:, 2], found[:, 3] = wall[:, :_LINKS].min(axis=1), wall[:, _LINKS:].min(axis=1)
    return found


# In what follows, places are complex numbers, x + z i, in metres.


def _lines(poses: np.ndarray, held: float) -> np.ndarray:
    """Both ends of the middle lines of links, hand, fingers and what is held, (2, n, 9)."""
    sideways = np.exp(1j * poses.cumsum(axis=-1))
    joints = _BASE + (1j * sideways[:, :3] * LENGTHS).cumsum(axis=1)
    lines: np.ndarray = np.empty((2, len(poses), 3 + _HAND.shape[1] + 1), complex)
    lines[0, :, 0], lines[0, :, 1:3], lines[1, :, :3] = _BASE, joints[:, :2], joints
    lines[..., 3:-1] = joints[:, 2:] + _HAND[:, None] * sideways[:, 3:]
    lines[..., -1] = joints[:, 2] + np.array([[0.065j], [held * 1j]]) * sideways[:, 3]
    return lines


def _gaps(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances between lines, both (2, ...) of ends -> (...); 0 where they cross.

    Where lines do not cross, one of the four ends is nearest to the other line.
    """
    # From the start of a line to the ends of the other one.
    to: np.ndarray = np.empty((4, *first.shape[1:]), complex)
    along = np.empty_like(to)
    np.subtract(first, second[0], out=to[:2])
    np.subtract(second, first[0], out=to[2:])
    along[:2], along[2:] = second[1] - second[0], first[1] - first[0]
    turned = to * along.conj()
    side = np.imag(turned)
    crossing = (side[0] * side[1] < 0) & (side[2] * side[3] < 0)
    part = np.real(turned) / _squared(along)
    off = to - np.minimum(np.maximum(part, 0.0), 1.0) * along
    gaps = np.sqrt(_squared(off).min(axis=0))
    gaps[crossing] = 0.0
    return gaps


def _squared(vectors: np.ndarray) -> np.ndarray:
    """The squares of complex numbers' lengths."""
    return np.real(vectors) ** 2 + np.imag(vectors) ** 2
