"""`Fetch`: fetching of the ball or the peg, which bringing and inserting have in common.

    fetch = Fetch(prop_of(task), settings)
    fetch.observe(data)
    fetch.update(physics)
    fetch.stage                              # Stage.CARRY once the hand has the object
    terms = fetch.terms(batch_data)          # (N,) each
    plans = fetch.plans(data, random, carrying)

The open hand approaches the object from ahead of it, then closes. An object out of reach is raked
inwards first. A hand that fails to grasp the object for long withdraws, and approaches again. A
peg that lies still is approached along a joint path; it may also lie on the arm, which then
stretches so that the peg falls. Where walls are in the way, a path leads around them.
"""

import enum

import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.collision import NOTHING, clearance
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, PLAY, fingers
from limberjack.planner.arm.kinematics import direction, drawn_back, nudged
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import (
    Proposal,
    approaches,
    lifts,
    plans_of,
    plans_on,
    straight_to,
)
from limberjack.planner.arm.watchdog import Watchdog
from limberjack.planner.manipulator.approach import STRETCHED, TOUCHING, Approach
from limberjack.planner.manipulator.forecast import MEETS, Forecast
from limberjack.planner.manipulator.peg_paths import PegPaths
from limberjack.planner.manipulator.props import (
    BACK,
    HAND,
    LIES,
    Ball,
    Peg,
    across,
    height_above_ground,
    is_on_arm,
    pose_of,
)
from limberjack.planner.manipulator.raking import Rake
from limberjack.planner.settings import Settings
from limberjack.utils import arrays

__all__ = ["ARRIVED", "PATIENCE", "PER_RADIAN", "Fetch", "Stage"]

PER_RADIAN = 0.4  # cost of a radian of the arm's path
ARRIVED = 0.5  # radians; the arm is at the end of a path that is so near
PATIENCE = 10  # plannings between searches for a path
_LOOSE = 8.0  # cost of an object that is not held, more than of any that is
_HELD = 0.3  # of the quality of a hold, from which on the hand has the object
_TAKES = 4  # poses of the arm that are tried for each pose of the object
_AWAY = 0.17  # metres; how far the hand withdraws
_NEAR = 0.75 * _AWAY  # metres; a hand so near to an object should soon hold it
_TRIES = 25  # plannings near an object without a hold, after which the hand withdraws
_WITHDRAWAL = 10  # plannings
_CARRIED = 15  # plannings that a peg touches the arm, after which it lies there
_FEW = 12  # poses at a peg that are enough to search a path to; proposals besides those on a path
_FLOOR = 0.03  # metres; a grasp site that is lower has the fingers on the floor
_ON_FLOOR = 0.15  # metres above the ground, below which an object can be fetched
_FAST = 2.0  # metres or radians per second; where a peg so fast will lie is not known yet
_ALIGNED = 0.1  # radians; a hand that comes to a peg so far from straight on takes it


class Stage(enum.Enum):
    """Stages of the manipulator's tasks."""

    RELEASE = "keep still while the ball rolls in"
    SHAKE = "shake off a ball that lies on the arm"
    LEAVE = "leave the object in its place"
    WITHDRAW = "withdraw after failing to grasp the object"
    RAKE = "rake the object into reach"
    INSERT = "insert the object"
    CARRY = "carry the object"
    FETCH = "fetch the object"


