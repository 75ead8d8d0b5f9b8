"""Cost of bring_ball: reach, grasp and carry.

The ball is fetched first: the open hand comes from ahead of it, then closes. Once it is held,
being far from the target costs. How well it is held is a number between 0 and 1, so that fetching
and carrying blend within one plan. An object out of reach is raked inwards with a fingertip
first.

`bring_peg.py` and `insert.py` build on this cost, which therefore speaks of an object.
"""

import contextlib
from collections.abc import Iterator
from typing import Any, ClassVar

import mujoco
import numpy as np

from limberjack.planner.arm.hand import (
    ARM,
    LONGEST,
    OPEN_ANGLE,
    PLANE,
    PLAY,
    fingers,
    in_hand,
    loose,
    near,
    outward_speed,
)
from limberjack.planner.arm.kinematics import (
    GRASP,
    angle_of,
    drawn_back,
    hand_poses,
    hand_poses_each,
)
from limberjack.planner.arm.proposals import Proposal, lifts, plans_of
from limberjack.planner.cost import Cost
from limberjack.planner.manipulator.grips import (
    BACK,
    BALL,
    BALL_SETTINGS,
    Pose,
    against_hand,
    downwards,
    height_above_ground,
    in_world,
    pose_of,
)
from limberjack.planner.manipulator.raking import raking_cost, raking_proposals
from limberjack.rl.control import PhysicsError
from limberjack.utils import arrays

