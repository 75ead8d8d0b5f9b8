"""`Tower`: the boxes that stand in place, the next box, and its place; and poses of boxes.

tower = Tower(["box0", "box1"])
tower.update(data, is_held=False)  # of a single simulation
tower.next, tower.place            # "box1", (3,) metres; next is None once the tower stands
"""

import math

import numpy as np

from limberjack.mujoco.index import NamedFields

__all__ = [
    "ALOFT",
    "FLAT",
    "FREE",
    "FROM_WALL",
    "HALF",
    "PASSES",
    "PLACED",
    "Tower",
    "crest",
    "length",
    "lies_too_low",
    "turned",
]

HALF = 0.022  # metres; half a box
FREE = 0.066  # metres from box to box, so that a finger fits between
FROM_WALL = 0.355  # metres; a box further out than this has no room for a finger behind it
ALOFT = 0.13  # metres; a loose box higher than this is falling, or lies on the arm
PLACED = 0.006  # metres; a box nearer to its place than this stands there, up to twice as far
FLAT = 0.01  # of `turned`: 6 degrees
PASSES = 1.5 * HALF  # above another one a box that is carried keeps clear of it
_SURE = 0.010  # metres; the same, of a box that carries others
_BELOW = 0.18  # metres; boxes that are higher than this are falling, or on the arm


class Tower:
    """Boxes of a tower up to the target; see the module's docstring.

    Attributes:
      placed: the boxes that stand in place, from the floor up.
      next: the box to fetch; None once the tower stands.
      places: of all levels, (levels, 3), metres.
      shunned: a box at which the hand has failed.
    """

    def __init__(self, boxes: list[str]) -> None:
        """Knows all boxes by name; none is placed yet."""
        self._boxes = boxes
        self.placed: list[str] = []
        self.next: str | None = None
        self.places = np.zeros((len(boxes), 3))
        self.shunned: str | None = None

    @property
    def place(self) -> np.ndarray:
        """The place of the next box, (3,), metres."""
        return self.places[len(self.placed)]

    @property
    def waiting(self) -> list[str]:
        """The boxes that are neither placed nor next."""
        return [box for box in self._boxes if box not in self.placed and box != self.next]

    @property
    def others(self) -> list[str]:
        """All boxes but the next, those that are placed first."""
        return self.placed + self.waiting

    def update(self, data: NamedFields, is_held: bool) -> None:
        """Reads a single simulation, and chooses the next box; one that is held stays the next."""
        x, _, z = data.site_xpos["target"].tolist()
        heights = [HALF * (2 * level + 1) for level in range(round((z / HALF - 1) / 2) + 1)]
        self.places = np.array([[x, 0.0, height] for height in heights])
        left, before, self.placed = list(self._boxes), self.placed, []
        boxes = {box: data.site_xpos[box].tolist() for box in left}
        for height in heights:
            gaps = [math.hypot(boxes[box][0] - x, boxes[box][2] - height) for box in left]
            nearest = gaps.index(min(gaps))
            box, gap = left[nearest], gaps[nearest]
            allowed = PLACED if height == heights[-1] else _SURE
            # One that stood there may have moved a little.
            stood = box in before and gap < 2.0 * allowed
            if not stood and not _stands(data, box, gap, allowed):
                in_place = gap < 1.5 * HALF  # no room for another one there
                self.next = box if in_place else self._easiest(boxes, left, is_held)
                return
            self.placed.append(left.pop(nearest))
        self.next = None

    def _easiest(self, boxes: dict[str, list[float]], left: list[str], is_held: bool) -> str:
        """The easiest of the boxes to fetch; the current one unless it is much worse."""
        if self.next in left and is_held:
            return str(self.next)

        def trouble(box: str) -> float:  # in metres of distance
            x, _, z = boxes[box]
            others = [(o[0] - x, o[2] - z) for name, o in boxes.items() if name != box]
            covered = any(abs(aside) < 0.04 and 0.02 < up < 0.07 for aside, up in others)
            beside = sum(abs(up) < 0.03 and abs(aside) < FREE for aside, up in others)
            trouble = abs(x - float(self.place[0])) + 2.0 * (z > ALOFT) + 0.5 * covered
            trouble = trouble + 0.4 * beside + 15.0 * max(0.0, abs(x) - FROM_WALL)
            return trouble - 0.1 * (box == self.next) + 1.0 * (box == self.shunned)

        return min(left, key=trouble)


def _stands(data: NamedFields, box: str, gap: float, allowed: float) -> bool:
    """Whether a box rests flat where it should."""
    speed = np.abs(data.qvel[[f"{box}_x", f"{box}_z"]]).max()  # metres per second
    return bool(gap < allowed and speed < 0.1 and turned(data, box) < FLAT)


def turned(data: NamedFields, box: str | list[str]) -> np.ndarray:
    """0 for boxes that lie flat on any of their sides, 0.25 for one on an edge, (...)."""
    square = data.xmat[box, "xx"] ** 2
    return square * (1.0 - square)


def length(offsets: np.ndarray) -> np.ndarray:
    """Length of offsets, or speed of velocities, in the plane, (..., 2) -> (...)."""
    return np.hypot(offsets[..., 0], offsets[..., 1])


def crest(data: NamedFields, boxes: list[str], start: float, end: float) -> float:
    """Height of the highest of the boxes between two places, metres; 0 if there is none."""
    low, high = min(start, end) - 2.5 * HALF, max(start, end) + 2.5 * HALF
    places = data.site_xpos[boxes]
    tops = [float(p[2]) + HALF for p in places if low < p[0] < high and p[2] < _BELOW]
    return max(tops, default=0.0)


def lies_too_low(box: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Height that a box (N, 2) lacks to pass the floor and others (N, n, 2), metres, (N,)."""
    beside = np.abs(others[..., 0] - box[..., None, 0])
    lack = others[..., 1] + HALF + PASSES - box[..., None, 1]
    # It must begin to rise at 0.13 m from another one's middle, and be above at 0.09 m.
    lack *= np.clip((0.13 - beside) / (0.13 - 0.09), 0.0, 1.0) * (others[..., 1] < _BELOW)
    # A box that is dragged over the floor, below 50 mm, turns in the hand.
    return np.maximum(lack.max(axis=-1), np.maximum(0.05 - box[..., 1], 0.0))
