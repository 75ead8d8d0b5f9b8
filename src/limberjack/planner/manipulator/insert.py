"""`Insert`: the cost of insert_ball and insert_peg.

The object is fetched as to bring it (`fetch.py`). The arm carries it before the mouth of the
receptacle (`receptacles.py`), on a path around its walls. There a ball is released, and falls or
rolls in (`release.py`); a peg is pushed in by small straight steps. A failed attempt is repeated
from another pose. An object in its place is left there.
"""

from typing import ClassVar

import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.hand import ARM, GAIN, LONGEST, OPEN_ANGLE, PLANE, loose, sag
from limberjack.planner.arm.kinematics import GRASP, direction, hand_poses, nudged
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, lifts, plans_of, straight_to
from limberjack.planner.arm.roadmap import find_path, roadmap
from limberjack.planner.cost import AnyTask, Cost
from limberjack.planner.manipulator.approach import GOALS, few_of
from limberjack.planner.manipulator.fetch import ARRIVED, PATIENCE, PER_RADIAN, Fetch, Stage
from limberjack.planner.manipulator.props import PRESS, Ball, prop_of
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.planner.manipulator.release import Release

__all__ = ["Insert"]

_STEPS = (0.02, 0.04, 0.08) * 4  # metres; from one pose to the next along the axis, in proposals
_FACING = 0.7  # cosine between hand and axis, from which on the hand faces the mouth
_COMES, _STAYS = 0.07, 0.1  # metres from the mouth, to be before it and to stay there
_AWRY = 0.1  # metres that a cosine counts as which lacks to face the mouth
_FALLS_IN = 3  # trials to let a ball just fall in, before a pose is tested from which it rolls in
_MOST_LEFT = 4.0  # cost of the way that is left: less than that of an object that is not held
_STILL = 0.1  # share of the noise, for a hand that leaves an object in its place
_AT_MOUTH = 0.1  # metres; scale of the distance that is left there
_CLOSE = 0.06  # metres from before the mouth, within which an object is proposed to go in
_HIGHER = 0.06  # metres above the place before the mouth, from where the arm may come to it


