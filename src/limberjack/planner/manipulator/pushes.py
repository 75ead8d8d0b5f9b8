"""Proposals that push a peg into the slot by small straight steps.

proposals = pushes(random, data, slot, now, knots=5, press=HANDLE.shut)
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.hand import PLANE
from limberjack.planner.arm.kinematics import GRASP, direction, nudged
from limberjack.planner.arm.proposals import Proposal
from limberjack.planner.manipulator.receptacles import Receptacle

__all__ = ["pushes"]

_STEPS = 0.02, 0.04, 0.08  # metres; from one pose to the next along the axis
_OFF, _TURN = 0.0015, 0.01  # metres, radians; how far the proposals differ, as the slot is narrow
_ABOVE = 0.05  # metres; how soon the peg is to be upright, which leans
_DRAWS = 4  # of such proposals of each step


def pushes(
    random: np.random.Generator,
    data: Any,
    slot: Receptacle,
    now: np.ndarray,
    knots: int,
    press: float,
) -> list[Proposal]:
    """Proposals that bring the peg over the slot, then along the axis into it.

    Args:
      random: draws them.
      data: of a single simulation.
      slot: the receptacle.
      now: the arm's joints, (4,).
      knots: points of a plan, beyond which no pose is needed.
      press: the control of the grasp.
    """
    (up, beside), (middle_up, middle_beside) = (
        (float(u), float(b)) for u, b in (slot.offset(data, site) for site in slot.sites)
    )
    lean = np.arctan2(middle_beside - beside, middle_up - up + _ABOVE)
    to_world = slot.axes(data)
    to_wrist = data.site_xpos["grasp"][PLANE] - GRASP * direction(now.sum())
    to_wrist = to_wrist - data.site_xpos["peg_tip"][PLANE]
    aside = max(abs(beside), abs(middle_beside))
    top = min(up, slot.before)
    before = [slot.before] if aside > 0.75 * slot.width and up > 0.06 else []
    moves: list[np.ndarray] = []
    turns: list[float] = []
    for step, (off, turn) in zip(
        _STEPS * _DRAWS, random.normal(0.0, [_OFF, _TURN], (len(_STEPS) * _DRAWS, 2)), strict=True
    ):
        turned = _turned(to_wrist, turn + lean)
        heights = [*before, *np.arange(top - step, -step, -step).tolist()][: knots - 1]
        places = np.reshape([[height - up, off - beside] for height in heights], (-1, 2))
        moves.append(places @ to_world + turned - to_wrist)
        turns.extend([turn + lean] * len(heights))
    stations = nudged(now, np.concatenate(moves), np.array(turns))
    proposals: list[Proposal] = []
    for passed in np.split(stations, np.cumsum([len(some) for some in moves])[:-1]):
        proposals.append(Proposal(passed, [press]))
        proposals.append(Proposal(passed[:1], [press], 2))
    return proposals


def _turned(vector: np.ndarray, angle: float) -> np.ndarray:
    """A vector (2,) turned by an angle."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])
