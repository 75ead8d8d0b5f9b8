"""Raking of an object that is out of the hand's reach, inwards with a fingertip.

cost = raking_cost(data, "peg", goal=-0.12)  # (N,)
proposals = raking_proposals(random, place, -0.12, now)
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.hand import OPEN_ANGLE, PLANE, TIP_ASIDE, TIP_REACH, TIPS
from limberjack.planner.arm.kinematics import hand_poses
from limberjack.planner.arm.proposals import Proposal
from limberjack.utils import arrays

__all__ = ["behind", "raking_cost", "raking_proposals"]


def raking_cost(data: Any, site: str, goal: float) -> np.ndarray:
    """Cost of the distances of a fingertip from its start, and of the object from the goal, (N,).

    Args:
      data: of a batch.
      site: the object's.
      goal: x, metres.
    """
    middle = data.site_xpos[site]
    start = behind(middle, goal)
    tips = [arrays.norm(data.geom_xpos[tip] - start) for tip in TIPS]
    return 4.0 * arrays.minimum_of(tips) + 10.0 * np.abs(middle[..., 0] - goal)


def raking_proposals(
    random: np.random.Generator, middle: np.ndarray, goal: float, now: np.ndarray
) -> list[Proposal]:
    """Proposals that put a fingertip behind the object, and then pull it inwards.

    Args:
      random: draws them.
      middle: where the object is, (3,).
      goal: x, metres.
      now: the arm's joints, (4,).
    """
    start = behind(middle, goal)[PLANE]
    # The root turns from x to -x over the top, and so the other way below.
    turn = 0.3 * np.sign(goal - middle[0]) * np.array([1.0, 0.0, 0.0, 0.0])
    proposals: list[Proposal] = []
    for pose in hand_poses(random, start, TIP_REACH, now, 12, lateral=TIP_ASIDE):
        proposals.append(Proposal([pose], [OPEN_ANGLE], 2))
        proposals.append(Proposal([pose, pose + turn], [OPEN_ANGLE], 2))
    return proposals


def behind(place: np.ndarray, goal: float) -> np.ndarray:
    """Position of a fingertip that rakes an object to a goal, (..., 3) -> (..., 3), metres."""
    outwards = np.where(place[..., :1] < goal, -1.0, 1.0)
    return place + outwards * np.array([0.03, 0.0, 0.0]) + np.array([0.0, 0.0, 0.02])
