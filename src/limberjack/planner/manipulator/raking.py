"""`Rake`: raking of an object that is out of reach, inwards with a fingertip.

rake = Rake(peg)
rake.judge(data, is_within=False)  # several plannings in a row
if rake.goal is not None:  # x, metres
    cost = rake.at().cost(batch_data, rake.goal)  # (N,)
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle
from limberjack.planner.manipulator.props import Ball, Peg
from limberjack.planner.manipulator.spots import Spot, next_spot
from limberjack.utils import arrays

__all__ = ["Rake"]

_DOUBTS = 2  # plannings that must contradict the known reach of an object before it changes
_STIRRED = 0.03  # metres; paths to a peg are searched again once it has moved so far
# Metres by which a peg must come nearer to the goal, or a fingertip to the spot, to count.
_HEADWAY = 0.03
_PULLED = 0.08  # metres; so far a peg is pulled away from its obstacle
_PATIENCE = 16  # plannings; after so many without headway a peg is raked from elsewhere
_LED = 0.1  # of a planning; share that counts while the arm is still on a path to the spot
_MISSES = 2  # failed searches for a path after which a peg is raked


class Rake:
    """The goal and the spot of raking; a peg that does not come nearer is raked from elsewhere.

    Attributes:
      goal: x to which the object is raked, metres; None while it is not raked.
      spot: the spot at which a peg is raked; None for none yet, and for a ball.
      misses: failed searches for a path to the object since it has moved.
    """

    def __init__(self, prop: Ball | Peg) -> None:
        """Rakes nothing yet."""
        self._prop = prop
        self._doubts = 0
        self._stayed_at = np.zeros(3)  # place of the object at the first of the misses
        self.goal: float | None = None
        self.misses = 0
        self._forget()

    def _forget(self) -> None:
        """Discards the spot and all headway."""
        self.spot: Spot | None = None
        self._pulled_from = np.zeros(3)  # place of the peg when that spot was chosen
        self._nearest = np.inf  # metres; least distance of the peg from the goal
        self._least = np.inf  # metres; least distance of a fingertip from the spot
        self._stalled = 0.0  # plannings without any headway

    def judge(self, data: Any, is_within: bool) -> bool:
        """Begins or ends raking when the object's reach has changed a few times in a row.

        Returns whether raking has just ended.
        """
        was_within = self.goal is None
        self._doubts = 0 if is_within == was_within else self._doubts + 1
        if self._doubts and self._doubts <= _DOUBTS:
            is_within = was_within
        self.goal = None if is_within else self._prop.rake_goal(data)
        return is_within and not was_within

    def choose_spot(
        self, data: Any, walls: Obstacle, is_led: bool, moves: bool, falls: bool
    ) -> None:
        """Decides at which spot a peg is raked, and rakes one to which no path leads.

        It is not raked while the arm makes it fall. The first spot is chosen once the peg is at
        rest, another one without headway for long; an arm that is led to the spot has more time.
        """
        place = data.site_xpos[self._prop.name]
        if arrays.norm(place - self._stayed_at) > _STIRRED:
            self._stayed_at, self.misses = place.copy(), 0
        if falls:
            self.goal, self.misses = None, 0
        if self.misses >= _MISSES and self.goal is None:
            self.goal = self._prop.rake_goal(data)
        if self.goal is None:
            self._forget()
            return
        is_pulled = arrays.norm(place - self._pulled_from) > _PULLED
        if self.spot is not None and self.spot.kind != "there" and is_pulled:
            self._forget()
        self._count_headway(data, self.goal, _LED if is_led else 1.0)
        if (self.spot is None and not moves) or self._stalled > _PATIENCE:
            self._stalled, self._pulled_from, self._least = 0.0, place.copy(), np.inf
            self.spot = next_spot(data, self.spot, self.goal, walls)
        if self.spot is not None:
            self.goal = self.spot.goal(data, self.goal)

    def _count_headway(self, data: Any, goal: float, share: float) -> None:
        """Counts a share of a planning without headway of the peg or a fingertip."""
        off, missing = abs(float(data.site_xpos["peg"][0]) - goal), np.inf
        if self.spot is not None:
            missing = float(self.spot.missing(data, self.spot.goal(data, goal)))
        if off < self._nearest - _HEADWAY:
            self._nearest, self._stalled = off, 0.0
        if missing < self._least - _HEADWAY:
            self._least, self._stalled = missing, 0.0
        self._stalled += share

    def at(self) -> Spot:
        """The spot, or else the object's middle."""
        return self.spot or Spot(self._prop.name, "there")
