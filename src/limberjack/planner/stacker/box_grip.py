"""`Grip`: the hand's grip on one of the stacker's boxes, and the cost of getting there.

grip = grip_of(physics.named.data, "box0")
how_held(grip, has=False)  # 0 to 1
"""

from typing import NamedTuple

import numpy as np

from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.hand import OPEN_ANGLE, PLAY, closing, in_hand, near
from limberjack.utils.arrays import Quantity

__all__ = ["HIGH", "PRESS", "Grip", "fetching", "grip_of", "how_held", "ready"]

PRESS = 0.5  # control of the grasp that holds a box
HIGH = 0.022  # metres; how far above a box's centre the grasp is: higher it slips, lower it tips
_CLOSING = np.radians(14.0) - OPEN_ANGLE  # by which fingers around a box have closed, measured
_EMPTY = np.radians(35.0)  # by which fingers have closed that hold nothing; at 10 more it is sure
_NEARLY = np.radians(8.0)  # of fingers that come to a box: there is room, and they close sooner


class Grip(NamedTuple):
    """Position of the hand relative to a box, (...) each."""

    ahead: Quantity  # position of the box along the hand, metres from the grasp site
    aside: Quantity
    askew: Quantity  # 0 for fingers that are parallel to the box's sides, up to 0.25
    closed: Quantity  # angle by which the fingers have turned, radians
    turning: Quantity  # their speed, radians per second
    tilt: Quantity  # 0 for a hand that points down, up to 2


class _Hold(NamedTuple):
    """Limits of a good hold."""

    lowest: float  # of the grasp above the box's centre, metres
    highest: float
    slack: float  # metres beyond that, or aside, at which the hold is half as good
    closed: float  # least angle by which the fingers have turned, radians


_TAKING = _Hold(lowest=0.016, highest=0.026, slack=0.006, closed=_CLOSING)
# A box creeps out of the hand, and turns a little at the fingertips, which must not make it stop.
_KEEPING = _Hold(lowest=0.0, highest=0.049, slack=0.01, closed=np.radians(20.0))


def grip_of(data: NamedFields, box: str) -> Grip:
    """The hand's position relative to a box."""
    ahead, aside = in_hand(data, data.site_xpos[box])
    side, hand = data.xmat[box], data.site_xmat["grasp"]
    square = (side[..., 0] * hand[..., 0] + side[..., 6] * hand[..., 6]) ** 2
    speeds = data.qvel[["thumb", "finger"]]
    turning = np.abs(speeds[..., 0] + speeds[..., 1]) / 2
    return Grip(ahead, aside, square * (1.0 - square), closing(data), turning, 1.0 + hand[..., 8])


def how_held(grip: Grip, has: bool) -> np.ndarray:
    """Quality of the hold, 0 to 1, (N,); a hand that does not have the box must hold it better."""
    hold = _KEEPING if has else _TAKING
    empty = np.clip((grip.closed - _EMPTY) / np.radians(10.0), 0.0, 1.0)
    closed = np.clip(grip.closed / hold.closed, 0.0, 1.0) ** 6 * (1.0 - empty)
    if not has:
        # While the fingers still turn the box is at their tips, where it slips when lifted.
        closed *= near(grip.turning, 0.6)
    # Too deep in the hand is twice as bad: a box cannot be put down from there.
    beyond = np.maximum(grip.ahead - hold.highest, 0.0)
    slip = beyond + 2.0 * np.maximum(hold.lowest - grip.ahead, 0.0)
    firm = near(np.hypot(slip, grip.aside), hold.slack) * (near(grip.askew, 0.1) * closed)
    return np.minimum(PLAY * firm, 1.0)


def fetching(grip: Grip) -> np.ndarray:
    """Cost of the distance from holding the box from above, (N,)."""
    beyond = HIGH - grip.ahead
    distance = np.hypot(beyond, grip.aside)
    # The hand comes to the box from 60 mm above its place there.
    above = np.clip(3.0 * (np.abs(grip.aside) - 0.01), 0.0, 0.06)
    detour = np.maximum(above + beyond, 0.0)
    is_far = np.clip((distance - 0.02) / 0.03, 0.0, 1.0)
    # Fingers do not close on a box that is askew, and open to let it fall flat.
    early = np.clip((distance - 0.01) / 0.01 + 25.0 * grip.askew, -1.0, 1.0)
    bent = np.maximum(-grip.closed - 0.1, 0.0)  # fingers that are bent back touch something
    turn = (1.5 - is_far) * grip.tilt + 4.0 * grip.askew + 3.0 * bent
    closed = np.clip((grip.closed - _NEARLY) / (_CLOSING - _NEARLY), 0.0, 1.0)
    return 8.0 * (distance + detour) + turn + 0.5 * early * closed


def ready(closed: float) -> float:
    """Control for fingers closed by an angle, radians, to pass a box and be able to close soon."""
    play = np.radians(2.0)
    return 0.3 * float(np.clip((_NEARLY - play - closed) / play, -1.0, 1.0))
