"""What the planner avoids in the manipulator's tasks: an object far from the hand or the target.

The object is fetched first: the open hand comes from ahead of it, then closes. Once it is held,
being far from the target costs. How well it is held is a number between 0 and 1, so that fetching
and carrying blend within one plan. What to do where the object is to be inserted is told in
`costs_insertion.py`.

What the hand cannot reach, or not from the side from which it can be held, is raked inwards with a
fingertip first. A peg that is held is brought along a route of the joints, because the way of the
object alone would not turn it round.
"""

import contextlib
from typing import Any

import numpy as np

from limberjack.planner.arm import (
    ARM,
    LONGEST,
    OPEN_ANGLE,
    PLANE,
    PLAY,
    approaches,
    fingers,
    in_hand,
    lifts,
    loose,
    near,
    outward_speed,
    path,
    sag,
)
from limberjack.planner.cost import Cost
from limberjack.planner.grips import (
    BALL,
    BALL_SETTINGS,
    HANDLE,
    PEG_SETTINGS,
    Grip,
    Pose,
    downwards,
    height_above_ground,
    in_world,
    pose_of,
)
from limberjack.planner.peg_ways import BACK, PegWays, across, grasp_of, opening
from limberjack.planner.planar_ik import (
    GRASP,
    angle_of,
    direction,
    hand_places,
    hand_poses,
    nudged,
)
from limberjack.planner.raking import raking_cost, raking_paths
from limberjack.rl.control import PhysicsError
from limberjack.utils import arrays

__all__ = ["Bring"]

_LOOSE = 8.0  # what an object costs that is not held: more than any that is
_ALIGNED = 0.1  # radians; a hand that comes to a peg so far from straight on takes it
_ROLLS = 2.0  # metres or radians per second; no way is looked for to a peg that moves so fast
_DOUBTS = 2  # plans that find the contrary of what was known of a peg's reach, before it counts
_GOALS, _TAKES = 24, 12  # poses at the target and at a peg to which ways are looked for
_LIES = 0.08  # metres above the ground; a peg that is higher does not lie on it
_KICK = 1.0  # per metre per second; what it costs that a peg moves that is not held
_HOLDS = 8  # how often between two knots the arm is put back while the object's way is foreseen
_PRESS = 0.25  # control of the grasp under which an object may slip
# Metres and radians per second above which a peg may slip out of the hand.
_SPEED, _SPIN = 3.0, 10.0
_AT_REST = 0.02  # metres or radians per second
_ALOFT = 0.15  # metres above the ground; what is there falls, or lies on the arm
_AWAY = 0.17  # metres; how far the hand goes away from what it failed to take
_PATIENCE, _WITHDRAWAL = 25, 10  # plans; how long it tries, and how long it then goes away
_RAKED = 0.12  # metres; how far beyond the middle a peg is raked


