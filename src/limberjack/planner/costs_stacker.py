"""What the planner avoids in the stacker's tasks: a tower of fewer boxes than the target is high.

A tower is built in stages: `look` decides before each planning which boxes stand where they should,
which box is next and where it goes. The next box is fetched from above, lifted over its place and
let down; when the last one stands, the hand goes away. Till all boxes have fallen the arm dodges.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from limberjack.planner.arm import (
    ARM,
    CLOSED,
    LONGEST,
    OPEN,
    PLANE,
    SETTINGS,
    Course,
    closing,
    in_hand,
    near,
    outward_speed,
    paths,
)
from limberjack.planner.arm_ways import later, leaving, turning_over, ways_over
from limberjack.planner.box_grip import HIGH, PRESS, fetching, grip_of, how_held, ready
from limberjack.planner.boxes import FLAT, HALF, PASSES, crest, haste, lies_too_low, stands, turned
from limberjack.planner.cost import Cost
from limberjack.planner.planar_ik import GRASP, angle_of, hand_poses_each
from limberjack.planner.unsticking import Patience, refuge, shelter, ways_to
from limberjack.utils import arrays

__all__ = ["Stack"]

_LOOSE = 10.0  # what a box costs that is not held: more than any that is

# The hand and a box.
_HAS, _LOST = 0.7, 0.3  # of how well a box is held: from when on the hand has it, till when
_THERE = 0.02  # metres; a hand that is nearer to its place may close
_UNDER_HAND = 0.045  # metres; what the open fingers need below the grasp
_FREE = 0.066  # metres; from box to box, so that a finger fits between
_FREE_OF_TOWER = 0.08  # metres; the same from a tower, so that the hand fits
_AT_WALL = 0.33  # metres; further out than this the hand does not reach the floor pointing down
_FROM_WALL = 0.355  # metres; a box further out than this has no room for a finger behind it

# The tower.
_PLACED = 0.006  # metres; a box nearer to its place than this stands there, till twice as far
_SUPPORT = 0.010  # metres; the same for a box that is to carry others
_LEANS = 0.08  # of `turned`: 17 degrees
_DROP = 0.008  # metres; a box may be let go so high above its place
_NARROW = 0.3  # how wide plans are varied that carry a box: wide ones jerk it
_BEFORE = 0.13  # metres before a tower's middle, where what is carried to it has risen
_APART = 0.02  # metres further away it goes there first
_RAISED = 0.06  # metres; at least so high, off the floor
_OVER = 0.03  # metres; how far above its place a box is carried to it
_LYING = 0.03  # metres; a box higher than this does not lie on the floor
_LEANING = 0.06  # metres; one higher than this that is not flat leans on the arm
_FALLEN = 0.4  # seconds; till then boxes fall that are high above the floor at the start
_ALOFT = 0.13  # metres; a loose box higher than this is falling, or lies on the arm
_AWAY = 0.12  # metres; where the hand is rewarded for having gone

_DOWN = np.array([0.0, -1.0])
_STICKY = 0.1  # metres; by how much nearer another box must be to be taken instead
_SHUNNED = 1.0  # metres; the same for a box that has been tried in vain

# What is done where nothing becomes better; numbers of plannings.
_PATIENCE = 20  # till then 0.6 s
_NEARER = 0.9  # of a distance: what is no nearer is no better
_BACKING = 12  # as long the hand goes away
_CAUGHT = 14  # a box that is aloft for longer lies on the arm: none falls so long


class Stack(Cost):
    """Builds a tower up to the target, and takes the hand away."""

    settings = dataclasses.replace(
        SETTINGS,
        samples=36,
        horizon=0.45,
        # At each planning anew, a target is reached no sooner than the next knot.
        knots=9,
        temperature=0.1,
        armature=1e-3,
        flowing=True,
        cost_interval=3,
        proposal_interval=2,
        servos=True,
        rest=True,
    )

    def __init__(self, task: Any) -> None:
        """Takes a `stacker.Stack` task."""
        super().__init__(task)
        self._boxes: list[str] = task._boxes
        if len(self._boxes) > 2:  # each takes time
            self.settings = dataclasses.replace(self.settings, samples=32)
        self._patience = Patience(_PATIENCE, _NEARER)
        self.reset()

    def reset(self) -> None:
        """Forgets which box was next."""
        self._next: str | None = None
        self._placed: list[str] = []
        self._others: list[str] = list(self._boxes)  # but the next, those that stand first
        self._places: list[np.ndarray] = []
        self._place = np.zeros(3)
        self._shunned: str | None = None
        self._firm = False  # the hand has the next box
        self._backing = self._caught = self._tries = 0
        self._falling = False
        self._refuge = np.zeros(4)
        self._patience.reset()

    def look(self, physics: Any) -> None:
        """Decides which boxes stand, which one is next and where it goes."""
        data = physics.named.data
        before = self._next
        waiting = self._decide(data)
        self._others = self._placed + waiting
        self._backing = max(self._backing - 1, 0)
        if self._next != before or self._next is None:
            self._firm = False
            self.breadth = 1.0
        if self._next is None:
            self._backing = self._caught = 0
            self._falling = False
            self._patience.reset()
            return
        self._firm = self._held(data) > (_LOST if self._firm else _HAS)
        self.breadth = _NARROW if self._firm else 1.0
        loose = waiting if self._firm else [*waiting, self._next]
        self._caught = self._caught + 1 if self._is_caught(data, loose) else 0
        falling = physics.time() < _FALLEN and bool((data.site_xpos[loose][:, 2] > _ALOFT).any())
        if falling and not self._falling:
            self._refuge = shelter(data)
        self._falling = falling
        if not falling:
            self._await(data)

    def stage(self) -> Any:
        """What is being done, and with which box."""
        away = self._backing > 0, self._falling, self._caught > _CAUGHT
        return self._next, self._firm, len(self._placed), away

    def _await(self, data: Any) -> None:
        """Sends the hand away if the next box has not come nearer for long, nor the hand to it."""
        box, hand = data.site_xpos[self._next], data.site_xpos["grasp"]
        lack = float(np.hypot(*(box - (self._place if self._firm else hand))[PLANE]))
        if self._patience.is_out((self._next, self._firm, len(self._placed)), lack):
            self._shunned, self._backing = self._next, _BACKING
            self._refuge = refuge(data, box, self._tries)
            self._tries += 1

    def _is_caught(self, data: Any, loose: list[str]) -> bool:
        """Whether a box lies on the arm."""
        for box in loose:
            place = data.site_xpos[box]
            beside = abs(float(place[0] - self._place[0]))
            leans = place[2] > _LEANING and turned(data, box) > FLAT
            if (leans or place[2] > _ALOFT) and beside > _FREE:
                return True
        return False

    def _decide(self, data: Any) -> list[str]:
        """Which boxes stand, which one is next and where it goes; returns the others."""
        target = data.site_xpos["target"]
        levels = round((float(target[2]) / HALF - 1) / 2) + 1
        heights = [HALF * (2 * level + 1) for level in range(levels)]
        self._places = [np.array([target[0], 0.0, height]) for height in heights]
        left, before, self._placed = list(self._boxes), self._placed, []
        boxes = {box: data.site_xpos[box].tolist() for box in left}
        for place in self._places:
            x, _, z = place.tolist()
            gaps = [math.hypot(boxes[box][0] - x, boxes[box][2] - z) for box in left]
            nearest = gaps.index(min(gaps))
            allowed = _PLACED if place is self._places[-1] else _SUPPORT
            if not stands(data, left[nearest], gaps[nearest], allowed, left[nearest] in before):
                self._place = place
                in_place = gaps[nearest] < 1.5 * HALF  # no room for another one there
                self._next = left[nearest] if in_place else self._choice(data, left)
                return [box for box in left if box != self._next]
            self._placed.append(left.pop(nearest))
        self._next = None
        return left

    def _choice(self, data: Any, left: list[str]) -> str:
        """The box to take next, the easiest to fetch; the present one unless it is much worse."""
        if self._next in left and self._held(data) > _LOST:
            return str(self._next)

        places = {box: data.site_xpos[box].tolist() for box in self._boxes}

        def trouble(box: str) -> float:
            x, _, z = places[box]
            others = [(o[0] - x, o[2] - z) for name, o in places.items() if name != box]
            covered = any(abs(aside) < 0.04 and 0.02 < up < 0.07 for aside, up in others)
            beside = sum(abs(up) < 0.03 and abs(aside) < _FREE for aside, up in others)
            cornered = max(0.0, abs(x) - _FROM_WALL)
            way = abs(x - float(self._place[0]))
            return (
                way
                + 2.0 * (z > _ALOFT)
                + 0.5 * covered
                + 0.4 * beside
                + 15.0 * cornered
                - _STICKY * (box == self._next)
                + _SHUNNED * (box == self._shunned)
            )

        return min(left, key=trouble)

    def step_cost(self, physics: Any) -> np.ndarray:
        """What is missing of the tower, and of the next box's way to it, (N,)."""
        data = physics.named.data
        others = data.site_xpos[self._others][..., ::2]  # x and z
        stood = len(self._placed)
        placed, waiting = others[..., :stood, :], others[..., stood:, :]
        cost = 1.0 - self.task.get_reward(physics) + self._shaken(data, placed)
        cost += 4.0 * self._in_the_way(waiting)
        hand = data.site_xpos["grasp"]
        cost += 5.0 * np.maximum(0.045 - hand[..., 2], 0.0)
        if self._next is None:
            distance = arrays.norm(hand - data.site_xpos["target"])
            return cost + 5.0 * np.maximum(_AWAY - distance, 0.0)
        box = data.site_xpos[self._next][..., ::2]
        if self._falling:
            return cost + self._dodging(data)
        if self._backing:
            return cost + np.abs(data.qpos[ARM] - self._refuge).sum(axis=-1)
        if self._caught > _CAUGHT:
            height = np.maximum(waiting[..., 1] - _LYING, 0.0).sum(axis=-1)
            return cost + 5.0 * (height + np.maximum(box[..., 1] - _LYING, 0.0))
        offset = box - self._place[PLANE]
        above = np.maximum(offset[..., 1] - _DROP, np.maximum(-offset[..., 1], 0.0))
        standing = near(np.hypot(offset[..., 0], above), 2.0 * _PLACED)
        grip = grip_of(data, str(self._next))
        # One that leans on a finger at its place does not stand there.
        upright = 1.0 if self._firm else near(turned(data, str(self._next)), _LEANS)
        secure = np.maximum(how_held(grip, self._firm), standing * upright)
        moved = self._moved(data, box)
        carry = 1.0 - standing + self._grasp(physics, standing) + grip.tilt
        # Who has not got it yet does not lift it.
        carry += (
            self._way(data, box, others) + haste(data, str(self._next)) if self._firm else moved
        )
        fetch = _LOOSE + fetching(grip) + moved + self._pushed(data, waiting)
        fetch += self._crowd(box, others) + self._over_tower(hand)
        return cost + secure * carry + (1.0 - secure) * fetch

    def _dodging(self, data: Any) -> np.ndarray:
        """What hinders boxes from falling, and how far the arm is from its shelter, (N,)."""
        heights = np.maximum(data.site_xpos[self._boxes][..., 2] - _LYING, 0.0)
        speeds = np.abs(data.qvel[[f"{box}_x" for box in self._boxes]])
        away = np.abs(data.qpos[ARM] - self._refuge).sum(axis=-1)
        return (5.0 * heights + speeds).sum(axis=-1) + 0.1 * away

    def _moved(self, data: Any, box: np.ndarray) -> np.ndarray:
        """How the next box moves, (N,): who pushes a loose one, or lifts its edge, loses it."""
        velocity = data.qvel[[f"{self._next}_x", f"{self._next}_z"]]
        speed = np.hypot(velocity[..., 0], velocity[..., 1])
        return np.minimum(speed, 1.0) + 10.0 * np.maximum(box[..., 1] - _LYING, 0.0)

    def _pushed(self, data: Any, waiting: np.ndarray) -> np.ndarray:
        """How much loose boxes lie on the arm, are pushed, or go outwards, (N,)."""
        outwards = outward_speed(data, f"{self._next}_x", str(self._next))
        loose = self._others[len(self._placed) :]
        if not loose:
            return outwards
        speeds = np.minimum(np.abs(data.qvel[[f"{box}_x" for box in loose]]), 1.0)
        aloft = np.clip((waiting[..., 1] - _ALOFT) / HALF, 0.0, 1.0)
        return outwards + (aloft + speeds).sum(axis=-1)

    def _grasp(self, physics: Any, standing: np.ndarray) -> np.ndarray:
        """How wrong the control of the grasp is: it holds, or lets go what stands, (N,)."""
        press = physics.named.data.ctrl["grasp"]
        return np.where(standing < 0.5, 0.3 * np.abs(press - PRESS), 0.15 * (1.0 + press))

    def _crowd(self, box: np.ndarray, others: np.ndarray) -> np.ndarray:
        """How far fingers are from fitting between the next box and those beside it, (N,)."""
        offsets = np.abs(others - box[..., None, :])
        room = (offsets[..., 1] < HALF) * np.maximum(self._free() - offsets[..., 0], 0.0)
        return 100.0 * (room.sum(axis=-1) + np.maximum(np.abs(box[..., 0]) - _FROM_WALL, 0.0))

    def _over_tower(self, hand: np.ndarray) -> Any:
        """How far the hand is from clear of the tower, (N,): it must go up to get past."""
        if not self._placed:
            return 0.0
        top = float(self._place[2]) - HALF
        beside = np.abs(hand[..., 0] - self._place[0])
        low = np.maximum(top + _UNDER_HAND - hand[..., 2], 0.0)
        return 8.0 * np.clip((_FREE_OF_TOWER - beside) / 0.03, 0.0, 1.0) * low

    def _free(self) -> float:
        """How far from other boxes the next one can be taken, metres."""
        return _FREE_OF_TOWER if len(self._placed) > 1 else _FREE

    def _in_the_way(self, waiting: np.ndarray) -> np.ndarray:
        """How near other loose boxes are to the tower's place, (N,)."""
        beside = np.abs(waiting[..., 0] - self._places[0][0])
        return ((waiting[..., 1] < _ALOFT) * np.maximum(_FREE - beside, 0.0)).sum(axis=-1)

    def _shaken(self, data: Any, placed: np.ndarray) -> Any:
        """How far boxes that stand have moved from their places, (N,)."""
        if not self._placed:
            return 0.0
        moved = placed - np.array(self._places[: len(self._placed)])[:, PLANE]
        gaps = np.hypot(moved[..., 0], moved[..., 1]) + 0.05 * turned(data, self._placed)
        return 80.0 * np.maximum(gaps - _PLACED, 0.0).sum(axis=-1)

    def _held(self, data: Any) -> float:
        """How well the hand holds the next box now, 0 to 1."""
        return float(how_held(grip_of(data, str(self._next)), self._firm))

    def _way(self, data: Any, box: np.ndarray, others: np.ndarray) -> np.ndarray:
        """How far the next box is from its place, by the way over the tower, (N,)."""
        gap = arrays.norm(box - self._place[PLANE])
        up, beside = box[..., 1] - self._place[2], np.abs(box[..., 0] - self._place[0])
        over = np.clip((beside - 0.006) / 0.02, 0.0, 1.0) * _OVER
        way = gap + np.minimum(8.0 * np.maximum(over - up, 0.0), 0.25)
        low = np.minimum(12.0 * lies_too_low(box, others), 0.6)
        way += np.clip(beside / HALF - 1.5, 0.0, 1.0) * low
        return way / LONGEST + 0.3 * np.sqrt(turned(data, str(self._next)))

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Ways that fetch the next box, carry it, or take the hand away."""
        data = physics.named.data
        now = data.qpos[ARM]
        if self._backing or self._falling or self._caught > _CAUGHT:
            ways = ways_to(self._refuge, self.settings, now, random)
        elif self._next is None:
            ways = leaving(self.settings, data, random)
        elif self._firm:
            ways = self._carrying(data, now, random)
        else:
            ways = self._reaching(data, now, random)
        stay = paths(now, [Course([], [g]) for g in (OPEN, PRESS, CLOSED)], self.settings.knots)
        found = np.concatenate([stay, ways])
        return found[random.permutation(len(found))]

    def _reaching(self, data: Any, now: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """From above onto the next box, then closing."""
        box = data.site_xpos[self._next][PLANE]
        hand = data.site_xpos["grasp"][PLANE]
        highest = crest(data, self._boxes, float(hand[0]), float(box[0]))
        tips = data.site_xpos["pinch"]
        others = [data.site_xpos[name] - tips for name in self._boxes if name != self._next]
        back = 0.07 if any(np.hypot(*o[PLANE]) < 2.0 * HALF for o in others) else 0.0
        is_there = np.hypot(*(box - HIGH * _DOWN - hand)) < _THERE
        hold = ready(float(closing(data)))
        grasp = [CLOSED if is_there else hold, CLOSED]
        points = box - np.array([[HIGH], [HIGH], [0.09]]) * _DOWN
        tilts = np.array([0.1, 0.8 if abs(box[0]) > _AT_WALL else 0.4, 0.4])
        found = hand_poses_each(random, points, GRASP, now, 2, angle_of(_DOWN), tilts)
        grasps = np.repeat([grasp, grasp, [hold, hold]], [len(poses) for poses in found], axis=0)
        over = highest + _UNDER_HAND, GRASP, 0.0
        ways = [ways_over(self.settings, now, np.concatenate(found), *over, grasps, back)]
        if back:
            ways.append(later(self.settings, ways[0]))
        return np.concatenate([*self._parting(data, now, random), *ways])

    def _parting(self, data: Any, now: np.ndarray, random: np.random.Generator) -> list[np.ndarray]:
        """A fingertip turns the next box over, away from one that fingers cannot pass."""
        box, free = data.site_xpos[self._next], self._free()
        others = [data.site_xpos[other] - box for other in self._boxes if other != self._next]
        near_by = [float(o[0]) for o in others if abs(o[2]) < HALF and abs(o[0]) < free]
        if abs(box[0]) > _FROM_WALL:
            near_by.append(float(box[0]))
        if not near_by or np.sign(min(near_by)) != np.sign(max(near_by)):
            return []
        side = -float(np.sign(near_by[0]))
        return [turning_over(self.settings, now, box[PLANE], side, random)]

    def _height(self, data: Any, start: float, end: float) -> float:
        """How high the next box passes what is between two places, metres; 0 over the floor."""
        highest = crest(data, [box for box in self._boxes if box != self._next], start, end)
        return highest + PASSES if highest else 0.0

    def _carrying(self, data: Any, now: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Up, over the place of the next box and down, so that the box lies flat there."""
        ahead, aside = (float(part) for part in in_hand(data, data.site_xpos[self._next]))
        turn = float(data.qpos[f"{self._next}_y"].item())
        flat = float(now.sum()) + (turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
        forward = GRASP + ahead
        start, end = float(data.site_xpos[self._next][0]), float(self._place[0])
        cruise = max(self._height(data, start, end), float(self._place[2]) + _OVER)
        stop = np.array([end + np.copysign(_BEFORE, start - end), cruise])
        far = abs(start - end) > _BEFORE + _APART
        if far:
            cruise = min(cruise, max(self._height(data, start, float(stop[0])), _RAISED))
        above = self._place[PLANE] - np.array([[0.0], [0.0], [_OVER]]) * _DOWN
        goals = np.repeat(stop[None], 3, axis=0) if far else above
        tilts = np.array([0.05, 0.4, 0.4])
        found = hand_poses_each(random, goals, forward, now, 2, flat, tilts, aside)
        found[2] = found[2][:1]
        poses, let_go = np.concatenate(found), [PRESS, PRESS if far else OPEN]
        grasp = np.repeat([let_go, let_go, [PRESS, PRESS]], [len(some) for some in found], axis=0)
        return ways_over(self.settings, now, poses, cruise, forward, aside, grasp)
