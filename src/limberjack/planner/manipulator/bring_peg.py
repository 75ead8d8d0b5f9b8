"""Cost of bring_peg: as for a ball, with an object that has a direction.

It is taken by the handle, from straight on. A peg that is held is brought along a route of the
joints, because the path of the peg alone would not turn it round; so is the hand to one that lies
still. One that cannot be taken from the handle's side is raked inwards first, from elsewhere once
that has failed. It may also lie on the arm, which then stretches so that the peg falls.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, PLANE, in_hand, near, sag
from limberjack.planner.arm.kinematics import (
    GRASP,
    PINCH,
    angle_of,
    direction,
    hand_poses,
    hand_poses_each,
    nudged,
)
from limberjack.planner.arm.proposals import Proposal, approaches, plans_of
from limberjack.planner.manipulator.bring import Bring
from limberjack.planner.manipulator.grips import (
    BACK,
    HANDLE,
    PEG_SETTINGS,
    Pose,
    against_hand,
    downwards,
    height_above_ground,
    in_world,
    pose_of,
)
from limberjack.planner.manipulator.peg_paths import PegPaths, across, grasp_of, opening
from limberjack.planner.manipulator.raking import raking_proposals
from limberjack.planner.manipulator.spots import Spots
from limberjack.utils import arrays

__all__ = ["BLADE", "HAND", "STRETCHED", "BringPeg"]

_ALIGNED = 0.1  # radians; a hand that comes to a peg so far from straight on takes it
_TURNED = 0.3  # radians; from one that is turned more it slips
_ROLLS = 2.0  # metres or radians per second; no path is looked for to a peg that moves so fast
_GOALS, _BEST = 24, 12  # poses at the target and at a peg to which paths are searched
# Radians that a peg at the target may lean about the point between its middle and its tip, which
# are then 0.05 sin(lean / 2) off each: up to 0.4 the reward is 1, at 0.8 it is 0.6. As paths are
# found by chance, straight ones are looked for twice.
_LEANS = 0.02, 0.02, 0.4, 0.8
_FAR_OFF = 0.03  # metres; a peg that is nearer to the target stays there
_TURNS_ABOUT = 0.0, -0.025  # metres in the frame of a peg
_LIES = 0.08  # metres above the ground; a peg that is higher does not lie on it
_KICK = 1.0  # per metre per second; what it costs that a peg moves that is not held
# Metres and radians per second above which a peg may slip out of the hand.
_SPEED, _SPIN = 3.0, 10.0
_RAKED = 0.12  # metres; how far beyond the middle a peg is raked
_ALOFT, _CARRIED = 0.12, 15  # metres, plannings; a peg so high for so long lies on the arm
_ON_ARM, BLADE = 0.015, np.array([0.005])  # metres; so near to the arm it does, and its radius
HAND = GRASP + 0.02  # metres; from the wrist to the end of a hand on which it may lie
STRETCHED = np.array([np.pi, 0.5, 0.5, 0.5])  # radians; joints of an arm on which none does


class BringPeg(Bring):
    """Fetches the peg, and brings it to the target."""

    settings = PEG_SETTINGS
    _object, _grip = "peg", HANDLE

    def reset(self) -> None:
        """Forgets the proposals too."""
        super().reset()
        self._paths = PegPaths()
        self._walls = Obstacle(np.zeros((0, 2, 2)), np.zeros(0))  # that are in the way: none
        self._spots = Spots()  # where a peg is raked
        self._carried_for = 0  # plans in which the peg has lain on the arm
        self._lean = 0  # which of `_LEANS` the peg has at the target

    def _decide(self, physics: Any) -> None:
        """Decides the stage for an arm that hangs a little below its targets."""
        self._sag = sag(physics, self.settings.gain)
        self._watch_arm(physics.named.data)
        super()._decide(physics)

    def stage(self) -> Any:
        """The stage, and the spot at which the peg is raked."""
        return super().stage(), self._spots.now

    def _watch_arm(self, data: Any) -> None:
        """Notices a peg that lies on the arm."""
        aloft = height_above_ground(data.site_xpos["peg"]) > _ALOFT
        carried = aloft and not self._has and self._touches_arm(data)
        self._carried_for = self._carried_for + 1 if carried else 0

    def _touches_arm(self, data: Any) -> bool:
        """Whether the arm is where the peg is."""
        peg = Obstacle(data.site_xpos[["peg_grasp", "peg_tip"]][None][..., PLANE], BLADE)
        return bool(clearance(data.qpos[ARM][None], HAND, peg)[0, 0] < _ON_ARM)

    def _lies_on_arm(self) -> bool:
        """Whether the peg has lain on the arm for long."""
        return self._carried_for > _CARRIED

    def _carrying(self, physics: Any, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Quality of the hold and cost of carrying; a peg that is swung gets lost."""
        held, carry = super()._carrying(physics, held)
        velocity = physics.named.data.qvel[self.task.object_joints]
        speed, spin = arrays.norm(velocity[..., :2]), np.abs(velocity[..., 2])
        carry = carry + 0.5 * np.maximum(speed - _SPEED, 0.0)
        return held, carry + 0.05 * np.maximum(spin - _SPIN, 0.0)

    def _to_target(self, physics: Any) -> np.ndarray:
        """Remaining path of the arm and, near its end, distance of the peg, (N,)."""
        return self._paths.cost_to_target(physics.named.data.qpos[ARM], super()._to_target(physics))

    def _gap(self, data: Any) -> np.ndarray:
        """Mean distance of the peg's middle and tip from theirs at the target, (N,), metres."""
        places = data.site_xpos
        gaps = [arrays.norm(places[s] - places[f"target_{s}"]) for s in ("peg", "peg_tip")]
        return (gaps[0] + gaps[1]) / 2

    def _firm(self, data: Any, offset: tuple[Any, Any]) -> np.ndarray:
        """1 where the handle is right between the closed fingers, and along the hand, (N,)."""
        return super()._firm(data, offset) * near(self._misalignment(data), 0.15)

    def _offset(self, data: Any) -> tuple[Any, Any]:
        """Offset of the pinch from the fingertips, about which a hand may turn, (N,) each."""
        ahead, aside = in_hand(data, data.site_xpos["peg_pinch"])
        return ahead - (PINCH - GRASP), aside

    def _misalignment(self, data: Any) -> Any:
        """One less the cosine between the hand and the peg, (...)."""
        return against_hand(data, _forward(data.site_xmat["peg"]))

    def _opening(self, ahead: Any, aside: Any) -> Any:
        return opening(ahead, aside)

    def _chased(self, data: Any) -> np.ndarray:
        """Cost of the peg's motion; a hand that comes too fast kicks it, (N,)."""
        speed = arrays.norm(data.qvel[self.task.object_joints][..., :2])
        lies = height_above_ground(data.site_xpos["peg"]) < _LIES
        return super()._chased(data) + _KICK * np.minimum(speed, 2.0) * lies

    def _to_object(self, data: Any, distance: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Remaining path of the arm and, near its end, distance of the hand, (N,)."""
        near_by = super()._to_object(data, distance, turn)
        return self._paths.cost_to_peg(data.qpos[ARM], near_by) + across(data, turn)

    def _lose_patience(self, data: Any) -> None:
        """Withdraws the hand after long; a peg that is raked is raked from elsewhere instead."""
        if self._rake_to is None:
            super()._lose_patience(data)
        else:
            self._near_for = self._withdraws = 0

    def _turn_rake(self, data: Any) -> None:
        """Rakes a peg that does not come nearer from elsewhere: it may lean on something."""
        if self._lies_on_arm():
            self._rake_to = None
        if self._rake_to is None:
            self._spots.forget()
            return
        moves = bool(self._coming)
        spot = self._spots.choose(data, self._rake_to, self._walls, self._is_led(), moves)
        if spot is not None:
            self._rake_to = spot.goal(data, self._rake_to)

    def _is_led(self) -> bool:
        """Whether the arm is still on a path to where it rakes: it knows none."""
        return False

    def _raking(self, data: Any, goal: float) -> np.ndarray:
        """Cost of raking the peg at its spot, (N,)."""
        spot = self._spots.now
        return super()._raking(data, goal) if spot is None else spot.cost(data, goal)

    def _raked_site(self) -> str:
        """The site of the spot that is raked."""
        spot = self._spots.now
        return super()._raked_site() if spot is None else spot.site

    def _find_path_to_target(self, physics: Any) -> None:
        """Looks for a path to the target; to a peg that leans there if no other is found."""
        data = physics.named.data
        is_found = self._paths.look_for_target(
            self._draws,
            data.qpos[ARM],
            -downwards(data.site_xpos["grasp"])[PLANE],
            lambda random: self._poses_at_target(data, random, _GOALS),
        )
        if not is_found and self._gap(data) > _FAR_OFF:
            self._lean = (self._lean + 1) % len(_LEANS)

    def _find_path_to_object(self, physics: Any) -> None:
        """Looks for a path to a peg that lies still within reach, or to let one fall."""
        data, now = physics.named.data, physics.named.data.qpos[ARM]
        if self._lies_on_arm():
            self._paths.look_for_room(self._draws, now, STRETCHED)
            return
        moves = np.abs(data.qvel[self.task.object_joints]).max() > _ROLLS
        aloft = height_above_ground(data.site_xpos["peg"]) > _LIES
        if self._withdraws or moves or aloft or self._rake_to is not None:
            self._paths.forget()
            return
        peg = pose_of(data, "peg")
        self._paths.look_for_peg(self._draws, now, peg, lambda random: self._best(peg, now, random))

    def _best(self, peg: Pose, now: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Arm joints that have the hand around the peg, (n, 4): straight on if that is possible."""
        (straight,) = self._poses_around([peg], now, random, _BEST, tilt=_ALIGNED)
        return straight if len(straight) else self._poses_around([peg], now, random, _BEST)[0]

    def _rake_goal(self, data: Any) -> float:
        """Position in reach: x, metres; the hand needs more room on the handle's side."""
        return _RAKED if _forward(data.site_xmat["peg"])[0] > 0 else -_RAKED

    def _poses_at_target(self, data: Any, random: np.random.Generator, count: int) -> np.ndarray:
        """Arm joints that have the peg at the target, straight or leaning, (n, 4)."""
        middle, frame = pose_of(data, "target_peg")
        place = (middle + in_world(frame, _TURNS_ABOUT))[PLANE]
        forward = GRASP + self._grip.place[1] - _TURNS_ABOUT[1]
        wanted = angle_of(_forward(frame)[PLANE]), _LEANS[self._lean]
        now, width = data.qpos[ARM], self._grip.width
        return hand_poses(random, place, forward, now, count, *wanted, width=width)

    def _poses_around(
        self,
        objects: list[Pose],
        now: np.ndarray,
        random: np.random.Generator,
        count: int,
        back: float = 0.0,
        tilt: float = 0.5,
    ) -> list[np.ndarray]:
        """Arm joints that have the hand around a peg, straight on to within `tilt`."""
        grasps = [grasp_of(peg) for peg in objects]
        places, angles = np.array([g[0] for g in grasps]), np.array([g[1] for g in grasps])
        wanted = angles, min(tilt, _TURNED)
        each = places, PINCH + back, now, count
        return hand_poses_each(random, *each, *wanted, width=self._grip.width)

    def _tried(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Plans of the stage, those along the path first, (n, knots, 5)."""
        data, count = physics.named.data, self.settings.knots
        now = data.qpos[ARM]
        if self._rake_to is not None and not self._withdraws:
            proposals = raking_proposals(
                random, data.site_xpos[self._raked_site()], self._rake_to, now
            )
            return plans_of(now, [*proposals, Proposal([now], [OPEN_ANGLE])], count)
        return np.concatenate([self._paths.plans(now, count), super()._tried(physics, random)])

    def _fetching_proposals(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to a peg that rolls, or straight on to one that lies still."""
        if self._coming:
            return super()._fetching_proposals(data, random)
        now, grip = data.qpos[ARM], self._grip
        proposals = [Proposal([now], [grip.shut])]
        back = nudged(now, -BACK * direction(now.sum()), 0.0)
        proposals.extend(Proposal([back], [OPEN_ANGLE], slow) for slow in (1, 3))
        peg = [pose_of(data, "peg")]
        for few, tilt in ((3, _ALIGNED), (2, 0.5)):
            (poses,) = self._poses_around(peg, now, random, few, tilt=tilt)
            proposals.extend(approaches(poses, grip.ready, grip.shut))
        return proposals


def _forward(frame: np.ndarray) -> np.ndarray:
    """Direction of a hand that holds a peg of this frame, (..., 9) -> (..., 3)."""
    assert HANDLE.forward is not None
    return in_world(frame, HANDLE.forward)
