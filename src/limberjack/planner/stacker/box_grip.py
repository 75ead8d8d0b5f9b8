"""The hand's grip on one of the stacker's boxes, and the cost of getting there.

grip = grip_of(physics.named.data, "box0")
how_held(grip, has=False)  # 0 to 1
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.arm.hand import OPEN_ANGLE, PLAY, closing, in_hand, near

__all__ = ["HIGH", "PRESS", "Grip", "fetching", "grip_of", "how_held", "ready"]

PRESS = 0.5  # control of the grasp that holds a box
HIGH = 0.022  # metres; how far above a box's centre the grasp is: higher it slips, lower it tips
# Metres; how far above a box's centre the grasp of a hand that takes it may be, and of one that has
# it: a box creeps out of the hand, which must not make it stop.
_TAKEN, _KEPT = (0.016, 0.026), (0.0, 0.049)
_LOOSELY, _EXACTLY = 0.01, 0.006  # metres more, at which a box is half held, and half taken
_DEEP = 2.0  # how much worse it is to have a box too deep in the hand: it cannot be put down
_GRIP_ANGLE = np.radians(14.0)  # of the fingers around a box, measured
_CLOSING = _GRIP_ANGLE - OPEN_ANGLE  # of fingers that were fully open
_KEEPS = np.radians(20.0)  # the same for fingers that have it: it turns a little at their tips
_NEARLY = np.radians(8.0)  # of fingers that come to a box: there is room, and they close sooner
_NEARLY_PLAY = np.radians(2.0)
_READY = 0.3  # control of the grasp that brings them there
_WIDE = 0.1  # radians; fingers that are bent back by more touch what is beside
_EMPTY = np.radians(35.0)  # fingers that have closed by more than this hold nothing
_EMPTIER = np.radians(10.0)  # range until that is certain
_STILL = 0.6  # radians per second; fingers that turn faster do not hold yet
_ABOVE = 0.06  # metres; how far above its place at a box the hand comes to it


@dataclasses.dataclass(frozen=True)
class Grip:
    """Position of the hand relative to a box, (...) each.

    Attributes:
      ahead, aside: where the box is in the hand, metres from the grasp site.
      askew: 0 for fingers that are parallel to the box's sides, up to 0.25.
      closed: how far the fingers have turned, radians.
      turning: how fast they turn, radians per second.
      tilt: 0 for a hand that points down, up to 2.
    """

    ahead: Any
    aside: Any
    askew: Any
    closed: Any
    turning: Any
    tilt: Any


def grip_of(data: Any, box: str) -> Grip:
    """The hand's position relative to a box."""
    ahead, aside = in_hand(data, data.site_xpos[box])
    side, hand = data.xmat[box], data.site_xmat["grasp"]
    square = (side[..., 0] * hand[..., 0] + side[..., 6] * hand[..., 6]) ** 2
    speeds = data.qvel[["thumb", "finger"]]
    turning = np.abs(speeds[..., 0] + speeds[..., 1]) / 2
    askew = square * (1.0 - square)
    return Grip(ahead, aside, askew, closing(data), turning, 1.0 + hand[..., 8])


def how_held(grip: Grip, has: bool) -> np.ndarray:
    """Quality of the hand's hold on the box, 0 to 1, (N,).

    Args:
      grip: the hand's position relative to the box.
      has: whether the hand has had it already. Otherwise it must first be held well.
    """
    empty = np.clip((grip.closed - _EMPTY) / _EMPTIER, 0.0, 1.0)
    closed = np.clip(grip.closed / (_KEEPS if has else _CLOSING), 0.0, 1.0) ** 6 * (1.0 - empty)
    if not has:
        # While the fingers still turn the box is at their tips, where it slips when lifted.
        closed *= near(grip.turning, _STILL)
    least, most = _KEPT if has else _TAKEN
    slip = np.maximum(grip.ahead - most, 0.0) + _DEEP * np.maximum(least - grip.ahead, 0.0)
    firm = near(np.hypot(slip, grip.aside), _LOOSELY if has else _EXACTLY)
    firm *= near(grip.askew, 0.1) * closed
    return np.minimum(PLAY * firm, 1.0)


def fetching(grip: Grip) -> np.ndarray:
    """Cost of the distance from holding the box from above, (N,)."""
    beyond = HIGH - grip.ahead
    distance = np.hypot(beyond, grip.aside)
    above = np.clip(3.0 * (np.abs(grip.aside) - 0.01), 0.0, _ABOVE)
    detour = np.maximum(above + beyond, 0.0)
    is_far = np.clip((distance - 0.02) / 0.03, 0.0, 1.0)
    early = np.clip((distance - 0.01) / 0.01, -1.0, 1.0)
    bent = np.maximum(-grip.closed - _WIDE, 0.0)
    turn = (1.5 - is_far) * grip.tilt + 4.0 * grip.askew + 3.0 * bent
    closed = np.clip((grip.closed - _NEARLY) / (_CLOSING - _NEARLY), 0.0, 1.0)
    return 8.0 * (distance + detour) + turn + 0.5 * early * closed


def ready(closed: float) -> float:
    """Control of the grasp that brings fingers to where they pass a box and close soon.

    Args:
      closed: how far they have turned from fully open, radians.
    """
    lack = _NEARLY - _NEARLY_PLAY - closed
    return _READY * float(np.clip(lack / _NEARLY_PLAY, -1.0, 1.0))
