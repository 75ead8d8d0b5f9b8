"""`Insert`: the cost of insert_ball and insert_peg.

The object is fetched as to bring it (`fetch.py`). The arm carries it before the mouth of the
receptacle, on a path around the receptacle's walls (`guide.py`). There a ball is released, and
falls or rolls in (`insert_ball.py`); a peg is pushed in by small straight steps (`insert_peg.py`).
A failed attempt is repeated from another pose. An object in its place is left there.
"""

from typing import Any, ClassVar

import numpy as np

from limberjack.planner.arm.hand import ARM, LONGEST, OPEN_ANGLE, PLANE, loose, sag
from limberjack.planner.arm.kinematics import GRASP, hand_poses
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, lifts, plans_of, straight_to
from limberjack.planner.arm.roadmap import find_path, roadmap
from limberjack.planner.cost import Cost
from limberjack.planner.manipulator.fetch import PER_RADIAN, Fetch, Stage
from limberjack.planner.manipulator.grips import BACK, PRESS
from limberjack.planner.manipulator.guide import GOALS, Guide, few_of
from limberjack.planner.manipulator.insert_ball import BallInsertion, Release
from limberjack.planner.manipulator.insert_peg import PegInsertion
from limberjack.planner.manipulator.props import Ball, prop_of
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.utils import arrays

__all__ = ["Insert"]

_FACING = 0.7  # cosine between hand and axis, from which on the hand faces the mouth
_ARRIVED = 0.5  # radians; the arm is at the end of a path that is so near
_PATIENCE = 10  # plannings between searches for a path


