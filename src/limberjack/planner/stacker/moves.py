"""`Moves`: plans that fetch the next box of a tower, and carry it to its place.

plans = Moves(settings, tower, data).reaching(random)  # (n, knots, 5)
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.hand import ARM, CLOSED, OPEN, PLANE, closing, in_hand
from limberjack.planner.arm.kinematics import GRASP, hand_poses_each
from limberjack.planner.settings import Settings
from limberjack.planner.stacker.box_grip import HIGH, PRESS, ready
from limberjack.planner.stacker.boxes import DOWN, HALF, PASSES, crest
from limberjack.planner.stacker.lifted import later, plans_over, turning_over
from limberjack.planner.stacker.tower import FREE, FROM_WALL, Tower

__all__ = ["FREE_OF_TOWER", "OVER", "UNDER_HAND", "Moves"]

FREE_OF_TOWER = 0.08  # metres from a box to a tower, so that the hand fits between
UNDER_HAND = 0.045  # metres that the open fingers need below the grasp
OVER = 0.03  # metres above its place at which a box is carried to it


class Moves:
    """Plans for the boxes of a single simulation in its current state."""

    def __init__(self, settings: Settings, tower: Tower, data: Any) -> None:
        """Takes the planner's settings, the tower and the simulation's data."""
        self._settings, self._tower, self._data = settings, tower, data
        self._now = data.qpos[ARM]

    def reaching(self, random: np.random.Generator) -> np.ndarray:
        """Plans from above onto the next box, closing there."""
        data, now = self._data, self._now
        box = data.site_xpos[self._tower.next][PLANE]
        hand = data.site_xpos["grasp"][PLANE]
        boxes = [*self._tower.others, str(self._tower.next)]
        highest = crest(data, boxes, float(hand[0]), float(box[0]))
        between = data.site_xpos[self._tower.others] - data.site_xpos["pinch"]
        back = 0.07 if any(np.hypot(*o[PLANE]) < 2.0 * HALF for o in between) else 0.0
        points = box + np.array([[0.0, HIGH], [0.0, HIGH], [0.0, 0.09]])
        is_there = np.hypot(*(points[0] - hand)) < 0.02  # metres
        hold = ready(float(closing(data)))
        grasp = [CLOSED if is_there else hold, CLOSED]
        # Further out than 0.33 m a hand that points down does not reach the floor.
        tilts = np.array([0.1, 0.8 if abs(box[0]) > 0.33 else 0.4, 0.4])
        found = hand_poses_each(random, points, GRASP, now, 2, DOWN, tilts)
        grasps = np.repeat([grasp, grasp, [hold, hold]], [len(poses) for poses in found], axis=0)
        over = highest + UNDER_HAND, GRASP, 0.0
        plans = [plans_over(self._settings, now, np.concatenate(found), *over, grasps, back)]
        if back:
            plans.append(later(self._settings, plans[0]))
        return np.concatenate([*self._parting(random), *plans])

    def _parting(self, random: np.random.Generator) -> list[np.ndarray]:
        """Plans of a fingertip that turns the next box away from one that fingers cannot pass."""
        box = self._data.site_xpos[self._tower.next]
        free = FREE_OF_TOWER if len(self._tower.placed) > 1 else FREE
        others = self._data.site_xpos[self._tower.others] - box
        near_by = [float(o[0]) for o in others if abs(o[2]) < HALF and abs(o[0]) < free]
        if abs(box[0]) > FROM_WALL:
            near_by.append(float(box[0]))
        if not near_by or np.sign(min(near_by)) != np.sign(max(near_by)):
            return []
        side = -float(np.sign(near_by[0]))
        return [turning_over(self._settings, self._now, box[PLANE], side, random)]

    def _height(self, start: float, end: float) -> float:
        """Height at which the next box passes others between two places, metres; 0 if none."""
        highest = crest(self._data, self._tower.others, start, end)
        return highest + PASSES if highest else 0.0

    def carrying(self, random: np.random.Generator) -> np.ndarray:
        """Plans up, over the place of the next box and down, so that it lies flat there."""
        data, now, place = self._data, self._now, self._tower.place
        name = self._tower.next
        ahead, aside = (float(part) for part in in_hand(data, data.site_xpos[name]))
        turn = float(data.qpos[f"{name}_y"].item())
        flat = float(now.sum()) + (turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
        forward = GRASP + ahead
        start, end = float(data.site_xpos[name][0]), float(place[0])
        cruise = max(self._height(start, end), float(place[2]) + OVER)
        goals = place[PLANE] + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, OVER]])
        far = abs(start - end) > 0.15  # metres
        if far:  # first to where the box has risen, 0.13 m before the tower's middle
            goals[:] = end + np.copysign(0.13, start - end), cruise
            cruise = min(cruise, max(self._height(start, float(goals[0, 0])), 0.06))  # metres
        tilts = np.array([0.05, 0.4, 0.4])
        found = hand_poses_each(random, goals, forward, now, 2, flat, tilts, aside)
        found[2] = found[2][:1]
        poses, let_go = np.concatenate(found), [PRESS, PRESS if far else OPEN]
        grasp = np.repeat([let_go, let_go, [PRESS, PRESS]], [len(some) for some in found], axis=0)
        return plans_over(self._settings, now, poses, cruise, forward, aside, grasp)
