"""`Tower`: the boxes that stand in place, the next box, and its place in the tower.

tower = Tower(["box0", "box1"])
tower.update(data)          # of a single simulation
tower.next, tower.place     # "box1", (3,) metres; None once the tower stands
"""

import math
from typing import Any

import numpy as np

from limberjack.planner.stacker.boxes import HALF, stands

__all__ = ["ALOFT", "FREE", "FROM_WALL", "PLACED", "Tower"]

FREE = 0.066  # metres from box to box, so that a finger fits between
FROM_WALL = 0.355  # metres; a box further out than this has no room for a finger behind it
ALOFT = 0.13  # metres; a loose box higher than this is falling, or lies on the arm
PLACED = 0.006  # metres; a box nearer to its place than this stands there, up to twice as far


class Tower:
    """Boxes of a tower; see the module's docstring."""

    def __init__(self, boxes: list[str]) -> None:
        """Knows all boxes by name; none is placed yet."""
        self._boxes = boxes
        self.placed: list[str] = []  # those that stand in place, from the floor up
        self.waiting = boxes  # those that are neither placed nor next
        self.next: str | None = None  # the box to fetch; None once the tower stands
        self.place = np.zeros(3)  # of the next box, metres
        self.places: list[np.ndarray] = []  # of all levels
        self.shunned: str | None = None  # a box at which the hand has failed

    @property
    def others(self) -> list[str]:
        """All boxes but the next, those that are placed first."""
        return self.placed + self.waiting

    def update(self, data: Any, is_held: bool) -> None:
        """Reads a single simulation, and chooses the next box; one that is held stays the next."""
        target = data.site_xpos["target"]
        levels = round((float(target[2]) / HALF - 1) / 2) + 1
        heights = [HALF * (2 * level + 1) for level in range(levels)]
        self.places = [np.array([target[0], 0.0, height]) for height in heights]
        left, before, self.placed = list(self._boxes), self.placed, []
        boxes = {box: data.site_xpos[box].tolist() for box in left}
        for place in self.places:
            x, _, z = place.tolist()
            gaps = [math.hypot(boxes[box][0] - x, boxes[box][2] - z) for box in left]
            nearest = gaps.index(min(gaps))
            allowed = PLACED if place is self.places[-1] else 0.010  # metres; if it carries others
            if not stands(data, left[nearest], gaps[nearest], allowed, left[nearest] in before):
                self.place = place
                in_place = gaps[nearest] < 1.5 * HALF  # no room for another one there
                self.next = left[nearest] if in_place else self._easiest(data, left, is_held)
                self.waiting = [box for box in left if box != self.next]
                return
            self.placed.append(left.pop(nearest))
        self.next, self.waiting = None, left

    def _easiest(self, data: Any, left: list[str], is_held: bool) -> str:
        """The easiest of the boxes to fetch; the current one unless it is much worse."""
        if self.next in left and is_held:
            return str(self.next)
        places = {box: data.site_xpos[box].tolist() for box in self._boxes}

        def trouble(box: str) -> float:  # in metres of distance
            x, _, z = places[box]
            others = [(o[0] - x, o[2] - z) for name, o in places.items() if name != box]
            covered = any(abs(aside) < 0.04 and 0.02 < up < 0.07 for aside, up in others)
            beside = sum(abs(up) < 0.03 and abs(aside) < FREE for aside, up in others)
            cornered = max(0.0, abs(x) - FROM_WALL)
            distance = abs(x - float(self.place[0]))
            return (
                distance
                + 2.0 * (z > ALOFT)
                + 0.5 * covered
                + 0.4 * beside
                + 15.0 * cornered
                - 0.1 * (box == self.next)
                + 1.0 * (box == self.shunned)
            )

        return min(left, key=trouble)
