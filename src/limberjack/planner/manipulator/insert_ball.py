"""`BallInsertion` and `Release`: how the ball gets into the cup.

insertion, release = BallInsertion(fetch, cup), Release(task, fetch, cup)
path = insertion.path_to_object(data, attempt=0)
release.update(physics)  # whether the arm waits for the ball, or shakes it off

While a ball still rolls, the arm comes around the cup to where it can be taken. A ball that does
not just fall in is released at a pose that was tested in the planner's simulation (`releases.py`).
A ball that lies on the arm is shaken off.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, fingers
from limberjack.planner.arm.kinematics import GRASP, direction, hand_poses, nudged
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, plans_of
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.fetch import Fetch
from limberjack.planner.manipulator.grips import BACK, height_above_ground, pose_of
from limberjack.planner.manipulator.guide import GOALS, Guide, few_of
from limberjack.planner.manipulator.props import HAND, Ball
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.planner.manipulator.releases import Releases

__all__ = ["BallInsertion", "Release"]

_SHAKES = 10  # plannings that a ball lies on the arm before it is shaken off, and while it is


class BallInsertion:
    """Paths and proposals for the ball."""

    attempts = 4  # searches for a path after which the ball is approached in another pose
    long = 20  # plannings before the mouth after which insertion is tried from elsewhere
    noise_scale = 1.0  # of plans before the mouth
    over = (0.02,)  # metres above the place before the mouth, at which a path ends
    held = (Ball.held,)  # distances from the wrist to be kept clear of the walls, metres
    close = False  # whether a path may end close to the walls

    def __init__(self, fetch: Fetch, cup: Receptacle) -> None:
        self._fetch, self._cup = fetch, cup

    def path_to_object(self, data: Any, attempt: int) -> Path | None:
        """The arm's path around the cup to before the ball; the shortest for attempt 0."""
        fetch = self._fetch
        if fetch.rake.goal is not None:
            return None
        goals = self._goals(data)
        if attempt:
            goals = few_of(fetch.draws, goals)
        return find_path(data.qpos[ARM], goals, HAND, fetch.walls)

    def _goals(self, data: Any) -> np.ndarray:
        """Arm joints before the ball, or where a rolling ball can be taken, (n, 4)."""
        now, random = data.qpos[ARM], self._fetch.draws
        if not self._fetch.is_fast(data):
            return self._fetch.poses_around([pose_of(data, "ball")], now, random, GOALS, BACK)[0]
        places = [np.array([x, 0.04]) for x in random.uniform(-0.3, 0.3, 16)]  # metres
        found = [hand_poses(random, place, GRASP, now, 8, np.pi, 0.8) for place in places]
        takes = np.concatenate(found)[self._fetch.is_clear(np.concatenate(found))]
        return nudged(takes, -BACK * direction(takes.sum(axis=-1)), 0.0)

    def proposals_in(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to let the ball fall."""
        now, grip = data.qpos[ARM], self._cup.grip
        proposals: list[Proposal] = []
        for let_go in (OPEN_ANGLE, grip.ready):
            proposals.append(Proposal([now], [let_go]))
            proposals.append(Proposal([now], [grip.shut, let_go]))
            for _ in range(8):
                up, beside = random.uniform([-0.05, -0.016], [0.03, 0.016])
                for pose in self._cup.poses(data, random, self._cup.before + up, beside, 1):
                    proposals.append(Proposal([pose], [grip.shut, let_go]))
                    proposals.append(Proposal([pose], [let_go], 2))
        return proposals


class Release:
    """Release of a ball that does not just fall in, and recovery of one that lies on the arm."""

    def __init__(self, task: Any, fetch: Fetch, cup: Receptacle) -> None:
        self._task, self._fetch, self._cup = task, fetch, cup
        self._releases = Releases("ball", fetch.prop.joints[:2], cup)
        self.is_due = False  # whether the ball is released at a tested pose
        self.waits = 0  # plannings in which the arm still keeps a pose with an open hand
        self.shakes = 0  # plannings in which the ball is still shaken off
        self._kept = np.zeros(4)  # the arm's joints while it waits
        self._lies_for = 0  # plannings in which the ball has been lying on the arm

    @property
    def is_busy(self) -> bool:
        """Whether the arm waits for the ball to roll in, or shakes it off."""
        return self.waits > 0 or self.shakes > 0

    def update(self, physics: Any) -> bool:
        """Counts the plannings; returns `is_busy`."""
        away = np.hypot(*self._cup.offset(physics.named.data, "ball"))
        self.waits = max(self.waits - 1, 0) if away < 0.3 else 0  # else it has not rolled in
        if not self.waits:
            self._watch_arm(physics)
        return self.is_busy

    def _watch_arm(self, physics: Any) -> None:
        """Begins to shake the arm if the ball has come to rest on it."""
        data = physics.named.data
        is_in = self._task.get_reward(physics) > 0.5
        lies = height_above_ground(data.site_xpos["ball"]) > 0.05
        speed = np.abs(data.qvel[self._fetch.prop.joints[:2]]).max()
        rests = bool(lies and speed < 0.1) and not self._fetch.has and not is_in
        self._lies_for = self._lies_for + 1 if rests else 0
        self.shakes = max(self.shakes - 1, 0)
        if self._lies_for > _SHAKES:
            self._lies_for, self.shakes = 0, _SHAKES

    def seek(self, physics: Any, guide: Guide) -> None:
        """Leads the arm to a pose from which the ball rolls in, and opens the hand there.

        It opens where the arm is still and near the end of its path, and then waits for the ball.
        """
        data = physics.named.data
        now = data.qpos[ARM]
        if guide.path is None:
            guide.follow(self._releases.path(physics, self._fetch.walls))
            return
        left = guide.left(now)
        is_still = np.abs(data.qvel[ARM]).max() < 0.5  # radians per second
        if left < 0.5 and is_still and self._releases.works(physics):
            guide.path, self.waits, self._kept = None, 25, now.copy()
        elif not guide.advances(left):
            self._releases.reset()
            guide.path = None
        elif guide.is_astray(now):
            guide.path = None

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        """Terms of shaking, or of an arm that keeps still with an open hand, (N,) each."""
        data = physics.named.data
        if self.shakes:
            return {"ball on the arm": height_above_ground(data.site_xpos["ball"])}
        return {
            "reward": 1.0 - self._task.get_reward(physics),
            "arm astray": np.abs(data.qpos[ARM] - self._kept).sum(axis=-1),
            "closed fingers": np.abs(fingers(data) - OPEN_ANGLE),
        }

    def plans(self, data: Any, random: np.random.Generator, knots: int) -> np.ndarray:
        """Random plans that shake the ball off; one that keeps still, to wait, (n, knots, 5)."""
        now = data.qpos[ARM]
        poses = now + random.normal(0.0, 1.0, (16, 4)) if self.shakes else [self._kept]
        wide = OPEN_ANGLE - 0.2  # beyond the limit, so that the hand opens with all its force
        return plans_of(now, [Proposal([pose], [wide]) for pose in poses], knots)
