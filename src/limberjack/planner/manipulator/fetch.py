"""`Fetch`: fetching of the ball or the peg, which bringing and inserting have in common.

    fetch = Fetch(prop_of(task), settings)
    fetch.update(physics)
    fetch.stage                              # Stage.CARRY once the hand has the object
    terms = fetch.terms(batch_data, carrying)  # (N,) each
    plans = fetch.plans(data, random, carrying_proposals)

The open hand approaches the object from ahead of it, then closes. An object out of reach is raked
inwards first. A hand that fails to grasp the object for long withdraws, and approaches again. A
peg that lies still is approached along a joint path; it may also lie on the arm, which then
stretches so that the peg falls.
"""

import enum
from collections.abc import Callable
from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, PLAY, fingers
from limberjack.planner.arm.kinematics import direction, drawn_back, hand_poses_each, nudged
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, approaches, lifts, plans_of, straight_to
from limberjack.planner.manipulator.forecast import MEETS, Forecast
from limberjack.planner.manipulator.grips import BACK, Pose, height_above_ground, pose_of
from limberjack.planner.manipulator.peg_paths import PegPaths
from limberjack.planner.manipulator.props import HAND, LIES, Ball, Peg, across, is_on_arm
from limberjack.planner.manipulator.raking import Rake
from limberjack.planner.settings import Settings
from limberjack.utils import arrays

__all__ = ["PER_RADIAN", "STRETCHED", "TOUCHING", "Fetch", "Stage"]

TOUCHING = -0.004  # metres; fingers may be so near to walls that they touch them
STRETCHED = np.array([np.pi, 0.5, 0.5, 0.5])  # radians; joints of an arm on which no peg lies
PER_RADIAN = 0.4  # cost of a radian of the arm's path
_LOOSE = 8.0  # cost of an object that is not held, more than of any that is
_TAKES = 4  # poses of the arm that are tried for each pose of the object
_AWAY = 0.17  # metres; how far the hand withdraws
_ALIGNED = 0.1  # radians; a hand that comes to a peg so far from straight on takes it

