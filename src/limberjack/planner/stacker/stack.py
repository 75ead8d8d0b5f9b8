"""`Stack`: the cost of the stacker's tasks, a tower up to the target.

Before each planning step, `update` decides which boxes stand in place, which box is next, where it
goes, and the stage. The next box is fetched from above, lifted over its place and let down; when
the last one stands, the hand leaves. Until all boxes have fallen the arm dodges. Without progress
it retreats and takes another box, and a box that lies on the arm is shaken off.
"""

import dataclasses
import enum
from typing import ClassVar

import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.hand import ARM, CLOSED, LONGEST, OPEN, PLANE, near, outward_speed
from limberjack.planner.arm.proposals import Proposal, plans_of
from limberjack.planner.arm.watchdog import Watchdog
from limberjack.planner.cost import AnyTask, Cost
from limberjack.planner.stacker import moves
from limberjack.planner.stacker.box_grip import PRESS, fetching, grip_of, how_held
from limberjack.planner.stacker.moves import FREE_OF_TOWER, OVER, STACKING, UNDER_HAND
from limberjack.planner.stacker.tower import (
    ALOFT,
    FLAT,
    FREE,
    FROM_WALL,
    HALF,
    PLACED,
    Tower,
    length,
    lies_too_low,
    turned,
)
from limberjack.utils import arrays
from limberjack.utils.arrays import Quantity

__all__ = ["Stack", "Stage"]