class Fetch:
    """Fetching of an object; see the module's docstring.

    Attributes:
      has: whether the hand has the object.
      path: the path that the arm follows around walls, to the object or with it.
      patience: plannings until another path is searched.
    """

    def __init__(self, prop: Ball | Peg, settings: Settings) -> None:
        self.prop, self.approach, self._knots = prop, Approach(prop), settings.knots
        self.forecast = Forecast(prop.name, prop.joints, settings)
        self.rake = Rake(prop)
        self.paths = None if isinstance(prop, Ball) else PegPaths(self.approach.draws)
        self.has = False
        self.path: Path | None = None
        self.patience = 0
        self._attempts = 0  # searches for a path to the object
        self._found_at = np.zeros(3)  # place of the object at the last of them
        self._withdraws = 0  # plannings for which the hand still withdraws
        self._nearness = Watchdog(_TRIES)  # of the hand to an object that it does not hold
        self._carriage = Watchdog(_CARRIED)  # of a peg that touches the arm

    @property
    def stage(self) -> Stage:
        """The current stage."""
        if self._withdraws > 0:
            return Stage.WITHDRAW
        if self.rake.goal is not None:
            return Stage.RAKE
        return Stage.CARRY if self.has else Stage.FETCH

    def choices(self) -> tuple[object, ...]:
        """Decisions on which the proposals of a stage depend."""
        rolls, rakes = len(self.forecast.poses) > 0, self.rake.goal is not None
        return self.has, rolls, rakes, self.rake.spot, self.path

    def observe(self, data: NamedFields) -> bool:
        """Decides whether the hand has the object; returns whether that has changed."""
        had, self.has = self.has, bool(self.hold(data) > _HELD)
        if had == self.has:
            return False
        self._attempts = 0
        self.drop_path(0)
        if self.paths is not None:
            self.paths.forget()
        return True

    def hold(self, data: NamedFields) -> np.ndarray:
        """Quality of the hand's hold on the object, 0 to 1, (N,)."""
        # A little play in the hand is no reason to stand still.
        return np.minimum(PLAY * self.prop.firmness(data, self.prop.offset(data)), 1.0)

    def follow(self, path: Path | None, patience: int) -> None:
        """Follows a path from now on; without one, the next search is after so many plannings."""
        self.path, self.patience = path, patience

    def drop_path(self, patience: int) -> None:
        """Leaves the path; the next search is after so many plannings."""
        self.follow(None, patience)

    def rest(self) -> None:
        """Neither rakes the object nor leads the arm to it, as it is in its place."""
        self.rake.stop()
        self.drop_path(self.patience)

    @property
    def lies_on_arm(self) -> bool:
        """Whether the peg has touched the arm for long."""
        return self._carriage.is_stuck

    def update(self, physics: Physics) -> None:
        """Decides the stage, after `observe`, and the path to an object that is not held."""
        data = physics.named.data
        self.patience -= 1
        self._watch_arm(data)
        if self.has:
            self.rake.stop()
            self._withdraws = 0
            self._nearness.begin()
        else:
            self._lose_patience(data)
            self.forecast.update(physics)
            self._decide_on_raking(data)
        if self.paths is not None:
            self._choose_spot(data)
        if self.path is not None:
            self.path.advance(data.qpos[ARM])
        if self.has:
            return
        is_blocked = self.paths is not None and self._search(self.paths, data)
        if self.approach.walls is not NOTHING:
            self._go_around(data, is_blocked)

    def _watch_arm(self, data: NamedFields) -> None:
        """Counts plannings with a peg on the arm; if it comes to lie there, the path changes."""
        lay = self.lies_on_arm
        is_carried = self.paths is not None and not self.has and is_on_arm(data)
        if is_carried:
            self._carriage.watch()
        else:
            self._carriage.begin()
        if self.lies_on_arm != lay:
            self.drop_path(-1)

    def _lose_patience(self, data: NamedFields) -> None:
        """Withdraws the hand after too long near the object without a grasp."""
        if self.paths is not None and self.rake.goal is not None:
            self._withdraws = 0  # a peg is raked from elsewhere instead
            self._nearness.begin()
            return
        if self._withdraws:
            self._withdraws -= 1
            return
        offset = data.site_xpos["grasp"] - data.site_xpos[self.prop.name]
        if arrays.norm(offset) < _NEAR and self._nearness.watch():
            self._nearness.begin()
            self._withdraws = _WITHDRAWAL

    def _decide_on_raking(self, data: NamedFields) -> None:
        """Rakes an object that comes to rest out of reach; a rolling one may come by itself."""
        if self.rake.goal is None and not self.forecast.settles:
            return
        end = self.forecast.met(data)[-1:]
        (takes,) = self.approach.poses_around(end, data.qpos[ARM], self.approach.draws, _TAKES)
        if self.rake.judge(data, len(takes) > 0):
            self._nearness.begin()

    def _choose_spot(self, data: NamedFields) -> None:
        """Decides where a peg is raked, unless the arm makes it fall; each spot has its path."""
        rake, spot = self.rake, self.rake.spot
        if self.lies_on_arm:
            rake.stop()
        moves = len(self.forecast.poses) > 0
        rake.choose_spot(data, self.approach.walls, self.path is not None, moves)
        if rake.goal is not None and rake.spot is not spot:
            self.drop_path(-1)

    def _search(self, paths: PegPaths, data: NamedFields) -> bool:
        """Searches for a path to a peg that lies still within reach, or to let one fall.

        Returns whether walls are in that path, which is then discarded.
        """
        now, draws, around = data.qpos[ARM], self.approach.draws, self.approach.poses_around
        if self.lies_on_arm:
            paths.search_room(now, STRETCHED)
        else:
            moves = np.abs(data.qvel[self.prop.joints]).max() > _FAST
            aloft = height_above_ground(data.site_xpos["peg"]) > LIES
            if self._withdraws or moves or aloft or self.rake.goal is not None:
                paths.forget()
                return False
            peg = pose_of(data, "peg")

            def straight_on() -> np.ndarray:
                (aligned,) = around([peg], now, draws, _FEW, tilt=_ALIGNED)
                return aligned if len(aligned) else around([peg], now, draws, _FEW)[0]

            paths.search_peg(now, peg, straight_on)
        along = paths.plans(now, 24)[:1, 1:, : len(ARM)]
        if self.approach.walls is NOTHING or not len(along):
            return False
        (poses,) = along
        between = np.concatenate([poses[1:], (poses[1:] + poses[:-1]) / 2])
        is_blocked = clearance(between, HAND, self.approach.walls)[:, 0].min() < TOUCHING
        if is_blocked:
            paths.forget()
        return bool(is_blocked)

    def _go_around(self, data: NamedFields, is_blocked: bool) -> None:
        """Keeps the arm's path to the object around the walls, or searches for one.

        An arm that does not advance is led to another pose, and so after too many searches.
        """
        place, path, most = data.site_xpos[self.prop.name], self.path, self.prop.attempts
        if path is not None:
            if path.left < ARRIVED:
                self.drop_path(PATIENCE)
                return
            # Where a rolling ball is awaited does not move with it.
            waits = isinstance(self.prop, Ball) and self.approach.is_fast(data)
            has_moved = arrays.norm(place - self._found_at) > BACK and not waits
            if path.is_stalled:
                self._attempts = most
            elif not has_moved and not path.is_astray:
                return
        elif self.patience >= 0:
            return
        self.patience, self._found_at = PATIENCE, place.copy()
        self._attempts += 1
        again = self._attempts > most
        found = self._find_path(data, again)
        if found is not None and again:
            self._attempts = most // 2
        is_needed = self.rake.goal is not None or self.lies_on_arm or is_blocked or path is not None
        # An arm that has left a dead end does not return there because the path is straight now.
        if found is not None and found.is_straight and not (again or is_needed):
            found = None
        self.path = found

    def _find_path(self, data: NamedFields, again: bool) -> Path | None:
        """The path to before the object, to rake it, or to let it fall from the arm."""
        approach, rake = self.approach, self.rake
        if rake.goal is not None:
            return approach.path_to_spot(data, rake.spot, rake.goal) if rake.spot else None
        if self.lies_on_arm:
            return approach.path_to_room(data)
        if self.paths is not None and approach.is_fast(data):
            return None
        path = approach.path_to_object(data, again)
        rake.note_search(path is not None)
        return path

    def terms(self, data: NamedFields, share: np.ndarray | float = 1.0) -> dict[str, np.ndarray]:
        """Terms of the stage, (N,) each; that of fetching is multiplied by a share, (N,)."""
        low = {"hand at the floor": np.maximum(_FLOOR - data.site_xpos["grasp", "z"], 0.0)}
        path, stage = self.path, self.stage
        if stage is Stage.WITHDRAW:
            away = arrays.norm(data.site_xpos["grasp"] - data.site_xpos[self.prop.name])
            moved = arrays.norm(data.qvel[self.prop.joints][..., :2])
            near_by = np.maximum(_AWAY - away, 0.0)
            return {"withdraw": 2.0 * _LOOSE + 20.0 * near_by + 2.0 * moved, **low}
        if self.rake.goal is not None:
            if path is None or self.rake.spot is None:
                rake = self.rake.at().cost(data, self.rake.goal)
            else:
                rake = PER_RADIAN * path.remaining(data.qpos[ARM])
            return {"rake": 2.0 * _LOOSE + rake, **low}
        if path is None or self.has:
            fetch = self._approach(data)
        else:
            unready = np.abs(fingers(data) - self.prop.ready)
            fetch = 2.0 + 1.5 * PER_RADIAN * path.remaining(data.qpos[ARM]) + 2.0 * unready
        return {"fetch": share * (_LOOSE + fetch), **low}

    def _approach(self, data: NamedFields) -> np.ndarray:
        """Cost of the distance from holding the object, (N,)."""
        ahead, aside = offset = self.prop.offset(data)
        distance = np.hypot(ahead - np.clip(ahead, 0.0, self.prop.slack), aside)
        turn = self.prop.misalignment(data)
        # With the object more than 12 mm beside it, the hand must first back off, by up to 70 mm:
        # the fingers are in the way. A turn of 90 degrees counts as 50 mm.
        beside = np.abs(aside) - 0.012 + 0.05 * turn
        detour = np.maximum(np.clip(1.5 * beside, 0.0, 0.07) - ahead, 0.0)
        # From 18 mm away the fingers should be open, and within 6 mm they may close.
        is_far = np.clip((distance - 0.006) / 0.012, 0.0, 1.0)
        unready = np.abs(fingers(data) - self.prop.opening(offset))
        # An object on the arm must fall before the hand can have it.
        aloft = np.maximum(height_above_ground(data.site_xpos[self.prop.name]) - _ON_FLOOR, 0.0)
        trouble = 0.5 * turn + 2.0 * is_far * unready + self.prop.chased(data) + 4.0 * aloft
        distance = distance + detour
        # Steeper within some 30 mm of the object, where it would else not pay to risk a touch.
        approach = 4.0 * distance + 0.5 * distance / (distance + 0.03)
        if self.paths is not None:
            approach = self.paths.cost_to_peg(data.qpos[ARM], approach) + across(data, turn)
        return approach + trouble

    def plans(
        self, data: NamedFields, random: np.random.Generator, carrying: list[Proposal]
    ) -> np.ndarray:
        """Plans of the stage, those along a path first, (n, knots, 5); the given ones to carry."""
        now, stage, knots = data.qpos[ARM], self.stage, self._knots
        if stage is Stage.WITHDRAW:
            proposals = lifts(random, data, OPEN_ANGLE)
        elif self.rake.goal is not None:
            proposals = self.rake.at().proposals(random, data, self.rake.goal)
        else:
            proposals = carrying if stage is Stage.CARRY else self._reaching(data, random)
        plans = plans_of(now, [*proposals, Proposal([now], [OPEN_ANGLE])], knots)
        if stage is not Stage.RAKE or self.paths is None:
            plans = plans[random.permutation(len(plans))]
            if self.paths is not None:
                plans = np.concatenate([self.paths.plans(now, knots), plans])
        if self.path is None:
            return plans
        grasp = self.prop.shut if self.has else OPEN_ANGLE
        return np.concatenate([plans_on(self.path, now, grasp, knots), plans[:_FEW]])

    def _reaching(self, data: NamedFields, random: np.random.Generator) -> list[Proposal]:
        """Proposals to grasp the object: straight on to a peg at rest, else where it will be."""
        now, prop = data.qpos[ARM], self.prop
        proposals = [Proposal([now], [prop.shut])]
        if self.paths is None or self.forecast.poses:
            return proposals + self._meeting(data, random)
        back = nudged(now, -BACK * direction(now.sum()), 0.0)
        proposals.extend(straight_to([back], OPEN_ANGLE, 1, 3))
        peg = [pose_of(data, "peg")]
        for few, tilt in ((3, _ALIGNED), (2, 0.5)):
            (poses,) = self.approach.poses_around(peg, now, random, few, tilt=tilt)
            proposals.extend(approaches(poses, prop.ready, prop.shut))
        return proposals

    def _meeting(self, data: NamedFields, random: np.random.Generator) -> list[Proposal]:
        """Proposals to the object's next poses, at once or from ahead; the hand closes there."""
        now, prop = data.qpos[ARM], self.prop
        proposals: list[Proposal] = []
        takes = self.approach.poses_around(self.forecast.met(data), now, random, _TAKES)
        for number, knot in enumerate(MEETS):
            poses = takes[min(number, len(takes) - 1)]
            grasp = [prop.ready] * knot + [prop.shut]
            for pose, before in zip(poses, drawn_back(poses, BACK), strict=True):
                proposals.append(Proposal([pose], grasp, knot))
                if not np.isfinite(before[0]):
                    continue
                if knot > 1:
                    proposals.append(Proposal([before, pose], grasp, knot // 2))
                proposals.append(Proposal([before], [prop.ready], knot))
        return proposals