class Insert(Cost):
    """Cost of fetching the object, and of inserting it."""

    weights: ClassVar = {"hand at the floor": 5.0, "ball on the arm": 20.0}

    def __init__(self, task: Any) -> None:
        """Takes a `manipulator.Bring` task that inserts."""
        super().__init__(task)
        prop = prop_of(task)
        self.settings = prop.settings
        self._receptacle = Receptacle.for_object(prop.name)
        roadmap()  # draws it before the first planning
        self.reset()

    def reset(self) -> None:
        """Discards the stage, the forecast and the paths."""
        prop, slot = prop_of(self.task), self._receptacle
        self._sag = np.zeros(4)  # radians by which gravity bends the arm away from its targets
        self._guide = Guide()  # around the receptacle
        self._release: Release | None = None
        if isinstance(prop, Ball):
            self._fetch = fetch = Fetch(prop, self.settings, spare=2)
            self._insertion = BallInsertion(fetch, slot)
            self._release = Release(self.task, fetch, slot)
        else:
            self._fetch = fetch = Fetch(prop, self.settings, spare=2, fewest=8)
            self._insertion = PegInsertion(fetch, slot, self.settings.knots)
        self._stands_at = np.full(3, np.nan)  # place of the receptacle, metres
        self._had = self._is_in = self._at_mouth = False
        self._found_at = np.zeros(3)  # place of the object when a path to it was found
        self._attempts = 0  # to take it
        self._trials = 0  # to insert it since it was taken

    # In this order: the first that is due is the stage, or else that of fetching.
    _TRANSITIONS = (
        (Stage.RELEASE, lambda self: self._release is not None and self._release.waits > 0),
        (Stage.SHAKE, lambda self: self._release is not None and self._release.shakes > 0),
        (Stage.LEAVE, lambda self: self._is_in and not self._fetch.has),
        (Stage.INSERT, lambda self: self._at_mouth and self._fetch.stage is Stage.CARRY),
    )

    @property
    def _stage(self) -> Stage:
        due = (stage for stage, is_due in self._TRANSITIONS if is_due(self))
        return next(due, self._fetch.stage)

    def stage(self) -> tuple[Any, ...]:
        """The stage, the choices in it, and the path that the arm follows."""
        choices = self._fetch.choices()
        return self._stage, choices, self._guide.path, self._at_mouth, self._is_in

    def update(self, physics: Any) -> None:
        """Decides the stage and the arm's path."""
        data, fetch, guide = physics.named.data, self._fetch, self._guide
        fetch.observe(data)
        if self._release is not None and self._release.update(physics):
            return
        self._observe(physics)
        if self._is_in and not fetch.has:
            fetch.rake.goal = guide.path = None
            self._sag = np.zeros(4)
            self.noise_scale = 0.1
            return
        self._update_fetch(physics)
        self._sag = sag(physics, self.settings.gain)
        guide.patience -= 1
        if guide.path is not None:
            guide.path.advance(data.qpos[ARM])
        if fetch.has:
            self._carry_on(physics)
        else:
            self._approach(data)
        self.noise_scale = self._insertion.noise_scale if self._at_mouth else 1.0

    def _observe(self, physics: Any) -> None:
        """Finds the receptacle's walls, and decides whether the object is in its place."""
        data, slot, has = physics.named.data, self._receptacle, self._fetch.has
        place = data.site_xpos[slot.target]
        if not np.array_equal(place, self._stands_at):
            self._stands_at, self._fetch.walls = place.copy(), slot.walls(physics)
        if has != self._had:
            self._guide.drop(0)
            self._trials = self._attempts = 0
        self._had = has
        self._at_mouth = self._at_mouth and has
        self._is_in = bool(slot.holds(slot.offset(data, slot.sites[0])) > 0.5)

    def _update_fetch(self, physics: Any) -> None:
        """Decides the stage of fetching; a new one may need another path."""
        fetch, guide = self._fetch, self._guide
        if fetch.watch_arm(physics.named.data):
            guide.drop(-1)
        spot = fetch.rake.spot
        fetch.update(physics, guide.path is not None)
        if fetch.rake.goal is not None and fetch.rake.spot is not spot:
            guide.drop(-1)
        if fetch.has and fetch.paths is not None:
            fetch.paths.forget()

    def _approach(self, data: Any) -> None:
        """Keeps the arm's path to the object, or searches for one around the receptacle."""
        fetch, guide, most = self._fetch, self._guide, self._insertion.attempts
        now, place = data.qpos[ARM], data.site_xpos[fetch.prop.name]
        if guide.path is not None:
            left = guide.left(now)
            if left < _ARRIVED:
                guide.drop(_PATIENCE)
                return
            # Where a rolling ball is awaited does not move with it.
            waits = self._release is not None and fetch.is_fast(data)
            has_moved = arrays.norm(place - self._found_at) > BACK and not waits
            if not guide.advances(left):
                self._attempts = most
            elif not has_moved and not guide.is_astray(now):
                return
        elif guide.patience >= 0:
            return
        guide.patience, self._found_at = _PATIENCE, place.copy()
        self._attempts += 1
        again = self._attempts > most
        path = self._insertion.path_to_object(data, self._attempts if again else 0)
        blocked = path is not None and not path.is_straight
        is_needed = fetch.rake.goal is not None or fetch.lies_on_arm or fetch.is_blocked
        # An arm that has left a dead end does not return there because the path is straight now.
        keep = blocked or again or guide.path is not None or is_needed
        guide.follow(path if keep else None)
        if again and path is not None:
            self._attempts = most // 2

    def _carry_on(self, physics: Any) -> None:
        """Carries the object to the mouth; after three trials a ball to where its release works."""
        guide, release = self._guide, self._release
        if release is None:
            self._carry_to_mouth(physics)
            return
        if release.is_due:
            release.seek(physics, guide)
            return
        searches = guide.path is None and guide.patience <= 0
        waited = self._at_mouth and guide.patience < 0
        self._carry_to_mouth(physics)
        finds_none = searches and guide.path is None
        if not self._at_mouth and (finds_none or waited or self._trials > 3):
            release.is_due, guide.path = True, None

    def _carry_to_mouth(self, physics: Any) -> None:
        """Decides whether the object is before the mouth, or else the arm's path there."""
        data, guide, slot = physics.named.data, self._guide, self._receptacle
        now = data.qpos[ARM]
        awry = max(_FACING - float(slot.facing(data)), 0.0)
        is_near = slot.from_mouth(data) + 0.1 * awry < (0.1 if self._at_mouth else 0.07)  # metres
        left = guide.left(now)
        if self._at_mouth:
            if is_near and (guide.patience >= 0 or self.task.get_reward(physics) > 0.5):
                return
            # It took too long, or the object has gone: now from elsewhere.
            self._at_mouth, guide.patience = False, 0
            self._trials += 1
        elif left < _ARRIVED or (is_near and self._trials == 0):
            self._at_mouth = True
            guide.drop(self._insertion.long)
            return
        if guide.path is not None:
            if not guide.advances(left):
                guide.drop(0)
                self._trials += 1
            elif guide.is_astray(now):
                guide.drop(min(guide.patience, 0))
        if guide.path is None and guide.patience <= 0:
            guide.patience = _PATIENCE
            guide.follow(self._path_to_mouth(data))

    def _path_to_mouth(self, data: Any) -> Path | None:
        """The arm's path around the receptacle to before its mouth; another one at each trial."""
        insertion, slot, walls = self._insertion, self._receptacle, self._fetch.walls
        random = np.random.default_rng(self._trials)
        for over in insertion.over:
            goals = slot.poses(data, random, slot.before + over, 0.0, GOALS)
            if self._trials:  # few: not where it has not succeeded
                goals = few_of(random, goals)
            for held in insertion.held:
                path = find_path(data.qpos[ARM], goals, held, walls, insertion.close)
                if path is not None:
                    return path
        return None

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        """Terms of the stage; those of fetching and inserting are blended by the hold."""
        data, path = physics.named.data, self._guide.path
        if self._release is not None and self._release.is_busy:
            return self._release.terms(physics)

        def carrying(held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            slot = self._receptacle
            offsets = slot.offsets(data)
            cost = 1.0 - self.task.get_reward(physics) + held * loose(physics, PRESS)
            if path is not None and self._fetch.has:
                left = PER_RADIAN * path.remaining(data.qpos[ARM])
            else:
                left = slot.distance(offsets) / (0.1 if self._at_mouth else LONGEST)  # metres
                left = left + held * np.maximum(_FACING - slot.facing(data), 0.0)
            # At most 4: always less than what an object costs that is not held.
            cost = cost + 4.0 * np.tanh(left / 4.0)
            return np.maximum(held, slot.holds(offsets[0])), cost

        return self._fetch.terms(data, carrying, path)

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Plans of the stage, above its targets by the arm's sag."""
        found = self._plans(physics.named.data, random)
        found[..., :4] += self._sag
        return found

    def _plans(self, data: Any, random: np.random.Generator) -> np.ndarray:
        """The same for an arm that follows exactly, (n, knots, 5)."""
        now, knots, fetch = data.qpos[ARM], self.settings.knots, self._fetch
        if self._release is not None and self._release.is_busy:
            return self._release.plans(data, random, knots)
        if self._stage is Stage.LEAVE:
            above = data.site_xpos["grasp"][PLANE] - 0.05 * data.site_xmat["grasp"][[2, 8]]
            poses = hand_poses(random, above, GRASP, now, 4, float(now.sum()), 0.3)
            leaving = straight_to(poses, OPEN_ANGLE, 1, 3)
            return plans_of(now, [Proposal([now], [OPEN_ANGLE]), *leaving], knots)
        found = fetch.plans(data, random, self._carrying)
        if self._guide.path is None:
            return found
        grasp = fetch.prop.grip.shut if fetch.has else OPEN_ANGLE
        return np.concatenate([self._guide.plans(now, grasp, knots), found[:12]])

    def _carrying(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals that carry the object to the mouth, and in."""
        now, slot, press = data.qpos[ARM], self._receptacle, self._fetch.prop.grip.shut
        proposals = [Proposal([now], [press])]
        up, beside = slot.offset(data, slot.sites[0])
        if np.hypot(up - slot.before, beside) < 0.06 or (up > 0 and abs(beside) < slot.width):
            proposals.extend(self._insertion.proposals_in(data, random))
            poses = slot.poses(data, random, slot.before, 0.0, 2)
        else:
            poses = slot.poses(data, random, slot.before, 0.0, 6)
            high = slot.poses(data, random, slot.before + 0.06, 0.0, 3)
            proposals.extend(straight_to(high, press, 1, 3))
        proposals.extend(straight_to(poses, press, 1, 2, 4))
        return [*proposals, *lifts(random, data, press)[::2]]