class Insert(Cost):
    """Cost of fetching the object, and of inserting it."""

    weights: ClassVar = {"hand at the floor": 5.0, "ball on the arm": 20.0}

    def __init__(self, task: AnyTask) -> None:
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
        self._fetch = fetch = Fetch(prop, self.settings)
        self._release = Release(self.task, fetch, slot) if isinstance(prop, Ball) else None
        self._sag = np.zeros(4)  # radians by which gravity bends the arm away from its targets
        self._stands_at = np.full(3, np.nan)  # place of the receptacle, metres
        self._is_in = self._at_mouth = False
        self._trials = 0  # to insert the object since it was taken

    @property
    def _stage(self) -> Stage:
        fetch, release = self._fetch, self._release
        if release is not None and release.is_busy:
            return Stage.RELEASE if release.waits > 0 else Stage.SHAKE
        if self._is_in and not fetch.has:
            return Stage.LEAVE
        return Stage.INSERT if self._at_mouth and fetch.stage is Stage.CARRY else fetch.stage

    def stage(self) -> tuple[object, ...]:
        """The stage and the choices in it."""
        return self._stage, self._fetch.choices(), self._at_mouth, self._is_in

    def update(self, physics: Physics) -> None:
        """Decides the stage and the arm's path."""
        data, fetch, slot = physics.named.data, self._fetch, self._receptacle
        if fetch.observe(data):
            self._trials = 0
        if self._release is not None and self._release.update(physics):
            return
        place = data.site_xpos[slot.target]
        if not np.array_equal(place, self._stands_at):
            self._stands_at = place.copy()
            fetch.approach.set_walls(slot.walls(physics))
        self._at_mouth = self._at_mouth and fetch.has
        self._is_in = bool(slot.holds(slot.offset(data, slot.sites[0])) > 0.5)
        if self._is_in and not fetch.has:
            fetch.rest()
            self._sag, self.noise_scale = np.zeros(4), _STILL
            return
        fetch.update(physics)
        self._sag = sag(physics, GAIN)
        if fetch.has:
            self._carry_on(physics)
        self.noise_scale = slot.noise_scale if self._at_mouth else 1.0

    def _carry_on(self, physics: Physics) -> None:
        """Carries the object to the mouth; after three trials a ball to where its release works."""
        fetch, release = self._fetch, self._release
        if release is None:
            self._carry_to_mouth(physics)
            return
        if release.is_due:
            release.seek(physics)
            return
        searches = fetch.path is None and fetch.patience <= 0
        waited = self._at_mouth and fetch.patience < 0
        self._carry_to_mouth(physics)
        finds_none = searches and fetch.path is None
        if not self._at_mouth and (finds_none or waited or self._trials > _FALLS_IN):
            release.begin()

    def _carry_to_mouth(self, physics: Physics) -> None:
        """Decides whether the object is before the mouth, or else the arm's path there."""
        data, fetch, slot = physics.named.data, self._fetch, self._receptacle
        awry = max(_FACING - float(slot.facing(data)), 0.0)
        is_near = slot.from_mouth(data) + _AWRY * awry < (_STAYS if self._at_mouth else _COMES)
        path = fetch.path
        if self._at_mouth:
            if is_near and (fetch.patience >= 0 or self.task.get_reward(physics) > 0.5):
                return
            # It took too long, or the object has gone: now from elsewhere.
            self._at_mouth = False
            fetch.drop_path(0)
            self._trials += 1
        elif (path is not None and path.left < ARRIVED) or (is_near and self._trials == 0):
            self._at_mouth = True
            fetch.drop_path(slot.patience)
            return
        if path is not None and (path.is_stalled or path.is_astray):
            fetch.drop_path(0)
            self._trials += path.is_stalled
        if fetch.path is None and fetch.patience <= 0:
            fetch.follow(self._path_to_mouth(data), PATIENCE)

    def _path_to_mouth(self, data: NamedFields) -> Path | None:
        """The arm's path around the receptacle to before its mouth; another one at each trial."""
        slot, walls = self._receptacle, self._fetch.approach.walls
        random = np.random.default_rng(self._trials)
        for over in slot.over:
            goals = slot.poses(data, random, slot.before + over, 0.0, GOALS)
            if self._trials:  # few: not where it has not succeeded
                goals = few_of(random, goals)
            for held in slot.held:
                path = find_path(data.qpos[ARM], goals, held, walls, slot.is_narrow)
                if path is not None:
                    return path
        return None

    def terms(self, physics: Physics) -> dict[str, np.ndarray]:
        """Terms of the stage; those of fetching and inserting are blended by the hold."""
        data, fetch, slot = physics.named.data, self._fetch, self._receptacle
        if self._release is not None and self._release.is_busy:
            return self._release.terms(physics)
        if fetch.stage not in (Stage.CARRY, Stage.FETCH):
            return fetch.terms(data)
        held, offsets = fetch.hold(data), slot.offsets(data)
        secure = np.maximum(held, slot.holds(offsets[0]))
        carry = 1.0 - self.task.get_reward(physics) + held * loose(physics, PRESS)
        if fetch.path is not None and fetch.has:
            left = PER_RADIAN * fetch.path.remaining(data.qpos[ARM])
        else:
            left = slot.distance(offsets) / (_AT_MOUTH if self._at_mouth else LONGEST)
            left = left + held * np.maximum(_FACING - slot.facing(data), 0.0)
        carry = carry + _MOST_LEFT * np.tanh(left / _MOST_LEFT)
        return {"carry": secure * carry, **fetch.terms(data, 1.0 - secure)}

    def proposals(self, physics: Physics, random: np.random.Generator) -> np.ndarray:
        """Plans of the stage, above its targets by the arm's sag."""
        data, fetch = physics.named.data, self._fetch
        if self._release is not None and self._release.is_busy:
            found = self._release.plans(data, random, self.settings.knots)
        elif self._stage is Stage.LEAVE:
            found = self._leaving(data, random)
        else:
            carrying = self._carrying(data, random) if fetch.stage is Stage.CARRY else []
            found = fetch.plans(data, random, carrying)
        found[..., :4] += self._sag
        return found

    def _leaving(self, data: NamedFields, random: np.random.Generator) -> np.ndarray:
        """Plans of the open hand back along its fingers, and to keep still, (n, knots, 5)."""
        now = data.qpos[ARM]
        behind = data.site_xpos["grasp"][PLANE] - 0.05 * data.site_xmat["grasp"][[2, 8]]
        poses = hand_poses(random, behind, GRASP, now, 4, float(now.sum()), 0.3)
        leaving = straight_to(poses, OPEN_ANGLE, 1, 3)
        return plans_of(now, [Proposal([now], [OPEN_ANGLE]), *leaving], self.settings.knots)

    def _carrying(self, data: NamedFields, random: np.random.Generator) -> list[Proposal]:
        """Proposals that carry the object to the mouth, and in."""
        now, slot, press = data.qpos[ARM], self._receptacle, self._fetch.prop.shut
        proposals = [Proposal([now], [press])]
        up, beside = slot.offset(data, slot.sites[0])
        if np.hypot(up - slot.before, beside) < _CLOSE or (up > 0 and abs(beside) < slot.width):
            if self._release is None:
                proposals.extend(_pushing_in(slot, data, random, self.settings.knots))
            else:
                proposals.extend(_letting_fall(slot, data, random))
            poses = slot.poses(data, random, slot.before, 0.0, 2)
        else:
            poses = slot.poses(data, random, slot.before, 0.0, 6)
            high = slot.poses(data, random, slot.before + _HIGHER, 0.0, 3)
            proposals.extend(straight_to(high, press, 1, 3))
        proposals.extend(straight_to(poses, press, 1, 2, 4))
        return [*proposals, *lifts(random, data, press)[::2]]


