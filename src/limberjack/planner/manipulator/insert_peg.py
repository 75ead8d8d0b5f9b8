"""`pushing_in`: small straight steps of the hand that push the peg into the slot.

proposals = pushing_in(slot, data, random, knots=5)
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.hand import ARM, PLANE
from limberjack.planner.arm.kinematics import GRASP, direction, nudged
from limberjack.planner.arm.proposals import Proposal
from limberjack.planner.manipulator.receptacles import Receptacle

__all__ = ["pushing_in"]

_STEPS = (0.02, 0.04, 0.08) * 4  # metres; from one pose to the next along the axis, in proposals


def pushing_in(
    slot: Receptacle, data: Any, random: np.random.Generator, knots: int
) -> list[Proposal]:
    """Proposals that bring the peg over the slot, then along the axis into it."""
    now, press = data.qpos[ARM], slot.grip.shut
    (up, beside), (middle_up, middle_beside) = [(float(u), float(b)) for u, b in slot.offsets(data)]
    lean = np.arctan2(middle_beside - beside, middle_up - up + 0.05)  # upright 5 cm further on
    to_wrist = data.site_xpos["grasp"][PLANE] - GRASP * direction(now.sum())
    to_wrist = to_wrist - data.site_xpos["peg_tip"][PLANE]
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
        moves.append(places @ slot.axes(data) + _turned(to_wrist, turn + lean) - to_wrist)
        turns.extend([turn + lean] * len(heights))
    waypoints = nudged(now, np.concatenate(moves), np.array(turns))
    proposals: list[Proposal] = []
    for passed in np.split(waypoints, np.cumsum([len(some) for some in moves])[:-1]):
        proposals.append(Proposal(passed, [press]))
        proposals.append(Proposal(passed[:1], [press], 2))
    return proposals


def _turned(vector: np.ndarray, angle: float) -> np.ndarray:
    """A vector (2,) turned by an angle."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])