_Carrying = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
_Proposing = Callable[[Any, np.random.Generator], list[Proposal]]


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
    """Fetching of an object; see the module's docstring."""

    def __init__(
        self, prop: Ball | Peg, settings: Settings, spare: int = 1, fewest: int = 1
    ) -> None:
        """Begins an episode; draws `spare` times as many poses as are wanted, at least `fewest`."""
        self.prop, self._knots = prop, settings.knots
        self._spare, self._fewest = spare, fewest
        self.has = False  # whether the hand has the object
        self.is_blocked = False  # whether the walls are in the path to the peg
        self.walls = Obstacle(np.zeros((0, 2, 2)), np.zeros(0))  # for the hand: none by default
        self.draws = np.random.default_rng(0)  # for searches, other than the planner's stream
        self.forecast = Forecast(prop.name, prop.joints, settings)
        self.rake = Rake(prop)
        self.paths = None if isinstance(prop, Ball) else PegPaths(self.draws)  # to and with a peg
        self.withdraws = 0  # plannings for which the hand still withdraws
        self._near_for = 0  # plannings in which the hand was near the object without holding it
        self._carried_for = 0  # plannings in which the peg has touched the arm

    # In this order: the first that is due is the stage.
    _TRANSITIONS = (
        (Stage.WITHDRAW, lambda self: self.withdraws > 0),
        (Stage.RAKE, lambda self: self.rake.goal is not None),
        (Stage.CARRY, lambda self: self.has),
        (Stage.FETCH, lambda self: True),
    )

    @property
    def stage(self) -> Stage:
        """The current stage."""
        return next(stage for stage, is_due in self._TRANSITIONS if is_due(self))

    def choices(self) -> tuple[Any, ...]:
        """Decisions on which the proposals of a stage depend."""
        rolls, rakes = len(self.forecast.poses) > 0, self.rake.goal is not None
        return self.has, rolls, rakes, self.withdraws > 0, self.rake.spot

    def observe(self, data: Any) -> None:
        """Decides whether the hand has the object, by the quality of the hold."""
        self.has = bool(self._hold(data, self.prop.offset(data)) > 0.3)

    def is_fast(self, data: Any) -> bool:
        """Whether the object, at over 1 m/s, will soon be elsewhere than where a path leads."""
        return bool(np.abs(data.qvel[self.prop.joints[:2]]).max() > 1.0)

    def watch_arm(self, data: Any) -> bool:
        """Counts plannings with a peg on the arm; returns whether `lies_on_arm` has changed."""
        before = self.lies_on_arm
        is_carried = self.paths is not None and not self.has and is_on_arm(data)
        self._carried_for = self._carried_for + 1 if is_carried else 0
        return self.lies_on_arm != before

    @property
    def lies_on_arm(self) -> bool:
        """Whether the peg has touched the arm for more than 15 plannings."""
        return self._carried_for > 15

    def update(self, physics: Any, is_led: bool = False) -> None:
        """Decides the stage, after `observe`, and searches for a path to a peg that is not held.

        The arm may be led to where it rakes on another path.
        """
        data = physics.named.data
        if self.has:
            self.rake.goal, self._near_for, self.withdraws = None, 0, 0
        else:
            self._lose_patience(data)
            self.forecast.update(physics)
            self._decide_on_raking(data)
        if self.paths is None:
            return
        moves = len(self.forecast.poses) > 0
        self.rake.choose_spot(data, self.walls, is_led, moves, self.lies_on_arm)
        if not self.has:
            self._search(self.paths, data)
            self.is_blocked = self._passes_walls(self.paths, data.qpos[ARM])
            if self.is_blocked:
                self.paths.forget()

    def _lose_patience(self, data: Any) -> None:
        """Withdraws the hand for 10 plannings after 25 near the object without a grasp."""
        if self.paths is not None and self.rake.goal is not None:
            self._near_for = self.withdraws = 0  # a peg is raked from elsewhere instead
            return
        if self.withdraws:
            self.withdraws -= 1
            return
        offset = data.site_xpos["grasp"] - data.site_xpos[self.prop.name]
        self._near_for += bool(arrays.norm(offset) < 0.75 * _AWAY)
        if self._near_for > 25:
            self._near_for, self.withdraws = 0, 10

    def _decide_on_raking(self, data: Any) -> None:
        """Rakes an object that comes to rest out of reach; a rolling one may come by itself."""
        if self.rake.goal is None and not self.forecast.settles:
            return
        end = self.forecast.met(data)[-1:]
        (takes,) = self.poses_around(end, data.qpos[ARM], self.draws, _TAKES)
        if self.rake.judge(data, len(takes) > 0):
            self._near_for = 0

    def _search(self, paths: PegPaths, data: Any) -> None:
        """Searches for a path to a peg that lies still within reach, or to let one fall."""
        now = data.qpos[ARM]
        if self.lies_on_arm:
            paths.search_room(now, STRETCHED)
            return
        moves = np.abs(data.qvel[self.prop.joints]).max() > 2.0  # metres or radians per second
        aloft = height_above_ground(data.site_xpos["peg"]) > LIES
        if self.withdraws or moves or aloft or self.rake.goal is not None:
            paths.forget()
            return
        peg = pose_of(data, "peg")

        def straight_on() -> np.ndarray:
            (aligned,) = self.poses_around([peg], now, self.draws, 12, tilt=_ALIGNED)
            return aligned if len(aligned) else self.poses_around([peg], now, self.draws, 12)[0]

        paths.search_peg(now, peg, straight_on)

    def _passes_walls(self, paths: PegPaths, now: np.ndarray) -> bool:
        """Whether the path to the peg passes through walls."""
        along = paths.plans(now, 24) if len(self.walls.radii) else []
        if not len(along):
            return False
        poses = along[0][1:, : len(ARM)]
        between = np.concatenate([poses[1:], (poses[1:] + poses[:-1]) / 2])
        return bool(clearance(between, HAND, self.walls)[:, 0].min() < TOUCHING)

    def _hold(self, data: Any, offset: tuple[Any, Any]) -> Any:
        """Quality of the hand's hold on the object at an offset, 0 to 1, (N,)."""
        # A little play in the hand is no reason to stand still.
        return np.minimum(PLAY * self.prop.firmness(data, offset), 1.0)

    def terms(
        self, data: Any, carrying: _Carrying, path: Path | None = None
    ) -> dict[str, np.ndarray]:
        """Terms of the stage; those of fetching and carrying are blended by the hold.

        For the quality of the hold, (N,), `carrying` returns how certain it is that the object
        needs no fetching, 0 to 1, and the cost of carrying, (N,) each. The path is followed first.
        """
        low = {"hand at the floor": np.maximum(0.03 - data.site_xpos["grasp", "z"], 0.0)}
        if self.withdraws:
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
        offset = self.prop.offset(data)
        secure, carry = carrying(self._hold(data, offset))
        fetch = self._approach(data, offset) if path is None or self.has else self._led(data, path)
        return {"carry": secure * carry, "fetch": (1.0 - secure) * (_LOOSE + fetch), **low}

    def _led(self, data: Any, path: Path) -> np.ndarray:
        """Cost of the rest of the arm's path to the object, (N,)."""
        unready = np.abs(fingers(data) - self.prop.grip.ready)
        return 2.0 + 1.5 * PER_RADIAN * path.remaining(data.qpos[ARM]) + 2.0 * unready

    def _approach(self, data: Any, offset: tuple[Any, Any]) -> np.ndarray:
        """Cost of the distance from holding the object at an offset, (N,)."""
        ahead, aside = offset
        distance = np.hypot(ahead - np.clip(ahead, 0.0, self.prop.grip.slack), aside)
        turn = self.prop.misalignment(data)
        # With the object beside it the hand must first back off: the fingers are in the way.
        beside = np.abs(aside) - 0.012 + 0.05 * turn
        detour = np.maximum(np.clip(1.5 * beside, 0.0, 0.07) - ahead, 0.0)
        is_far = np.clip((distance - 0.006) / 0.012, 0.0, 1.0)
        unready = np.abs(fingers(data) - self.prop.opening(offset))
        # An object on the arm must fall before the hand can have it.
        aloft = np.maximum(height_above_ground(data.site_xpos[self.prop.name]) - 0.15, 0.0)
        trouble = 0.5 * turn + 2.0 * is_far * unready + self.prop.chased(data) + 4.0 * aloft
        distance = distance + detour
        # Steeper near the object, where it would else not pay to risk a touch.
        approach = 4.0 * distance + 0.5 * distance / (distance + 0.03)
        if self.paths is not None:
            approach = self.paths.cost_to_peg(data.qpos[ARM], approach) + across(data, turn)
        return approach + trouble

    def plans(self, data: Any, random: np.random.Generator, carrying: _Proposing) -> np.ndarray:
        """Plans of the stage, those along a path first, (n, knots, 5)."""
        now, stage = data.qpos[ARM], self.stage
        if stage is Stage.WITHDRAW:
            proposals = lifts(random, data, OPEN_ANGLE)
        elif self.rake.goal is not None:
            proposals = self.rake.at().proposals(random, data, self.rake.goal)
        else:
            proposals = (carrying if stage is Stage.CARRY else self._reaching)(data, random)
        proposals.append(Proposal([now], [OPEN_ANGLE]))
        plans = plans_of(now, proposals, self._knots)
        if stage is Stage.RAKE and self.paths is not None:
            return plans
        plans = plans[random.permutation(len(plans))]
        if self.paths is None:
            return plans
        return np.concatenate([self.paths.plans(now, self._knots), plans])

    def _reaching(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to grasp the object: straight on to a peg at rest, else where it will be."""
        now, grip = data.qpos[ARM], self.prop.grip
        proposals = [Proposal([now], [grip.shut])]
        if self.paths is None or self.forecast.poses:
            return proposals + self._meeting(data, random)
        back = nudged(now, -BACK * direction(now.sum()), 0.0)
        proposals.extend(straight_to([back], OPEN_ANGLE, 1, 3))
        peg = [pose_of(data, "peg")]
        for few, tilt in ((3, _ALIGNED), (2, 0.5)):
            (poses,) = self.poses_around(peg, now, random, few, tilt=tilt)
            proposals.extend(approaches(poses, grip.ready, grip.shut))
        return proposals

    def _meeting(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to the object's next poses, at once or from ahead; the hand closes there."""
        now, grip = data.qpos[ARM], self.prop.grip
        proposals: list[Proposal] = []
        takes = self.poses_around(self.forecast.met(data), now, random, _TAKES)
        for number, knot in enumerate(MEETS):
            poses = takes[min(number, len(takes) - 1)]
            grasp = [grip.ready] * knot + [grip.shut]
            for pose, before in zip(poses, drawn_back(poses, BACK), strict=True):
                proposals.append(Proposal([pose], grasp, knot))
                if not np.isfinite(before[0]):
                    continue
                if knot > 1:
                    proposals.append(Proposal([before, pose], grasp, knot // 2))
                proposals.append(Proposal([before], [grip.ready], knot))
        return proposals

    def poses_around(
        self,
        objects: list[Pose],
        now: np.ndarray,
        random: np.random.Generator,
        count: int,
        back: float = 0.0,
        tilt: float = 0.5,
    ) -> list[np.ndarray]:
        """Arm joints around each pose of the object with the hand clear of the walls, (n, 4).

        The hand keeps `back` metres away. It is straight on to a peg to within `tilt` radians.
        """
        wanted, grip = max(count, self._fewest), self.prop.grip
        places, *turned = self.prop.grasps(objects, tilt)
        each = places, self.prop.reach + back, now, self._spare * wanted, *turned
        clear = {"width": grip.width, "slack": 1.5 * grip.slack}
        found = hand_poses_each(random, *each, **clear)
        left = [poses[self.is_clear(poses)] for poses in found]
        return [poses[:: max(1, len(poses) // wanted)][:count] for poses in left]

    def is_clear(self, poses: np.ndarray) -> np.ndarray:
        """In which poses (n, 4) the hand is not in the walls, (n,)."""
        if not len(self.walls.radii):
            return np.ones(len(poses), bool)
        return clearance(poses, HAND, self.walls)[:, 0] > TOUCHING
