"""`Stack`: the cost of the stacker's tasks, a tower up to the target.

Before each planning step, `update` decides which boxes stand in place, which box is next, where it
goes, and the stage. The next box is fetched from above, lifted over its place and let down; when
the last one stands, the hand leaves. Until all boxes have fallen the arm dodges. Without progress
it retreats and takes another box, and a box that lies on the arm is shaken off.
"""

import dataclasses
import enum
from typing import Any, ClassVar

import numpy as np

from limberjack.planner.arm.hand import (
    ARM,
    CLOSED,
    LONGEST,
    OPEN,
    PLANE,
    SETTINGS,
    near,
    outward_speed,
)
from limberjack.planner.arm.proposals import Proposal, plans_of
from limberjack.planner.cost import Cost
from limberjack.planner.stacker.box_grip import PRESS, fetching, grip_of, how_held
from limberjack.planner.stacker.boxes import FLAT, HALF, haste, lies_too_low, turned
from limberjack.planner.stacker.lifted import leaving
from limberjack.planner.stacker.moves import FREE_OF_TOWER, OVER, UNDER_HAND, Moves
from limberjack.planner.stacker.patience import Patience, plans_to, refuge, shelter
from limberjack.planner.stacker.tower import ALOFT, FREE, FROM_WALL, PLACED, Tower
from limberjack.utils import arrays

__all__ = ["Stack", "Stage"]

_HAS, _LOST = 0.7, 0.3  # of how well a box is held, to have it and to keep it
_LYING = 0.03  # metres; a box higher than this does not lie on the floor
_CAUGHT = 14  # planning steps; a box that is aloft for longer lies on the arm


class Stage(enum.Enum):
    """Stages of the tower."""

    LEAVE = "take the hand away from the tower"
    DODGE = "wait beside falling boxes"
    RETREAT = "retreat after no progress"
    SHAKE = "shake off a box that lies on the arm"
    CARRY = "carry the box to its place"
    FETCH = "fetch the next box"