def _letting_fall(
    cup: Receptacle, data: NamedFields, random: np.random.Generator
) -> list[Proposal]:
    """Proposals to let the ball fall from here and from places above the mouth.

    These are 50 mm below to 30 mm above the usual one, and up to 16 mm beside it.
    """
    now, ball = data.qpos[ARM], cup.prop
    proposals: list[Proposal] = []
    for let_go in (OPEN_ANGLE, ball.ready):
        proposals.append(Proposal([now], [let_go]))
        proposals.append(Proposal([now], [ball.shut, let_go]))
        for up, beside in (random.uniform([-0.05, -0.016], [0.03, 0.016]) for _ in range(8)):
            for pose in cup.poses(data, random, cup.before + up, beside, 1):
                proposals.append(Proposal([pose], [ball.shut, let_go]))
                proposals.append(Proposal([pose], [let_go], 2))
    return proposals


def _pushing_in(
    slot: Receptacle, data: NamedFields, random: np.random.Generator, knots: int
) -> list[Proposal]:
    """Proposals that bring the peg over the slot, then along the axis into it."""
    now, press = data.qpos[ARM], slot.prop.shut
    (up, beside), (middle_up, middle_beside) = [(float(u), float(b)) for u, b in slot.offsets(data)]
    lean = np.arctan2(middle_beside - beside, middle_up - up + 0.05)  # upright 5 cm further on
    wrist = data.site_xpos["grasp"][PLANE] - GRASP * direction(now.sum())
    x, z = wrist - data.site_xpos["peg_tip"][PLANE]
    aside = max(abs(beside), abs(middle_beside))
    top = min(up, slot.before)
    before = [slot.before] if aside > 0.75 * slot.width and up > 0.06 else []
    moves: list[np.ndarray] = []
    turns: list[float] = []
    # Metres and radians by which the proposals differ: the slot is narrow.
    draws = random.normal(0.0, [0.0015, 0.01], (len(_STEPS), 2))
    for step, (off, turn) in zip(_STEPS, draws, strict=True):
        heights = [*before, *np.arange(top - step, -step, -step).tolist()][: knots - 1]
        places = np.reshape([[height - up, off - beside] for height in heights], (-1, 2))
        cos, sin = np.cos(turn + lean), np.sin(turn + lean)
        turned = np.array([cos * x - sin * z, sin * x + cos * z])
        moves.append(places @ slot.axes(data) + turned - [x, z])
        turns.extend([turn + lean] * len(heights))
    waypoints = nudged(now, np.concatenate(moves), np.array(turns))
    proposals: list[Proposal] = []
    for passed in np.split(waypoints, np.cumsum([len(some) for some in moves])[:-1]):
        proposals.append(Proposal(passed, [press]))
        proposals.append(Proposal(passed[:1], [press], 2))
    return proposals