_HAS, _LOST = 0.7, 0.3  # of how well a box is held, to have it and to keep it
_LYING = 0.03  # metres; a box higher than this does not lie on the floor
_CAUGHT = 14  # planning steps; a box that is aloft for longer lies on the arm
_PATIENCE = 20  # planning steps without progress, 0.6 s; then the arm retreats
_PROGRESS = 0.9  # of the least distance so far: a shorter one is progress
_RETREAT = 12  # planning steps
_EARLY = 0.4  # seconds, in which boxes fall from their starts
_LEANS = 0.06  # metres; a tilted box that is higher leans on the arm
_GENTLE = 0.3  # share of the noise, for an arm that carries a box: a large one jerks it
_FLOOR = 0.045  # metres; a grasp site that is lower has the fingers on the floor
_LEFT = 0.12  # metres from the target, where the hand has left the tower
_LOOSE = 10.0  # cost of a box that is not held, more than of any that is
_HASTE, _JERK = 1.3, 10.0  # m/s and m/s2, from which on a box slips as it is carried
_CREPT = 0.03  # metres ahead of the grasp site, from which on a box has crept to the fingertips


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

    settings = STACKING
    weights: ClassVar = {
        "shaken tower": 80.0,
        "boxes in the way": 4.0,
        "hand at the floor": 5.0,
        "hand at the target": 5.0,
        "boxes on the arm": 5.0,
    }

    def __init__(self, task: AnyTask) -> None:
        """Takes a `stacker.Stack` task."""
        super().__init__(task)
        self._boxes: list[str] = task.boxes
        if len(self._boxes) > 2:  # each takes time
            self.settings = dataclasses.replace(STACKING, samples=32)
        self.reset()

    def reset(self) -> None:
        """Discards the stage and the next box."""
        self._tower, self._tries, self._refuge = Tower(self._boxes), 0, np.zeros(4)
        self._begin()

    def _begin(self) -> None:
        self._firm = self._falling = False  # the hand has the next box; boxes fall
        self._backing = 0  # planning steps left
        self._lying = Watchdog(_CAUGHT)  # of a box on the arm
        self._watchdog = Watchdog(_PATIENCE, share=_PROGRESS)

    def stage(self) -> tuple[Stage, object, object, object]:
        """The stage, the next box, the tower's height, and the reasons for other stages."""
        tower = self._tower
        reasons = self._firm, self._falling, self._backing > 0, self._lying.is_stuck
        return self._stage(), tower.next, len(tower.placed), reasons

    def _stage(self) -> Stage:
        if self._tower.next is None:
            return Stage.LEAVE
        if self._falling:
            return Stage.DODGE
        if self._backing > 0:
            return Stage.RETREAT
        if self._lying.is_stuck:
            return Stage.SHAKE
        return Stage.CARRY if self._firm else Stage.FETCH

    def update(self, physics: Physics) -> None:
        """Decides which boxes stand, which one is next, where it goes, and the stage."""
        data, tower = physics.named.data, self._tower
        before = tower.next
        tower.update(data, before is not None and self._held(data) > _LOST)
        self.noise_scale = 1.0
        if tower.next is None:
            self._begin()
            return
        self._backing = max(self._backing - 1, 0)
        self._firm = self._firm and tower.next == before
        self._firm = self._held(data) > (_LOST if self._firm else _HAS)
        if self._firm:
            self.noise_scale = _GENTLE
        loose = tower.waiting if self._firm else [*tower.waiting, tower.next]
        if self._is_caught(data, loose):
            self._lying.watch()
        else:
            self._lying.begin()
        is_early = physics.time() < _EARLY
        falling = is_early and bool((data.site_xpos[loose][:, 2] > ALOFT).any())
        if falling and not self._falling:
            self._refuge = moves.shelter(data)
        self._falling = falling
        if not falling:
            self._retreat_without_progress(data)

    def _held(self, data: NamedFields) -> float:
        """Quality of the hand's hold on the next box now, 0 to 1."""
        return float(how_held(grip_of(data, str(self._tower.next)), self._firm))

    def _is_caught(self, data: NamedFields, loose: list[str]) -> bool:
        """Whether a box beside the tower is aloft, or leans on the arm."""
        places = data.site_xpos[loose]
        leans = (places[:, 2] > _LEANS) & (turned(data, loose) > FLAT)
        beside = np.abs(places[:, 0] - self._tower.place[0]) > FREE
        return bool(((leans | (places[:, 2] > ALOFT)) & beside).any())

    def _retreat_without_progress(self, data: NamedFields) -> None:
        """Begins a retreat if neither the next box nor the hand has come nearer for long."""
        tower = self._tower
        box, hand = data.site_xpos[tower.next], data.site_xpos["grasp"]
        lack = float(length((box - (tower.place if self._firm else hand))[PLANE]))
        pursued = tower.next, self._firm, len(tower.placed)
        if self._watchdog.watch({"lack": lack}, pursued):
            self._watchdog.begin()
            tower.shunned, self._backing = tower.next, _RETREAT
            self._refuge = moves.refuge(data, box, self._tries)
            self._tries += 1

    def terms(self, physics: Physics) -> dict[str, np.ndarray]:
        """The missing reward and tower, and the terms of the stage."""
        data, tower, stage = physics.named.data, self._tower, self._stage()
        others = data.site_xpos[tower.others][..., ::2]  # x and z
        placed, waiting = np.split(others, [len(tower.placed)], axis=-2)
        hand = data.site_xpos["grasp"]
        terms = {"reward": 1.0 - self.task.get_reward(physics)}
        if tower.placed:
            terms["shaken tower"] = self._shaken(data, placed)
        terms["boxes in the way"] = self._in_the_way(waiting)
        terms["hand at the floor"] = np.maximum(_FLOOR - hand[..., 2], 0.0)
        if stage is Stage.LEAVE:
            distance = arrays.norm(hand - data.site_xpos["target"])
            return terms | {"hand at the target": np.maximum(_LEFT - distance, 0.0)}
        away = np.abs(data.qpos[ARM] - self._refuge).sum(axis=-1)
        if stage is Stage.DODGE:
            return terms | {"falling boxes": self._fallen(data) + 0.1 * away}
        if stage is Stage.RETREAT:
            return terms | {"retreat": away}
        box = data.site_xpos[tower.next][..., ::2]
        if stage is Stage.SHAKE:
            height = np.maximum(waiting[..., 1] - _LYING, 0.0).sum(axis=-1)
            return terms | {"boxes on the arm": height + np.maximum(box[..., 1] - _LYING, 0.0)}
        return terms | self._moving(physics, box, others, waiting)

    def _moving(
        self, physics: Physics, box: np.ndarray, others: np.ndarray, waiting: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Terms of carrying and fetching, weighted by how well the box is held."""
        data, following = physics.named.data, str(self._tower.next)
        offset, dofs = box - self._tower.place[PLANE], [f"{following}_x", f"{following}_z"]
        # It may be let go 8 mm above its place.
        above = np.maximum(offset[..., 1] - 0.008, np.maximum(-offset[..., 1], 0.0))
        standing = near(np.hypot(offset[..., 0], above), 2.0 * PLACED)
        grip = grip_of(data, following)
        # A box that leans on a finger at its place, by about 17 degrees, does not stand there.
        upright = 1.0 if self._firm else near(turned(data, following), 0.08)
        secure = np.maximum(how_held(grip, self._firm), standing * upright)
        speed = length(data.qvel[dofs])
        # A box that is pushed, or lifted by its edge, gets lost.
        moved = np.minimum(speed, 1.0) + 10.0 * np.maximum(box[..., 1] - _LYING, 0.0)
        carry = 1.0 - standing + _grasp(physics, standing) + grip.tilt
        if self._firm:
            haste = 2.0 * np.maximum(speed - _HASTE, 0.0)
            haste = haste + 0.05 * np.maximum(length(data.qacc[dofs]) - _JERK, 0.0)
            # Any box creeps towards the fingertips, by 20 mm in half a metre at 1 m/s.
            slip = 30.0 * np.maximum(grip.ahead - _CREPT, 0.0)
            carry += self._distance(data, box, others) + haste + slip
        else:  # a box that is not held firmly yet is not lifted
            carry += moved
        fetch = _LOOSE + fetching(grip) + moved + self._pushed(data, waiting)
        fetch += self._crowd(box, others) + self._over_tower(data.site_xpos["grasp"])
        return {"carry": secure * carry, "fetch": (1.0 - secure) * fetch}

    def _fallen(self, data: NamedFields) -> np.ndarray:
        """Heights and speeds of falling boxes, (N,)."""
        heights = np.maximum(data.site_xpos[self._boxes][..., 2] - _LYING, 0.0)
        speeds = np.abs(data.qvel[[f"{box}_x" for box in self._boxes]])
        return (5.0 * heights + speeds).sum(axis=-1)

    def _pushed(self, data: NamedFields, waiting: np.ndarray) -> np.ndarray:
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

    def _over_tower(self, hand: np.ndarray) -> np.ndarray | float:
        """Height that the hand lacks to pass the tower, (N,)."""
        if not self._tower.placed:
            return 0.0
        top = float(self._tower.place[2]) - HALF
        beside = np.abs(hand[..., 0] - self._tower.place[0])
        low = np.maximum(top + UNDER_HAND - hand[..., 2], 0.0)
        return 8.0 * np.clip((FREE_OF_TOWER - beside) / 0.03, 0.0, 1.0) * low

    def _in_the_way(self, waiting: np.ndarray) -> np.ndarray:
        """Closeness of other loose boxes to the tower's place, (N,)."""
        beside = np.abs(waiting[..., 0] - self._tower.places[0, 0])
        return ((waiting[..., 1] < ALOFT) * np.maximum(FREE - beside, 0.0)).sum(axis=-1)

    def _shaken(self, data: NamedFields, placed: np.ndarray) -> np.ndarray:
        """Distances by which boxes have moved from their places, (N,)."""
        names = self._tower.placed
        moved = length(placed - self._tower.places[: len(names), PLANE])
        return np.maximum(moved + 0.05 * turned(data, names) - PLACED, 0.0).sum(axis=-1)

    def _distance(self, data: NamedFields, box: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Distance of the next box from its place, over the tower, (N,)."""
        place = self._tower.place
        gap = arrays.norm(box - place[PLANE])
        up, beside = box[..., 1] - place[2], np.abs(box[..., 0] - place[0])
        over = np.clip((beside - 0.006) / 0.02, 0.0, 1.0) * OVER
        distance = gap + np.minimum(8.0 * np.maximum(over - up, 0.0), 0.25)
        low = np.minimum(12.0 * lies_too_low(box, others), 0.6)
        distance += np.clip(beside / HALF - 1.5, 0.0, 1.0) * low
        return distance / LONGEST + 0.3 * np.sqrt(turned(data, str(self._tower.next)))

    def proposals(self, physics: Physics, random: np.random.Generator) -> np.ndarray:
        """Plans of the stage, and to keep still with any grasp."""
        data, stage = physics.named.data, self._stage()
        now = data.qpos[ARM]
        if stage is Stage.LEAVE:
            plans = moves.leaving(data, random)
        elif stage is Stage.CARRY:
            plans = moves.carrying(self._tower, data, random)
        elif stage is Stage.FETCH:
            plans = moves.reaching(self._tower, data, random)
        else:
            plans = moves.plans_to(self._refuge, now, random)
        still = [Proposal([], [grasp]) for grasp in (OPEN, PRESS, CLOSED)]
        found = np.concatenate([plans_of(now, still, plans.shape[1]), plans])
        return found[random.permutation(len(found))]


def _grasp(physics: Physics, standing: Quantity) -> np.ndarray:
    """Error of the grasp's control, which holds a box, or releases one that stands, (N,)."""
    press = physics.named.data.ctrl["grasp"]
    return np.where(standing < 0.5, 0.3 * np.abs(press - PRESS), 0.15 * (1.0 + press))
