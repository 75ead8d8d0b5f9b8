"""`Rake`: raking of an object that is out of reach, inwards with a fingertip.

rake = Rake(peg)
rake.judge(data, is_within=False)  # several plannings in a row
rake.goal, rake.spot  # x, metres; None while nothing is raked
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle
from limberjack.planner.arm.proposals import Proposal
from limberjack.planner.manipulator.ball import Ball
from limberjack.planner.manipulator.peg import Peg
from limberjack.planner.manipulator.spots import Spot, Spots
from limberjack.utils import arrays

__all__ = ["Rake"]

_DOUBTS = 2  # plannings that must contradict the known reach of an object before it changes
_STIRRED = 0.03  # metres; paths to a peg are searched again once it has moved so far
_MISSES = 2  # failed searches for a path after which a peg is raked


class Rake:
    """The goal and the spot of raking; a peg that does not come nearer is raked from elsewhere.

    Attributes:
      goal: x to which the object is raked, metres; None while it is not raked.
      misses: failed searches for a path to the object since it has moved.
    """

    def __init__(self, prop: Ball | Peg) -> None:
        """Rakes nothing yet."""
        self._prop = prop
        self._middle = Spot(prop.name, "there")
        self._spots = Spots()
        self._doubts = 0
        self._stayed_at = np.zeros(3)  # place of the object at the first of the misses
        self.goal: float | None = None
        self.misses = 0

    @property
    def spot(self) -> Spot | None:
        """The spot at which a peg is raked; None for none yet, and for a ball."""
        return self._spots.now

    def judge(self, data: Any, is_within: bool) -> bool:
        """Begins or ends raking; returns whether it has just ended.

        Args:
          data: of a single simulation.
          is_within: whether the object is within reach, which must hold a few times in a row.
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

        Args:
          data: of a single simulation.
          walls: obstacles for the fingertip.
          is_led: whether the arm is still on a path to the spot.
          moves: whether the peg moves.
          falls: whether the arm makes the peg fall, which is not raked then.
        """
        place = data.site_xpos[self._prop.name]
        if arrays.norm(place - self._stayed_at) > _STIRRED:
            self._stayed_at, self.misses = place.copy(), 0
        if falls:
            self.goal, self.misses = None, 0
        if self.misses >= _MISSES and self.goal is None:
            self.goal = self._prop.rake_goal(data)
        if self.goal is None:
            self._spots.forget()
            return
        spot = self._spots.choose(data, self.goal, walls, is_led, moves)
        if spot is not None:
            self.goal = spot.goal(data, self.goal)

    def cost(self, data: Any, goal: float) -> np.ndarray:
        """Cost of raking to a goal at the spot, or else at the object's middle, (N,)."""
        return (self.spot or self._middle).cost(data, goal)

    def proposals(self, random: np.random.Generator, data: Any, goal: float) -> list[Proposal]:
        """Proposals that rake to a goal at the spot, or else at the object's middle."""
        return (self.spot or self._middle).proposals(random, data, goal)
