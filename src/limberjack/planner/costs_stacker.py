"""What the planner avoids in the stacker's tasks: a tower of fewer boxes than the target is high.

A tower is built in stages: `look` decides before each planning which boxes stand where they should,
which box is next and where it goes. The next box is fetched from above, lifted over its place and
let down; when the last one stands, the hand goes away.
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.arm import (
    ARM,
    CLOSED,
    LONGEST,
    OPEN,
    OPEN_ANGLE,
    PLANE,
    PLAY,
    SETTINGS,
    TIP_ASIDE,
    TIP_REACH,
    closing,
    in_hand,
    loose,
    near,
    outward_speed,
    path,
)
from limberjack.planner.cost import Cost
from limberjack.planner.planar_ik import (
    GRASP,
    angle_of,
    direction,
    hand_places,
    hand_poses,
    hand_route,
)
from limberjack.utils import arrays

__all__ = ["Stack"]

_LOOSE = 9.0  # what a box costs that is not held: more than any that is
_HALF = 0.022  # metres; half a box

# The grip.
_GRIP_ANGLE = np.radians(20.0)  # of the fingers around a box, measured
_EMPTY = np.radians(35.0)  # fingers that have closed by more than this hold nothing
_PRESS = 0.5  # control of the grasp that holds a box
_HIGH = 0.026  # metres; how far above a box's centre the grasp is: higher it slips, lower it tips
_SLIP = 0.012  # metres; by how much that may be more or less
_UNDER_HAND = 0.045  # metres; what the open fingers need below the grasp
_FREE = 0.066  # metres; from box to box, so that a finger fits between
_FROM_WALL = 0.355  # metres; a box further out than this has no room for a finger behind it

# The tower.
_PLACED = 0.006  # metres; a box nearer to its place than this stands there, till twice as far
_SUPPORT = 0.010  # metres; the same for a box that is to carry others
_RESTS = 0.1  # metres per second; what is slower may be let go
_FLAT = 0.01  # of `_turned`: 6 degrees
_OVER = 0.03  # metres; how far above its place a box is carried to it
_ALOFT = 0.13  # metres; a loose box higher than this is falling, or lies on the arm
_AWAY = 0.12  # metres; where the hand is rewarded for having gone

_SPEEDS = (0.7, 1.3, 2.2)  # metres per second, at which a way is tried
_DOWN = np.array([0.0, -1.0])
_STICKY = 0.1  # metres; by how much nearer another box must be to be taken instead


class Stack(Cost):
    """Builds a tower up to the target, and takes the hand away."""

    settings = dataclasses.replace(SETTINGS, temperature=0.03)

    def __init__(self, task: Any) -> None:
        """Takes a `stacker.Stack` task."""
        super().__init__(task)
        self._boxes: list[str] = task._boxes
        self.reset()

    def reset(self) -> None:
        """Forgets which box was next."""
        self._next: str | None = None
        self._placed: list[str] = []
        self._places: list[np.ndarray] = []
        self._place = np.zeros(3)
        self._hurdle = 0.0

    def look(self, physics: Any) -> None:
        """Decides which boxes stand, which one is next and where it goes."""
        data = physics.named.data
        target = data.site_xpos["target"]
        levels = round((float(target[2]) / _HALF - 1) / 2) + 1
        heights = [_HALF * (2 * level + 1) for level in range(levels)]
        self._places = [np.array([target[0], 0.0, height]) for height in heights]
        left, before = list(self._boxes), self._placed
        self._placed = []
        for place in self._places:
            gaps = [float(np.hypot(*(data.site_xpos[box] - place)[PLANE])) for box in left]
            nearest = int(np.argmin(gaps))
            allowed = _PLACED if place is self._places[-1] else _SUPPORT
            if not _stands(data, left[nearest], gaps[nearest], allowed, left[nearest] in before):
                self._place = place
                in_place = gaps[nearest] < 1.5 * _HALF  # no room for another one there
                self._next = left[nearest] if in_place else self._choice(data, left)
                x = float(data.site_xpos[self._next][0])
                crest = self._crest(data, x, float(place[0]), self._next)
                self._hurdle = crest + 1.5 * _HALF if crest else 0.0
                return
            self._placed.append(left.pop(nearest))
        self._next = None

    def _crest(self, data: Any, start: float, end: float, but: str | None) -> float:
        """Height of the highest box between two places, metres; 0 if there is none."""
        low, high = min(start, end) - 2.5 * _HALF, max(start, end) + 2.5 * _HALF
        places = [data.site_xpos[box] for box in self._boxes if box != but]
        tops = [float(p[2]) + _HALF for p in places if low < p[0] < high and p[2] < _ALOFT + 0.05]
        return max(tops, default=0.0)

    def _choice(self, data: Any, left: list[str]) -> str:
        """The box to take next, the easiest to fetch; the present one unless it is much worse."""

        if self._next in left and self._held(data) > 0.3:
            return str(self._next)

        def trouble(box: str) -> float:
            place = data.site_xpos[box]
            others = [data.site_xpos[other] - place for other in self._boxes if other != box]
            covered = any(abs(o[0]) < 0.04 and 0.02 < o[2] < 0.07 for o in others)
            beside = sum(abs(o[2]) < 0.03 and abs(o[0]) < 0.065 for o in others)
            aloft = place[2] > _ALOFT
            reach = max(0.0, float(np.hypot(place[0], place[2] + _HIGH - 0.4)) - 0.5)
            way = abs(float(place[0] - self._place[0]))
            return (
                way
                + 2.0 * aloft
                + 0.5 * covered
                + 0.15 * beside
                + 5.0 * reach
                - _STICKY * (box == self._next)
            )

        return min(left, key=trouble)

    def step_cost(self, physics: Any) -> np.ndarray:
        """What is missing of the tower, and of the next box's way to it, (N,)."""
        data = physics.named.data
        missing = 1.0 - self.task.get_reward(physics)
        gaps = [self._gap_in_tower(data, level) for level in range(len(self._placed))]
        cost = missing + sum(80.0 * np.maximum(gap - _PLACED, 0.0) for gap in gaps)
        cost = cost + 4.0 * self._in_the_way(data)
        hand = data.site_xpos["grasp"]
        cost = cost + 5.0 * np.maximum(0.045 - hand[..., 2], 0.0)
        if self._next is None:
            distance = arrays.norm(hand - data.site_xpos["target"])
            return cost + 5.0 * np.maximum(_AWAY - distance, 0.0)
        held, standing = self._held(data), self._standing(data)
        secure = np.maximum(held, standing)
        closed = 0.15 * (1.0 + physics.control()[..., -1])
        grasp = np.where(standing < 0.5, loose(physics, _PRESS), closed)
        carry = self._way(data) + grasp + 0.5 * (1.0 + data.site_xmat["grasp", "zz"])
        loose_boxes = [box for box in self._boxes if box not in self._placed]
        aloft = [np.maximum(data.site_xpos[box, "z"] - _ALOFT, 0.0) for box in loose_boxes]
        fetch = _LOOSE + self._fetching(data) + self._crowd(data) + 3.0 * sum(aloft)
        return cost + secure * carry + (1.0 - secure) * fetch

    def _crowd(self, data: Any) -> np.ndarray:
        """How far fingers are from fitting between the next box and those beside it, (N,)."""
        box = data.site_xpos[self._next]
        total = 20.0 * np.maximum(np.abs(box[..., 0]) - _FROM_WALL, 0.0)
        for other in self._boxes:
            if other != self._next:
                offset = np.abs(data.site_xpos[other] - box)
                level = offset[..., 2] < _HALF
                total = total + 20.0 * level * np.maximum(_FREE - offset[..., 0], 0.0)
        return total

    def _in_the_way(self, data: Any) -> np.ndarray:
        """How near other loose boxes are to the tower's place, (N,)."""
        total = 0.0 * data.site_xpos["target"][..., 0]
        for box in self._boxes:
            if box != self._next and box not in self._placed:
                place = data.site_xpos[box]
                beside = np.abs(place[..., 0] - self._places[0][0])
                total = total + (place[..., 2] < _ALOFT) * np.maximum(_FREE - beside, 0.0)
        return total

    def _gap_in_tower(self, data: Any, level: int) -> np.ndarray:
        """How far a box that stands has moved from its place, (N,)."""
        gap = data.site_xpos[self._placed[level]] - self._places[level]
        return arrays.norm(gap[..., PLANE]) + 0.05 * _turned(data, self._placed[level])

    def _held(self, data: Any) -> np.ndarray:
        """How well the hand holds the next box, 0 to 1, (N,)."""
        ahead, aside = in_hand(data, data.site_xpos[self._next])
        turned = closing(data)
        empty = np.clip((turned - _EMPTY) / np.radians(10.0), 0.0, 1.0)
        closed = np.clip(turned / (_GRIP_ANGLE - OPEN_ANGLE), 0.0, 1.0) * (1.0 - empty)
        slip = np.maximum(np.abs(ahead - _HIGH) - _SLIP, 0.0)
        firm = near(np.hypot(slip, aside), 0.012) * near(self._askew(data), 0.1) * closed
        return np.minimum(PLAY * firm, 1.0)

    def _askew(self, data: Any) -> Any:
        """0 for a hand whose fingers are parallel to the next box's sides, up to 0.25, (...)."""
        box, hand = data.xmat[self._next], data.site_xmat["grasp"]
        square = (box[..., 0] * hand[..., 0] + box[..., 6] * hand[..., 6]) ** 2
        return square * (1.0 - square)

    def _standing(self, data: Any) -> np.ndarray:
        """How surely the next box is in its place, 0 to 1, (N,)."""
        gap = (data.site_xpos[self._next] - self._place)[..., PLANE]
        return near(arrays.norm(gap), 2.0 * _PLACED)

    def _fetching(self, data: Any) -> np.ndarray:
        """How far the hand is from holding the next box from above, (N,)."""
        ahead, aside = in_hand(data, data.site_xpos[self._next])
        distance = np.hypot(ahead - _HIGH, aside)
        detour = np.maximum(np.clip(3.0 * (np.abs(aside) - 0.01), 0.0, 0.06) + _HIGH - ahead, 0.0)
        is_far = np.clip((distance - 0.02) / 0.03, 0.0, 1.0)
        early = is_far * np.clip(closing(data) / (_GRIP_ANGLE - OPEN_ANGLE), 0.0, 2.0)
        tilt = 1.0 + data.site_xmat["grasp", "zz"]
        outwards = outward_speed(data, f"{self._next}_x", str(self._next))
        turn = 0.5 * tilt + 2.0 * self._askew(data)
        return 4.0 * (distance + detour) + turn + 0.5 * early + outwards

    def _way(self, data: Any) -> np.ndarray:
        """How far the next box is from its place, by the way over the tower, (N,)."""
        offset = data.site_xpos[self._next] - self._place
        up, beside = offset[..., 2], np.abs(offset[..., 0])
        over = np.clip((beside - 0.006) / 0.02, 0.0, 1.0) * _OVER
        turned = _turned(data, str(self._next))
        gap = np.hypot(up, beside) + np.minimum(3.0 * np.maximum(over - up, 0.0), 0.2)
        low = np.maximum(self._hurdle - data.site_xpos[self._next][..., 2], 0.0)
        gap = gap + np.clip(beside / _HALF - 1.5, 0.0, 1.0) * np.minimum(8.0 * low, 0.6)
        return gap / LONGEST + 0.5 * turned + 1.0 - near(np.hypot(up, beside), 2.0 * _PLACED)

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Ways that fetch the next box, carry it, or take the hand away."""
        data = physics.named.data
        now = data.qpos[ARM]
        stay = [self._still(now, grasp) for grasp in (OPEN, _PRESS, CLOSED)]
        if self._next is None:
            ways = self._leaving(data, now, random)
        elif self._held(data) > 0.3:
            ways = self._carrying(data, now, random)
        else:
            ways = self._reaching(data, now, random)
        paths = stay + ways
        return np.array(paths)[random.permutation(len(paths))]

    def _still(self, now: np.ndarray, grasp: float) -> np.ndarray:
        return path(now, [now], self.settings.knots, [grasp])

    def _leaving(self, data: Any, now: np.ndarray, random: np.random.Generator) -> list[np.ndarray]:
        """Back along the fingers, at once or when they have opened."""
        hand, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
        ways: list[np.ndarray] = []
        for back in (0.06, 0.15):
            behind = hand - back * direction(angle)
            for pose in hand_poses(random, behind, GRASP, now, 2, angle, 0.2):
                ways.extend(self._ways(now, pose, 0.0, GRASP, 0.0, [OPEN, OPEN]))
        return ways + _later(ways)

    def _reaching(
        self, data: Any, now: np.ndarray, random: np.random.Generator
    ) -> list[np.ndarray]:
        """From above onto the next box, then closing."""
        down = angle_of(_DOWN)
        box = data.site_xpos[self._next][PLANE]
        hand = data.site_xpos["grasp"][PLANE]
        crest = self._crest(data, float(hand[0]), float(box[0]), None)
        tips = data.site_xpos["pinch"]
        others = [data.site_xpos[name] - tips for name in self._boxes if name != self._next]
        back = 0.07 if any(np.hypot(*o[PLANE]) < 2.0 * _HALF for o in others) else 0.0
        ways: list[np.ndarray] = []
        cruise = crest + _UNDER_HAND
        for tilt in (0.1, 0.4):
            for pose in hand_poses(random, box - _HIGH * _DOWN, GRASP, now, 3, down, tilt):
                ways.extend(self._ways(now, pose, cruise, GRASP, 0.0, [OPEN, CLOSED], back))
        for pose in hand_poses(random, box - 0.09 * _DOWN, GRASP, now, 6, down, 0.4):
            ways.append(path(now, [pose], self.settings.knots, [OPEN], 2))
        if back:
            ways.extend(_later(ways))
        return self._parting(data, now, random) + ways

    def _parting(self, data: Any, now: np.ndarray, random: np.random.Generator) -> list[np.ndarray]:
        """A fingertip turns the next box over, away from one that fingers cannot pass."""
        box = data.site_xpos[self._next]
        others = [data.site_xpos[other] - box for other in self._boxes if other != self._next]
        near_by = [float(o[0]) for o in others if abs(o[2]) < _HALF and abs(o[0]) < _FREE]
        if not near_by or np.sign(min(near_by)) != np.sign(max(near_by)):
            return []
        outwards = -np.sign(near_by[0])
        steps = np.array([[0.01, 0.05], [0.01, 0.02], [0.05, 0.01], [0.1, 0.0]])
        points = box[PLANE] + steps * [outwards, 1.0]
        aside = outwards * TIP_ASIDE
        ways: list[np.ndarray] = []
        for pose in hand_poses(random, points[0], TIP_REACH, now, 4, angle_of(_DOWN), 0.4, aside):
            route = hand_route(pose, pose, points, np.zeros(4), TIP_REACH, aside)
            if np.isfinite(route).all():
                count = self.settings.knots
                ways.extend(path(now, list(route[first:]), count, [OPEN]) for first in range(3))
        return ways

    def _carrying(
        self, data: Any, now: np.ndarray, random: np.random.Generator
    ) -> list[np.ndarray]:
        """Up, over the place of the next box and down, so that the box lies flat there."""
        ahead, aside = (float(part) for part in in_hand(data, data.site_xpos[self._next]))
        turn = float(data.qpos[f"{self._next}_y"].item())
        flat = float(now.sum()) + (turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
        forward = GRASP + ahead
        ways: list[np.ndarray] = []
        cruise = max(self._hurdle, float(self._place[2]) + _OVER)
        for up, tilt, count in ((0.0, 0.05, 3), (0.0, 0.4, 3), (_OVER, 0.4, 2)):
            goal = self._place[PLANE] - up * _DOWN
            grasp = [_PRESS, _PRESS if up else OPEN]
            for pose in hand_poses(random, goal, forward, now, count, flat, tilt, aside):
                ways.extend(self._ways(now, pose, cruise, forward, aside, grasp))
        return ways

    def _ways(
        self,
        now: np.ndarray,
        pose: np.ndarray,
        cruise: float,
        forward: float,
        lateral: float,
        grasp: list[float],
        back: float = 0.0,
    ) -> list[np.ndarray]:
        """Paths up to a height, over the end and down to it, (knots, 5) each.

        Args:
          now, pose: the arm's joints at the start and the end, (4,).
          cruise: the least height of what is moved, metres.
          forward, lateral: where in the hand that is.
          grasp: its control on the way and at the end.
          back: how far to back off first, along the hand, metres.
        """
        start, end = hand_places(np.array([now, pose]), forward, lateral)
        stations = np.array([start, start - back * direction(now.sum()), end, end])
        stations[1:3, 1] = np.maximum(stations[1:3, 1], cruise)
        lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(stations, axis=0).T)))
        settings, ways = self.settings, []
        times = settings.horizon / (settings.knots - 1) * np.arange(settings.knots)
        for speed in _SPEEDS:
            gone = speed * times
            gone[1:] -= max(gone[1] - lengths[1], 0.0) * (lengths[1] > _HALF / 2)
            gone = np.minimum(gone, lengths[-1])
            points = np.column_stack([np.interp(gone, lengths, part) for part in stations.T])
            parts = np.clip((gone - lengths[1]) / max(lengths[3] - lengths[1], 1e-6), 0.0, 1.0)
            joints = hand_route(now, pose, points, parts, forward, lateral)
            if np.isfinite(joints).all():
                hold = np.where(gone < lengths[-1], grasp[0], grasp[1])
                ways.append(np.column_stack([joints, hold]))
        straight = path(now, [pose], settings.knots, grasp, 2)
        straight[:, 4] = np.where(np.arange(settings.knots) < 3, grasp[0], grasp[1])
        return [*ways, straight]


def _later(ways: list[np.ndarray]) -> list[np.ndarray]:
    """The same paths one knot later, the hand opening first."""
    delayed = [np.vstack([way[:1], way[:-1]]) for way in ways]
    for way in delayed:
        way[0, -1] = OPEN
    return delayed


def _stands(data: Any, box: str, gap: float, allowed: float, stood: bool) -> bool:
    """Whether a box rests where it should; one that stood there may have moved a little."""
    if stood:
        return gap < 2.0 * allowed
    speed = np.abs(data.qvel[[f"{box}_x", f"{box}_z"]]).max()
    return bool(gap < allowed and speed < _RESTS and _turned(data, box) < _FLAT)


def _turned(data: Any, box: str) -> Any:
    """0 for a box that lies flat on any of its sides, 0.25 for one on an edge, (...)."""
    square = data.xmat[box, "xx"] ** 2
    return square * (1.0 - square)