__all__ = ["Bring"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value
_LOOSE = 8.0  # cost of an object that is not held, more than of any that is
_HAS = 0.3  # of how well an object is held: from when on the hand has it
_LENIENT = 0.06  # one less the cosine; how far from upright a hand may be that takes a ball
_HEAVY = 1e4  # kg m2; an arm that does not move while the object's path is foreseen
_MEETS = 1, 2, 4  # knots at which an object that moves may be met
_TAKES = 4  # poses of the arm that are tried for each
_DOUBTS = 2  # plans that must contradict the known reach of an object before it changes
_PRESS = 0.25  # control of the grasp under which an object may slip
_AT_REST = 0.02  # metres or radians per second
_ALOFT = 0.15  # metres above the ground; what is there falls, or lies on the arm
_AWAY = 0.17  # metres; how far the hand goes away from what it failed to take
_PATIENCE, _WITHDRAWAL = 25, 10  # plans; how long it tries, and how long it then goes away


class Bring(Cost):
    """Fetches the ball, and brings it to the target."""

    settings = BALL_SETTINGS
    weights: ClassVar = {"hand at the floor": 5.0}
    _object, _grip = "ball", BALL

    def __init__(self, task: Any) -> None:
        """Takes a `manipulator.Bring` task."""
        super().__init__(task)
        self.reset()

    def reset(self) -> None:
        """Discards the stage and the predicted poses."""
        self._draws = np.random.default_rng(0)  # a look must not shift the samples' stream
        self._has = False  # whether the hand has the object
        self._coming: list[Pose] = []  # where the object will be at the plan's knots
        self._sag = np.zeros(4)  # radians by which gravity bends the arm away from its targets
        self._near_for = 0  # plans in which the hand was near the object without holding it
        self._withdraws = 0  # plans in which it still goes away, to come again another path
        self._settles = False  # whether it will soon lie still
        self._rake_to: float | None = None  # x, metres, while the object is out of reach
        self._doubts = 0  # plans that found the contrary of what is known of the object's reach

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        """Terms of fetching and carrying, blended by the hold; or of raking, or of withdrawing."""
        data = physics.named.data
        low = {"hand at the floor": np.maximum(0.03 - data.site_xpos["grasp", "z"], 0.0)}
        if self._withdraws:
            hand = data.site_xpos["grasp"]
            near_by = np.maximum(_AWAY - arrays.norm(hand - data.site_xpos[self._object]), 0.0)
            moved = arrays.norm(data.qvel[self.task.object_joints][..., :2])
            return {"withdraw": 2.0 * _LOOSE + 20.0 * near_by + 2.0 * moved, **low}
        if self._rake_to is not None:
            return {"rake": 2.0 * _LOOSE + self._raking(data, self._rake_to), **low}
        offset = self._offset(data)
        held = self._held(data, offset)
        secure, carry = self._carrying(physics, held)
        fetch = _LOOSE + self._fetching(data, offset)
        return {"carry": secure * carry, "fetch": (1.0 - secure) * fetch, **low}

    def _raking(self, data: Any, goal: float) -> np.ndarray:
        """Cost of raking the object to a goal: x, metres, (N,)."""
        return raking_cost(data, self._object, goal)

    def _carrying(self, physics: Any, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Quality of the hold, 0 to 1, and cost of carrying, (N,) each."""
        return held, self._to_target(physics) + loose(physics, _PRESS)

    def _to_target(self, physics: Any) -> np.ndarray:
        """Distance of the object from the target, plus the missing reward, (N,)."""
        missing = 1.0 - self.task.get_reward(physics)
        return self._gap(physics.named.data) / LONGEST + missing

    def _gap(self, data: Any) -> np.ndarray:
        """Distance of the object from the target, (N,), metres."""
        return arrays.norm(data.site_xpos["ball"] - data.site_xpos["target_ball"])

    def _held(self, data: Any, offset: tuple[Any, Any]) -> np.ndarray:
        """Quality of the hand's hold on an object at an offset, 0 to 1, (N,)."""
        # A little play in the hand is no reason to stand still.
        return np.minimum(PLAY * self._firm(data, offset), 1.0)

    def _firm(self, data: Any, offset: tuple[Any, Any]) -> np.ndarray:
        """1 where the object is right between the closed fingers, 0 far from there, (N,)."""
        ahead, aside = offset
        ahead = ahead - np.clip(ahead, 0.0, self._grip.slack)
        grip = self._grip
        closed = np.clip((fingers(data) - grip.ready) / (grip.firm - grip.ready), 0.0, 1.0)
        return near(np.hypot(ahead, aside), 0.012) * closed

    def _offset(self, data: Any) -> tuple[Any, Any]:
        """Distances of the object ahead and aside of the point of the grasp, (N,) each, metres."""
        return in_hand(data, self._place(data))

    def _place(self, data: Any) -> np.ndarray:
        """Position at which the grasp site belongs, (..., 3)."""
        frame = data.site_xmat[self._object]
        return data.site_xpos[self._object] + in_world(frame, self._grip.place)

    def _misalignment(self, data: Any) -> Any:
        """One less the cosine between the hand and how it should point, 0 near enough, (...)."""
        return np.maximum(against_hand(data, downwards(data.site_xpos["ball"])) - _LENIENT, 0.0)

    def _fetching(self, data: Any, offset: tuple[Any, Any]) -> np.ndarray:
        """Cost of the distance from holding an object at an offset, (N,)."""
        ahead, aside = offset
        distance = np.hypot(ahead - np.clip(ahead, 0.0, self._grip.slack), aside)
        turn = self._misalignment(data)
        # With the object beside it the hand must first back off: the fingers are in the way.
        beside = np.abs(aside) - 0.012 + 0.05 * turn
        detour = np.maximum(np.clip(1.5 * beside, 0.0, 0.07) - ahead, 0.0)
        is_far = np.clip((distance - 0.006) / 0.012, 0.0, 1.0)
        unready = np.abs(fingers(data) - self._opening(ahead, aside))
        # What lies on the arm must fall before the hand can have it.
        aloft = np.maximum(height_above_ground(data.site_xpos[self._object]) - _ALOFT, 0.0)
        trouble = 0.5 * turn + 2.0 * is_far * unready + self._chased(data) + 4.0 * aloft
        return self._to_object(data, distance + detour, turn) + trouble

    def _opening(self, ahead: Any, aside: Any) -> Any:
        """The fingers' angle with which the hand comes to where the object is in it, radians."""
        return self._grip.ready

    def _chased(self, data: Any) -> np.ndarray:
        """Cost of the motion of an object that is to be grasped, (N,)."""
        return outward_speed(data, self.task.object_joints[0], self._object)

    def _to_object(self, data: Any, distance: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Cost of the hand's distance, metres, and of its turn, (N,) each."""
        # Steeper near the object, where it would else not pay to risk a touch.
        return 4.0 * distance + 0.5 * distance / (distance + 0.03)

    def update(self, physics: Any) -> None:
        """Decides the stage, from whether the hand holds the object."""
        data = physics.named.data
        self._has = bool(self._held(data, self._offset(data)) > _HAS)
        self._decide(physics)

    def stage(self) -> Any:
        """The stage: held, raked, withdrawing, or rolling."""
        return self._has, self._rake_to is None, self._withdraws > 0, len(self._coming) > 0

    def _decide(self, physics: Any) -> None:
        """Predicts the object's poses, and rakes an object that is out of reach."""
        data = physics.named.data
        if self._has:
            self._rake_to, self._near_for, self._withdraws = None, 0, 0
            self._turn_rake(data)
            self._find_path_to_target(physics)
            return
        self._lose_patience(data)
        self._coming = self._foreseen(physics)
        if self._rake_to is not None or self._settles:  # what rolls may come by itself
            end = self._met(data)[-1:]
            takes = self._poses_around(end, data.qpos[ARM], self._draws, _TAKES)[0]
            if not self._is_sure(len(takes) > 0):
                self._rake_to = self._rake_goal(data)
            elif self._rake_to is not None:
                self._rake_to, self._near_for = None, 0
        self._turn_rake(data)
        self._find_path_to_object(physics)

    def _met(self, data: Any) -> list[Pose]:
        """The object's poses where the hand may take it: at each of `_MEETS`, or one if at rest."""
        last = len(self._coming)
        at = [self._coming[min(knot, last) - 1] for knot in _MEETS if last]
        return at or [pose_of(data, self._object)]

    def _turn_rake(self, data: Any) -> None:
        """Decides from where the object is raked: always from behind its middle."""

    def _raked_site(self) -> str:
        """The object's site that is raked."""
        return self._object

    def _is_sure(self, within: bool) -> bool:
        """Whether the object is within reach, which a few plans must agree on to change it."""
        if within == (self._rake_to is None):
            self._doubts = 0
            return within
        self._doubts += 1
        return within if self._doubts > _DOUBTS else not within

    def _find_path_to_target(self, physics: Any) -> None:
        """Searches for a path to the target; a ball needs none."""

    def _find_path_to_object(self, physics: Any) -> None:
        """Searches for a path to the object; to a ball none is needed."""

    def _lose_patience(self, data: Any) -> None:
        """Withdraws the hand if it has been near the object for long without a grasp."""
        if self._withdraws:
            self._withdraws -= 1
            return
        offset = data.site_xpos["grasp"] - data.site_xpos[self._object]
        self._near_for += bool(arrays.norm(offset) < 0.75 * _AWAY)
        if self._near_for > _PATIENCE:
            self._near_for, self._withdraws = 0, _WITHDRAWAL

    def _foreseen(self, physics: Any) -> list[Pose]:
        """The object's poses at the plan's knots, if the arm stays where it is; none at rest."""
        data, state = physics.named.data, physics.get_state(_STATE)
        joints = self.task.object_joints
        self._settles = bool(np.abs(data.qvel[joints]).max() < _AT_REST)
        if self._settles:
            return []
        span = self.settings.horizon / (self.settings.knots - 1)
        found: list[Pose] = []
        with contextlib.suppress(PhysicsError), _stays(physics):
            physics.forward()
            for _ in range(self.settings.knots - 1):
                physics.step(round(span / physics.timestep()))
                found.append(pose_of(data, self._object))
        self._settles = bool(np.abs(data.qvel[joints]).max() < 10 * _AT_REST)
        physics.set_state(state, _STATE)
        physics.forward()
        return found

    def _rake_goal(self, data: Any) -> float:
        """Position in reach to which the object is raked: x, metres."""
        return 0.0

    def _poses_at_target(self, data: Any, random: np.random.Generator, count: int) -> np.ndarray:
        """Arm joints that have the object at the target, (n, 4), n <= count."""
        place, _ = pose_of(data, f"target_{self._object}")
        return hand_poses(random, place[PLANE], GRASP, data.qpos[ARM], count)

    def _poses_around(
        self,
        objects: list[Pose],
        now: np.ndarray,
        random: np.random.Generator,
        count: int,
        back: float = 0.0,
        tilt: float = 0.5,
    ) -> list[np.ndarray]:
        """Arm joints that have the hand around an object, (n, 4) for each of its poses.

        Args:
          objects: the poses.
          now: the arm's joints, (4,).
          random: draws the redundancy.
          count: how many at most, for each.
          back: how far the hand is to stand off.
          tilt: radians that a hand may come from beside what has a direction.
        """
        places = np.array([place for place, _ in objects])
        down = angle_of(downwards(places)[:, PLANE])
        clear = {"width": self._grip.width, "slack": 1.5 * self._grip.slack}
        each = places[:, PLANE], GRASP + back, now, count
        return hand_poses_each(random, *each, down, 0.8, **clear)

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Straight joint paths that fetch the object or carry it to the target."""
        found = self._tried(physics, random)
        found[..., :4] += self._sag
        return found

    def _tried(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """The same for an arm that follows exactly, (n, knots, 5)."""
        data = physics.named.data
        now = data.qpos[ARM]
        if self._withdraws:
            place, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
            proposals = lifts(random, place, angle, now, OPEN_ANGLE)
        elif self._rake_to is not None:
            proposals = raking_proposals(
                random, data.site_xpos[self._raked_site()], self._rake_to, now
            )
        elif self._has:
            proposals = self._carrying_proposals(data, random)
        else:
            proposals = self._fetching_proposals(data, random)
        proposals.append(Proposal([now], [OPEN_ANGLE]))
        return plans_of(now, proposals, self.settings.knots)[random.permutation(len(proposals))]

    def _carrying_proposals(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to the target, upwards, and none."""
        now, shut = data.qpos[ARM], self._grip.shut
        proposals: list[Proposal] = []
        for pose in self._poses_at_target(data, random, 6):
            proposals.extend(Proposal([pose], [shut], slow) for slow in (1, 2, 4))
        place, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
        proposals.extend(lifts(random, place, angle, now, shut))
        proposals.append(Proposal([now], [shut]))
        return proposals

    def _fetching_proposals(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to the object's next poses, at once or from ahead; the hand closes there."""
        now, grip = data.qpos[ARM], self._grip
        proposals = [Proposal([now], [grip.shut])]
        takes = self._poses_around(self._met(data), now, random, _TAKES)
        back = np.split(
            drawn_back(np.concatenate(takes), BACK), np.cumsum([len(poses) for poses in takes])[:-1]
        )
        for number, knot in enumerate(_MEETS):
            which = min(number, len(takes) - 1)
            grasp = [grip.ready] * knot + [grip.shut]
            for pose, before in zip(takes[which], back[which], strict=True):
                proposals.append(Proposal([pose], grasp, knot))
                if not np.isfinite(before[0]):
                    continue
                if knot > 1:
                    proposals.append(Proposal([before, pose], grasp, knot // 2))
                proposals.append(Proposal([before], [grip.ready], knot))
        return proposals


@contextlib.contextmanager
def _stays(physics: Any) -> Iterator[None]:
    """Within the context the arm of a single simulation is too heavy to move."""
    armature = physics.named.model.dof_armature
    before = armature[ARM].copy()
    armature[ARM], physics.named.data.qvel[ARM] = _HEAVY, 0.0
    try:
        yield
    finally:
        armature[ARM] = before
