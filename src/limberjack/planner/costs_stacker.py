"""What the planner avoids in the stacker's tasks: a tower of fewer boxes than the target is high.

A tower is built in stages: `look` decides before each planning which boxes stand where they should,
which box is next and where it goes. The next box is fetched from above, lifted over its place and
let down; when the last one stands, the hand goes away.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm import (
    ARM,
    CLOSED,
    OPEN,
    OPEN_ANGLE,
    PLANE,
    SETTINGS,
    closing,
    in_hand,
    lifts,
    loose,
    near,
    outward_speed,
    path,
)
from limberjack.planner.cost import Cost
from limberjack.planner.planar_ik import GRASP, angle_of, hand_poses
from limberjack.utils import arrays

__all__ = ["Stack"]

_LOOSE = 6.0  # what a box costs that is not held: more than any that is
_LONGEST = 0.25  # metres; what scales distances: about half of the arm's reach
_PLAY = 1.3  # a little play in the hand is no reason to stand still
_GRIP_ANGLE = np.radians(20.0)  # of the fingers around a box, measured
_PRESS = 0.3  # control of the grasp that holds a box
_HIGH = 0.02  # metres; how far above a box's centre it is held, so that the fingers miss the floor
_PLACED = 0.006  # metres; a box nearer to its place than this stands there, till twice as far
_OVER = 0.03  # metres; how far above its place a box is carried to it
_AWAY = 0.12  # metres; where the hand is rewarded for having gone
_ALOFT = 0.3  # metres; a box as high as this is falling, or lies on the arm
_DOWN = np.array([0.0, -1.0])
_STICKY = 0.1  # metres; by how much nearer another box must be to be taken instead


class Stack(Cost):
    """Builds a tower up to the target, and takes the hand away."""

    settings = SETTINGS

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

    def look(self, physics: Any) -> None:
        """Decides which boxes stand, which one is next and where it goes."""
        data = physics.named.data
        half = float(physics.named.model.geom_size["target", "x"])
        target = data.site_xpos["target"]
        levels = round((float(target[2]) / half - 1) / 2) + 1
        heights = [half * (2 * level + 1) for level in range(levels)]
        self._places = [np.array([target[0], 0.0, height]) for height in heights]
        left, before = list(self._boxes), self._placed
        self._placed = []
        for place in self._places:
            gaps = [np.hypot(*(data.site_xpos[box] - place)[PLANE]) for box in left]
            nearest = int(np.argmin(gaps))
            stood = left[nearest] in before
            if gaps[nearest] > (2.0 * _PLACED if stood else _PLACED):
                self._place = place
                self._next = self._choice(data, left)
                return
            self._placed.append(left.pop(nearest))
        self._next = None

    def _choice(self, data: Any, left: list[str]) -> str:
        """The box to take next, the easiest to fetch; the present one unless it is much worse."""

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
                + 0.1 * beside
                + 5.0 * reach
                - _STICKY * (box == self._next)
            )

        return min(left, key=trouble)

    def step_cost(self, physics: Any) -> np.ndarray:
        """What is missing of the tower, and of the next box's way to it, (N,)."""
        data = physics.named.data
        missing = 1.0 - self.task.get_reward(physics)
        gaps = [self._gap_in_tower(data, level) for level in range(len(self._placed))]
        cost = missing + sum(20.0 * np.maximum(gap - _PLACED, 0.0) for gap in gaps)
        hand = data.site_xpos["grasp"]
        cost = cost + 5.0 * np.maximum(0.045 - hand[..., 2], 0.0)
        if self._next is None:
            distance = arrays.norm(hand - data.site_xpos["target"])
            return cost + 5.0 * np.maximum(_AWAY - distance, 0.0)
        held, standing = self._held(data), self._standing(data)
        secure = np.maximum(held, standing)
        closed = 0.15 * (1.0 + physics.control()[..., -1])
        grasp = np.where(standing < 0.5, loose(physics, _PRESS), closed)
        carry = self._way(data) + grasp
        return cost + secure * carry + (1.0 - secure) * (_LOOSE + self._fetching(data))

    def _gap_in_tower(self, data: Any, level: int) -> np.ndarray:
        """How far a box that stands has moved from its place, (N,)."""
        gap = data.site_xpos[self._placed[level]] - self._places[level]
        return arrays.norm(gap[..., PLANE])

    def _held(self, data: Any) -> np.ndarray:
        """How well the hand holds the next box, 0 to 1, (N,)."""
        ahead, aside = in_hand(data, data.site_xpos[self._next])
        closed = np.clip(closing(data) / (_GRIP_ANGLE - OPEN_ANGLE), 0.0, 1.0)
        return np.minimum(_PLAY * near(np.hypot(ahead - _HIGH, aside), 0.016) * closed, 1.0)

    def _standing(self, data: Any) -> np.ndarray:
        """How surely the next box is in its place, 0 to 1, (N,)."""
        gap = (data.site_xpos[self._next] - self._place)[..., PLANE]
        return near(arrays.norm(gap), 2.0 * _PLACED)

    def _fetching(self, data: Any) -> np.ndarray:
        """How far the hand is from holding the next box from above, (N,)."""
        ahead, aside = in_hand(data, data.site_xpos[self._next])
        distance = np.hypot(ahead - _HIGH, aside)
        detour = np.maximum(np.clip(1.5 * (np.abs(aside) - 0.012), 0.0, 0.08) + _HIGH - ahead, 0.0)
        is_far = np.clip((distance - 0.02) / 0.03, 0.0, 1.0)
        shut = np.clip(closing(data) / (_GRIP_ANGLE - OPEN_ANGLE), 0.0, 2.0)
        tilt = 1.0 + data.site_xmat["grasp", "zz"]
        outwards = outward_speed(data, f"{self._next}_x", str(self._next))
        return 4.0 * (distance + detour) + 0.3 * tilt + 0.5 * is_far * shut + outwards

    def _way(self, data: Any) -> np.ndarray:
        """How far the next box is from its place, by the way over the tower, (N,)."""
        offset = data.site_xpos[self._next] - self._place
        up, beside = offset[..., 2], np.abs(offset[..., 0])
        over = np.clip((beside - 0.006) / 0.02, 0.0, 1.0) * _OVER
        cosine = data.xmat[self._next, "xx"] ** 2
        turned = cosine * (1.0 - cosine)  # 0 for a box that lies flat on any side
        gap = np.hypot(up, beside) + 3.0 * np.maximum(over - up, 0.0)
        return gap / _LONGEST + 0.5 * turned + 1.0 - near(np.hypot(up, beside), 2.0 * _PLACED)

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Straight joint paths that fetch the next box, carry it, or take the hand away."""
        data = physics.named.data
        now = data.qpos[ARM]
        count = self.settings.knots
        down = angle_of(_DOWN)

        def poses(place: np.ndarray, up: float, n: int) -> np.ndarray:
            above = place[PLANE] - up * _DOWN
            return hand_poses(random, above, GRASP, now, n, down, 0.5)

        paths = [path(now, [now], count, [OPEN]), path(now, [now], count, [_PRESS])]
        if self._next is None:
            for pose in poses(data.site_xpos["target"], 0.15, 8):
                paths.append(path(now, [pose], count, [OPEN], 2))
        elif self._held(data) > 0.3:
            for up in (_HIGH, _HIGH + _OVER):
                for pose in poses(self._place, up, 6):
                    paths.extend(path(now, [pose], count, [_PRESS], slow) for slow in (1, 2, 4))
            hand = data.site_xpos["grasp"][PLANE]
            paths.extend(lifts(random, hand, float(now.sum()), now, count, _PRESS))
        else:
            box = data.site_xpos[self._next]
            for pose in poses(box, _HIGH, 6):
                paths.append(path(now, [pose], count, [OPEN, OPEN, OPEN, CLOSED, CLOSED], 2))
                paths.append(path(now, [pose], count, [OPEN, OPEN, OPEN, OPEN, CLOSED], 4))
            for pose in poses(box, 0.09, 8):
                paths.append(path(now, [pose], count, [OPEN], 2))
        return np.array(paths)[random.permutation(len(paths))]