class Bring(Cost):
    """Fetches the object, and brings it to the target."""

    def __init__(self, task: Any) -> None:
        """Takes a `manipulator.Bring` task."""
        super().__init__(task)
        self._has_peg: bool = task._use_peg
        self.settings = PEG_SETTINGS if self._has_peg else BALL_SETTINGS
        self._object = "peg" if self._has_peg else "ball"
        self._grip = HANDLE if self._has_peg else BALL
        self.reset()

    def reset(self) -> None:
        """Forgets where the object was going and what was being done about it."""
        self._coming: list[Pose] = []  # where the object will be at the plan's knots
        self._ways = PegWays()
        self._sag = np.zeros(4)  # radians by which gravity bends the arm away from its targets
        self._doubts = 0  # plans that found the contrary of what is known of a peg's reach
        self._near_for = 0  # plans in which the hand was near the object without holding it
        self._withdraws = 0  # plans in which it still goes away, to come again another way
        self._settles = False  # whether it will soon lie still
        self._rake_to: float | None = None  # x, metres, while the object is out of reach

    def step_cost(self, physics: Any) -> np.ndarray:
        """Fetching costs more than carrying, and both less the nearer, (N,)."""
        data = physics.named.data
        low = 5.0 * np.maximum(0.03 - data.site_xpos["grasp", "z"], 0.0)
        if self._withdraws:
            hand = data.site_xpos["grasp"]
            near_by = np.maximum(_AWAY - arrays.norm(hand - data.site_xpos[self._object]), 0.0)
            moved = arrays.norm(data.qvel[self.task._object_joints][..., :2])
            return 2.0 * _LOOSE + 20.0 * near_by + 2.0 * moved + low
        if self._rake_to is not None:
            return 2.0 * _LOOSE + raking_cost(data, self._object, self._rake_to) + low
        held = self._held(data)
        secure, carry = self._carrying(physics, held)
        fetch = _LOOSE + self._fetching(data)
        return secure * carry + (1.0 - secure) * fetch + low

    def _carrying(self, physics: Any, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How surely the object needs no fetching, 0 to 1, and what carrying costs, (N,) each."""
        data = physics.named.data
        missing = 1.0 - self.task.get_reward(physics)
        carry = self._gap(data) + missing
        if self._has_peg:
            carry = self._ways.cost_to_target(data.qpos[ARM], carry)
        carry = carry + loose(physics, _PRESS)
        if self._has_peg:
            velocity = data.qvel[self.task._object_joints]
            speed, spin = arrays.norm(velocity[..., :2]), np.abs(velocity[..., 2])
            carry = carry + 0.5 * np.maximum(speed - _SPEED, 0.0)
            carry = carry + 0.05 * np.maximum(spin - _SPIN, 0.0)
        return held, carry

    def _held(self, data: Any) -> np.ndarray:
        """How well the hand holds the object, 0 to 1, (N,)."""
        ahead, aside = in_hand(data, self._place(data))
        ahead = ahead - np.clip(ahead, 0.0, self._grip.slack)
        grip = self._grip
        closed = np.clip((fingers(data) - grip.ready) / (grip.firm - grip.ready), 0.0, 1.0)
        firm = near(np.hypot(ahead, aside), 0.012) * closed
        if grip.forward is not None:
            firm = firm * near(self._misalignment(data), 0.15)
        # A little play in the hand is no reason to stand still.
        return np.minimum(PLAY * firm, 1.0)

    def _place(self, data: Any) -> np.ndarray:
        """Where the grasp site is to be, (..., 3)."""
        frame = data.site_xmat[self._object]
        return data.site_xpos[self._object] + in_world(frame, self._grip.place)

    def _misalignment(self, data: Any) -> Any:
        """One less the cosine between the hand and the grip's direction, (...)."""
        if self._grip.forward is None:
            forward = downwards(data.site_xpos[self._object])
        else:
            forward = in_world(data.site_xmat[self._object], self._grip.forward)
        frame = data.site_xmat["grasp"]
        return 1.0 - forward[..., 0] * frame[..., 2] - forward[..., 2] * frame[..., 8]

    def _fetching(self, data: Any) -> np.ndarray:
        """How far the hand is from holding the object, (N,)."""
        ahead, aside = in_hand(data, self._place(data))
        distance = np.hypot(ahead - np.clip(ahead, 0.0, self._grip.slack), aside)
        turn = self._misalignment(data)
        if self._grip.forward is None:
            turn = np.maximum(turn - 0.06, 0.0)
        # With the object beside it the hand must first back off: the fingers are in the way.
        beside = np.abs(aside) - 0.012 + 0.05 * turn
        detour = np.maximum(np.clip(1.5 * beside, 0.0, 0.07) - ahead, 0.0)
        is_far = np.clip((distance - 0.006) / 0.012, 0.0, 1.0)
        ready = opening(ahead, aside) if self._has_peg else self._grip.ready
        unready = np.abs(fingers(data) - ready)
        outwards = outward_speed(data, self.task._object_joints[0], self._object)
        # What lies on the arm must fall before the hand can have it.
        aloft = np.maximum(height_above_ground(data.site_xpos[self._object]) - _ALOFT, 0.0)
        if self._has_peg:  # which a hand that comes too fast kicks
            speed = arrays.norm(data.qvel[self.task._object_joints][..., :2])
            lies = height_above_ground(data.site_xpos["peg"]) < _LIES
            outwards = outwards + _KICK * np.minimum(speed, 2.0) * lies
        trouble = 0.5 * turn + 2.0 * is_far * unready + outwards + 4.0 * aloft
        way = distance + detour
        # Steeper near the object, where it would else not pay to risk a touch.
        near_by = 4.0 * way + 0.5 * way / (way + 0.03)
        if self._has_peg:
            near_by = self._ways.cost_to_peg(data.qpos[ARM], near_by) + across(data, turn)
        return near_by + trouble

    def _gap(self, data: Any) -> np.ndarray:
        """How far the object is from its place, by the way that it can go, (N,), about 0 to 2."""
        places = data.site_xpos
        if self._has_peg:
            gaps = [arrays.norm(places[s] - places[f"target_{s}"]) for s in ("peg", "peg_tip")]
            gap = (gaps[0] + gaps[1]) / 2
        else:
            gap = arrays.norm(places["ball"] - places["target_ball"])
        return gap / LONGEST

    def look(self, physics: Any) -> None:
        """Finds the ways to the target or where the object will be; rakes what is out of reach."""
        data = physics.named.data
        random = np.random.default_rng(0)  # its own: a look must not shift the samples' stream
        if self._has_peg:
            self._sag = sag(physics, self.settings.gain)
        if self._held(data) > 0.3:
            self._rake_to, self._near_for, self._withdraws = None, 0, 0
            if self._has_peg:
                self._find_way(physics)
            return
        self._lose_patience(data)
        self._coming = self._foreseen(physics)
        within = len(self._poses(data, random, self._grip, "", 2, at=len(self._coming))) > 0
        if self._has_peg:
            within = self._is_sure(within)
        if within:
            if self._rake_to is not None:
                self._near_for = 0
            self._rake_to = None
        elif self._rake_to is not None or self._settles:  # what rolls may come by itself
            self._rake_to = self._rake_goal(data)
        if self._has_peg:
            self._find_way_there(physics)

    def _is_sure(self, within: bool) -> bool:
        """Whether a peg is within reach, which a few plans must agree on to change it."""
        if within == (self._rake_to is None):
            self._doubts = 0
            return within
        self._doubts += 1
        return within if self._doubts > _DOUBTS else not within

    def _find_way_there(self, physics: Any) -> None:
        """Looks for a way to a peg, unless it moves, lies on the arm or has to be raked first."""
        data = physics.named.data
        moves = np.abs(data.qvel[self.task._object_joints]).max() > _ROLLS
        aloft = height_above_ground(data.site_xpos[self._object]) > _LIES
        if self._withdraws or moves or aloft or self._rake_to is not None:
            self._ways.forget()
            return
        self._ways.look_for_peg(
            np.random.default_rng(round(1000 * physics.time())),
            data.qpos[ARM],
            pose_of(data, self._object),
            lambda random: self._poses(data, random, self._grip, "", _TAKES, tilt=_ALIGNED),
        )

    def _find_way(self, physics: Any) -> None:
        """Looks for a way to the target with a peg in the hand."""
        data = physics.named.data
        self._ways.look_for_target(
            np.random.default_rng(round(1000 * physics.time())),
            data.qpos[ARM],
            -downwards(data.site_xpos["grasp"])[PLANE],
            lambda random: self._poses(data, random, self._grip, "target_", _GOALS),
        )

    def _lose_patience(self, data: Any) -> None:
        """Has the hand go away for a while if it has been near the object for long, in vain."""
        if self._withdraws:
            self._withdraws -= 1
            return
        offset = data.site_xpos["grasp"] - data.site_xpos[self._object]
        self._near_for += bool(arrays.norm(offset) < 0.75 * _AWAY)
        if self._near_for > _PATIENCE:
            self._near_for, self._withdraws = 0, _WITHDRAWAL

    def _foreseen(self, physics: Any) -> list[Pose]:
        """The object's poses at the plan's knots, if the arm stays where it is; none at rest."""
        data, state = physics.named.data, physics.get_state()
        joints = self.task._object_joints
        self._settles = bool(np.abs(data.qvel[joints]).max() < _AT_REST)
        if self._settles:
            return []
        arm = data.qpos[ARM].copy()
        span = self.settings.horizon / (self.settings.knots - 1)
        found: list[Pose] = []
        # The arm is put back by force, which physics may not bear: then this is all that is seen.
        with contextlib.suppress(PhysicsError):
            for _ in range(self.settings.knots - 1):
                for _ in range(_HOLDS):
                    physics.step(round(span / _HOLDS / physics.timestep()))
                    data.qpos[ARM], data.qvel[ARM] = arm, 0.0
                found.append(pose_of(data, self._object))
        self._settles = bool(np.abs(data.qvel[joints]).max() < 10 * _AT_REST)
        physics.set_state(state)
        physics.forward()
        return found

    def _rake_goal(self, data: Any) -> float:
        """Where the object would be in reach: x, metres."""
        if self._grip.forward is None:
            return 0.0
        # The hand comes from the handle's side, so it needs more room there.
        ahead = in_world(data.site_xmat[self._object], self._grip.forward)[0]
        return _RAKED if ahead > 0 else -_RAKED

    def _poses(
        self,
        data: Any,
        random: np.random.Generator,
        grip: Grip,
        prefix: str,
        count: int,
        back: float = 0.0,
        at: int = 0,
        tilt: float = 0.5,
    ) -> np.ndarray:
        """Arm joints that have the hand at a grip, (n, 4).

        Args:
          data: of a single simulation.
          random: draws the redundancy.
          grip: where.
          prefix: 'target_' for the object at the target.
          count: how many at most.
          back: how far the hand is to stand off.
          at: the knot at which the object is to be met, 0 for now.
          tilt: how far from straight on a hand may come to a peg that it will straighten.
        """
        moves = at > 0 and bool(self._coming)
        meeting = min(at, len(self._coming))
        middle, frame = self._coming[meeting - 1] if moves else pose_of(data, prefix + self._object)
        place = (middle + in_world(frame, grip.place))[PLANE]
        now = data.qpos[ARM]
        if grip.forward is None:
            if prefix:
                return hand_poses(random, place, GRASP, now, count)
            down = angle_of(downwards(middle)[PLANE])
            clear = {"width": grip.width, "slack": 1.5 * grip.slack}
            return hand_poses(random, place, GRASP + back, now, count, down, 0.8, **clear)
        angle = angle_of(in_world(frame, grip.forward)[PLANE])
        if prefix:
            tilt = 0.02
        else:
            place, angle = grasp_of((middle, frame))
        return hand_poses(random, place, GRASP + back, now, count, angle, tilt, width=grip.width)

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
            paths = lifts(random, place, angle, now, self.settings.knots, OPEN_ANGLE)
        elif self._rake_to is not None:
            place, count = data.site_xpos[self._object], self.settings.knots
            paths = raking_paths(random, place, self._rake_to, now, count)
        elif self._held(data) > 0.3:
            paths = self._carrying_paths(data, random)
        else:
            paths = self._fetching_paths(data, random)
        paths.append(path(now, [now], self.settings.knots, [OPEN_ANGLE]))
        order = random.permutation(len(paths))
        along = self._ways.paths(now, self.settings.knots)
        return np.array(along + [paths[place] for place in order])

    def _carrying_paths(self, data: Any, random: np.random.Generator) -> list[np.ndarray]:
        """Paths to the target, upwards, and none."""
        now, count, shut = data.qpos[ARM], self.settings.knots, self._grip.shut
        paths: list[np.ndarray] = []
        for pose in self._poses(data, random, self._grip, "target_", 6):
            paths.extend(path(now, [pose], count, [shut], slow) for slow in (1, 2, 4))
        place, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
        paths.extend(lifts(random, place, angle, now, count, shut))
        paths.append(path(now, [now], count, [shut]))
        return paths

    def _fetching_paths(self, data: Any, random: np.random.Generator) -> list[np.ndarray]:
        """Paths to where the object will be, at once or from ahead of it; the hand closes there."""
        now, count, grip = data.qpos[ARM], self.settings.knots, self._grip
        paths = [path(now, [now], count, [grip.shut])]
        if self._has_peg and not self._coming:
            back = nudged(now, -BACK * direction(now.sum()), 0.0)
            paths.extend(path(now, [back], count, [OPEN_ANGLE], slow) for slow in (1, 3))
            for tilt, few in ((_ALIGNED, 3), (0.5, 2)):
                for pose in self._poses(data, random, grip, "", few, tilt=tilt):
                    paths.extend(approaches(now, pose, count, grip.ready, grip.shut))
            return paths
        for knot, straight, ways in ((1, (1,), ()), (2, (2,), (1,)), (4, (4,), (2,))):
            grasp = [grip.ready] * knot + [grip.shut]
            for pose in self._poses(data, random, grip, "", 4, at=knot):
                paths.extend(path(now, [pose], count, grasp, slow) for slow in straight)
                angle = float(pose.sum())
                place = hand_places(pose, GRASP) - BACK * direction(angle)
                for before in hand_poses(random, place, GRASP, pose, 1, angle, 0.1):
                    paths.extend(path(now, [before, pose], count, grasp, slow) for slow in ways)
                    paths.append(path(now, [before], count, [grip.ready], knot))
        return paths