class Stack(Cost):
    """Cost of a tower up to the target, with the hand away from it."""

    settings = dataclasses.replace(
        SETTINGS,
        samples=36,
        horizon=0.45,
        # A new plan reaches a target at the next knot at the earliest.
        knots=9,
        temperature=0.1,
        armature=1e-3,
        flowing=True,
        cost_interval=3,
        proposal_interval=2,
        servos=True,
        sleep=True,
    )
    weights: ClassVar = {
        "shaken tower": 80.0,
        "boxes in the way": 4.0,
        "hand at the floor": 5.0,
        "hand at the target": 5.0,
        "boxes on the arm": 5.0,
    }

    def __init__(self, task: Any) -> None:
        """Takes a `stacker.Stack` task."""
        super().__init__(task)
        self._boxes: list[str] = task.boxes
        if len(self._boxes) > 2:  # each takes time
            self.settings = dataclasses.replace(self.settings, samples=32)
        self._patience = Patience(plannings=20, part=0.9)  # 0.6 s
        self.reset()

    def reset(self) -> None:
        """Discards the stage and the next box."""
        self._tower = Tower(self._boxes)
        self._firm = False  # the hand has the next box
        self._backing = self._caught = self._tries = 0
        self._falling = False
        self._refuge = np.zeros(4)
        self._patience.reset()

    # In this order: the first that is due is the stage.
    _TRANSITIONS = (
        (Stage.LEAVE, lambda self: self._tower.next is None),
        (Stage.DODGE, lambda self: self._falling),
        (Stage.RETREAT, lambda self: self._backing > 0),
        (Stage.SHAKE, lambda self: self._caught > _CAUGHT),
        (Stage.CARRY, lambda self: self._firm),
        (Stage.FETCH, lambda self: True),
    )

    def stage(self) -> Any:
        """The stage, the next box, the tower's height, and the reasons for other stages."""
        tower = self._tower
        stage = next(stage for stage, is_due in self._TRANSITIONS if is_due(self))
        reasons = self._firm, self._falling, self._backing > 0, self._caught > _CAUGHT
        return stage, tower.next, len(tower.placed), reasons

    def update(self, physics: Any) -> None:
        """Decides which boxes stand, which one is next, where it goes, and the stage."""
        data, tower = physics.named.data, self._tower
        before = tower.next
        tower.update(data, before is not None and self._held(data) > _LOST)
        self._backing = max(self._backing - 1, 0)
        self._firm = self._firm and tower.next == before
        self.noise_scale = 1.0
        if tower.next is None:
            self._backing = self._caught = 0
            self._firm = self._falling = False
            self._patience.reset()
            return
        self._firm = self._held(data) > (_LOST if self._firm else _HAS)
        if self._firm:
            self.noise_scale = 0.3  # a large one jerks the box
        loose = tower.waiting if self._firm else [*tower.waiting, tower.next]
        self._caught = self._caught + 1 if self._is_caught(data, loose) else 0
        is_early = physics.time() < 0.4  # seconds, in which boxes fall from their starts
        falling = is_early and bool((data.site_xpos[loose][:, 2] > ALOFT).any())
        if falling and not self._falling:
            self._refuge = shelter(data)
        self._falling = falling
        if not falling:
            self._await_progress(data)

    def _await_progress(self, data: Any) -> None:
        """Begins a retreat if neither the next box nor the hand has come nearer for long."""
        tower = self._tower
        box, hand = data.site_xpos[tower.next], data.site_xpos["grasp"]
        lack = float(np.hypot(*(box - (tower.place if self._firm else hand))[PLANE]))
        if self._patience.is_out((tower.next, self._firm, len(tower.placed)), lack):
            tower.shunned, self._backing = tower.next, 12
            self._refuge = refuge(data, box, self._tries)
            self._tries += 1

    def _is_caught(self, data: Any, loose: list[str]) -> bool:
        """Whether a box beside the tower is aloft, or leans on the arm."""
        places = data.site_xpos[loose]
        leans = (places[:, 2] > 0.06) & (turned(data, loose) > FLAT)  # metres; not on the floor
        beside = np.abs(places[:, 0] - self._tower.place[0]) > FREE
        return bool(((leans | (places[:, 2] > ALOFT)) & beside).any())

    def _held(self, data: Any) -> float:
        """Quality of the hand's hold on the next box now, 0 to 1."""
        return float(how_held(grip_of(data, str(self._tower.next)), self._firm))

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        """The missing reward and tower, and the terms of the stage."""
        data, tower, stage = physics.named.data, self._tower, self.stage()[0]
        others = data.site_xpos[tower.others][..., ::2]  # x and z
        placed, waiting = np.split(others, [len(tower.placed)], axis=-2)
        hand = data.site_xpos["grasp"]
        terms = {"reward": 1.0 - self.task.get_reward(physics)}
        if tower.placed:
            terms["shaken tower"] = self._shaken(data, placed)
        terms["boxes in the way"] = self._in_the_way(waiting)
        terms["hand at the floor"] = np.maximum(0.045 - hand[..., 2], 0.0)
        if stage is Stage.LEAVE:
            distance = arrays.norm(hand - data.site_xpos["target"])
            return {**terms, "hand at the target": np.maximum(0.12 - distance, 0.0)}
        if stage is Stage.DODGE:
            return {**terms, "falling boxes": self._dodging(data)}
        if stage is Stage.RETREAT:
            return {**terms, "retreat": np.abs(data.qpos[ARM] - self._refuge).sum(axis=-1)}
        box = data.site_xpos[tower.next][..., ::2]
        if stage is Stage.SHAKE:
            height = np.maximum(waiting[..., 1] - _LYING, 0.0).sum(axis=-1)
            height = height + np.maximum(box[..., 1] - _LYING, 0.0)
            return {**terms, "boxes on the arm": height}
        return {**terms, **self._moving(physics, box, others, waiting)}

    def _moving(
        self, physics: Any, box: np.ndarray, others: np.ndarray, waiting: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Terms of carrying and fetching, weighted by how well the box is held."""
        data, following = physics.named.data, str(self._tower.next)
        offset = box - self._tower.place[PLANE]
        # It may be let go 8 mm above its place.
        above = np.maximum(offset[..., 1] - 0.008, np.maximum(-offset[..., 1], 0.0))
        standing = near(np.hypot(offset[..., 0], above), 2.0 * PLACED)
        grip = grip_of(data, following)
        # A box that leans on a finger at its place, by about 17 degrees, does not stand there.
        upright = 1.0 if self._firm else near(turned(data, following), 0.08)
        secure = np.maximum(how_held(grip, self._firm), standing * upright)
        moved = self._moved(data, box)
        carry = 1.0 - standing + _grasp(physics, standing) + grip.tilt
        # A box that is not held firmly yet is not lifted.
        carry += self._distance(data, box, others) + haste(data, following) if self._firm else moved
        # A box that is not held costs more than any that is.
        fetch = 10.0 + fetching(grip) + moved + self._pushed(data, waiting)
        fetch += self._crowd(box, others) + self._over_tower(data.site_xpos["grasp"])
        return {"carry": secure * carry, "fetch": (1.0 - secure) * fetch}

    def _dodging(self, data: Any) -> np.ndarray:
        """Heights and speeds of falling boxes, and distance of the arm from shelter, (N,)."""
        heights = np.maximum(data.site_xpos[self._boxes][..., 2] - _LYING, 0.0)
        speeds = np.abs(data.qvel[[f"{box}_x" for box in self._boxes]])
        away = np.abs(data.qpos[ARM] - self._refuge).sum(axis=-1)
        return (5.0 * heights + speeds).sum(axis=-1) + 0.1 * away

    def _moved(self, data: Any, box: np.ndarray) -> np.ndarray:
        """Motion of the next box, (N,): a box that is pushed, or lifted by its edge, gets lost."""
        velocity = data.qvel[[f"{self._tower.next}_x", f"{self._tower.next}_z"]]
        speed = np.hypot(velocity[..., 0], velocity[..., 1])
        return np.minimum(speed, 1.0) + 10.0 * np.maximum(box[..., 1] - _LYING, 0.0)

    def _pushed(self, data: Any, waiting: np.ndarray) -> np.ndarray:
        """Motion of loose boxes, outwards or at all, and boxes on the arm, (N,)."""
        outwards = outward_speed(data, f"{self._tower.next}_x", str(self._tower.next))
        loose = self._tower.waiting
        if not loose:
            return outwards
        speeds = np.minimum(np.abs(data.qvel[[f"{box}_x" for box in loose]]), 1.0)
        aloft = np.clip((waiting[..., 1] - ALOFT) / HALF, 0.0, 1.0)
        return outwards + (aloft + speeds).sum(axis=-1)

    def _crowd(self, box: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Room that fingers lack between the next box and those beside it, (N,)."""
        offsets = np.abs(others - box[..., None, :])
        free = FREE_OF_TOWER if len(self._tower.placed) > 1 else FREE
        room = (offsets[..., 1] < HALF) * np.maximum(free - offsets[..., 0], 0.0)
        return 100.0 * (room.sum(axis=-1) + np.maximum(np.abs(box[..., 0]) - FROM_WALL, 0.0))

    def _over_tower(self, hand: np.ndarray) -> Any:
        """Height that the hand lacks to pass the tower, (N,)."""
        if not self._tower.placed:
            return 0.0
        top = float(self._tower.place[2]) - HALF
        beside = np.abs(hand[..., 0] - self._tower.place[0])
        low = np.maximum(top + UNDER_HAND - hand[..., 2], 0.0)
        return 8.0 * np.clip((FREE_OF_TOWER - beside) / 0.03, 0.0, 1.0) * low

    def _in_the_way(self, waiting: np.ndarray) -> np.ndarray:
        """Closeness of other loose boxes to the tower's place, (N,)."""
        beside = np.abs(waiting[..., 0] - self._tower.places[0][0])
        return ((waiting[..., 1] < ALOFT) * np.maximum(FREE - beside, 0.0)).sum(axis=-1)

    def _shaken(self, data: Any, placed: np.ndarray) -> np.ndarray:
        """Distances by which boxes have moved from their places, (N,)."""
        moved = placed - np.array(self._tower.places[: len(self._tower.placed)])[:, PLANE]
        gaps = np.hypot(moved[..., 0], moved[..., 1]) + 0.05 * turned(data, self._tower.placed)
        return np.maximum(gaps - PLACED, 0.0).sum(axis=-1)

    def _distance(self, data: Any, box: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Distance of the next box from its place, over the tower, (N,)."""
        place = self._tower.place
        gap = arrays.norm(box - place[PLANE])
        up, beside = box[..., 1] - place[2], np.abs(box[..., 0] - place[0])
        over = np.clip((beside - 0.006) / 0.02, 0.0, 1.0) * OVER
        distance = gap + np.minimum(8.0 * np.maximum(over - up, 0.0), 0.25)
        low = np.minimum(12.0 * lies_too_low(box, others), 0.6)
        distance += np.clip(beside / HALF - 1.5, 0.0, 1.0) * low
        return distance / LONGEST + 0.3 * np.sqrt(turned(data, str(self._tower.next)))

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Plans of the stage, and to keep still with any grasp."""
        data, stage = physics.named.data, self.stage()[0]
        now = data.qpos[ARM]
        if stage in (Stage.DODGE, Stage.RETREAT, Stage.SHAKE):
            plans = plans_to(self._refuge, self.settings, now, random)
        elif stage is Stage.LEAVE:
            plans = leaving(self.settings, data, random)
        else:
            moves = Moves(self.settings, self._tower, data)
            plans = (moves.carrying if stage is Stage.CARRY else moves.reaching)(random)
        still = [Proposal([], [grasp]) for grasp in (OPEN, PRESS, CLOSED)]
        found = np.concatenate([plans_of(now, still, self.settings.knots), plans])
        return found[random.permutation(len(found))]


def _grasp(physics: Any, standing: np.ndarray) -> np.ndarray:
    """Error of the grasp's control, which holds a box, or releases one that stands, (N,)."""
    press = physics.named.data.ctrl["grasp"]
    return np.where(standing < 0.5, 0.3 * np.abs(press - PRESS), 0.15 * (1.0 + press))
