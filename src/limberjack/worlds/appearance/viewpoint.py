"""Poses of cameras, drawn for an episode.

    walk = CameraWalk(stream, start, scale=0.1, is_moving=True)
    place, roll = walk.at(3)           # after three changes
    pose = distracted(pose, place, roll, start, centre, lookat)
    pose = turned(pose, rotation(stream, 90.0))

`CameraWalk` moves a camera on a sphere as the Distracting Control Suite does (camera.py),
`rotation` and `shift` turn it as DMC-GB2 does (dmcgb_geometric.py); see `options`.
"""

from typing import NamedTuple

import numpy as np

__all__ = ["CameraWalk", "Pose", "Sphere", "distracted", "rotation", "shift", "sphere_of", "turned"]

# Of DCS, times the scale s: suite_utils.py.
_ANGLE = np.pi / 2  # greatest change of each angle, radians
_NEARER, _FARTHER = 0.5, 1.5  # greatest changes of the radius, as shares of it
_SPEED, _MOST_SPEED = 0.1, 0.4  # standard deviation of a change, and the most; per change
_ROLL, _MOST_ROLL = np.pi / 300, np.pi / 50  # the same of the roll, radians
_RADIUS = 4.0  # of the start, for which the speeds are given; metres

# Of DMC-GB2: degrees to the right and left, up, and down, by the model's name; others are ours.
_RECTANGLES = {
    "cart-pole": (8.0, 10.0, 10.0),
    "finger": (6.0, 12.0, 6.0),
    "ball in cup": (6.0, 12.0, 6.0),
}
_RECTANGLE = (10.0, 10.0, 10.0)  # of the walker and the cheetah
_PLACES = 100  # from which a rotation, or a place on a rectangle's border, is drawn
_SIDES = 4

_LEVEL = np.array([0.0, 0.0, 1.0])  # upwards


class Pose(NamedTuple):
    """A camera in the world: its place (3,), metres, and its axes, the columns of (3, 3).

    It looks against its third axis, and its second one points up.
    """

    position: np.ndarray
    axes: np.ndarray


class Sphere(NamedTuple):
    """A place on a sphere: its radius, metres; the angles about, and from, the vertical axis."""

    radius: float
    horizontal: float
    vertical: float

    @property
    def is_above(self) -> bool:
        """Whether it is in front of the centre and above it, but not straight above."""
        return 0.0 < self.vertical <= np.pi / 2 and -np.pi <= self.horizontal <= 0.0

    @property
    def vector(self) -> np.ndarray:
        """The place relative to the centre, (3,)."""
        across = self.radius * np.sin(self.vertical)
        return np.array(
            [
                across * np.cos(self.horizontal),
                across * np.sin(self.horizontal),
                self.radius * np.cos(self.vertical),
            ]
        )


def sphere_of(vector: np.ndarray) -> Sphere:
    """The place on a sphere of a vector from its centre, (3,)."""
    x, y, z = vector.tolist()
    across = float(np.hypot(x, y))
    return Sphere(float(np.hypot(across, z)), float(np.arctan2(y, x)), float(np.arctan2(across, z)))


class CameraWalk:
    """A place on a sphere and a roll that begin anywhere in their ranges, and may walk in them."""

    def __init__(
        self, stream: np.random.RandomState, start: Sphere, scale: float, is_moving: bool
    ) -> None:
        """Draws the first place.

        Args:
          stream: the camera's own.
          start: the place that the model gives the camera. One in the quadrant in front of and
            above the centre stays in it.
          scale: of the ranges.
          is_moving: whether it moves.
        """
        self._stream = stream
        turn = _ANGLE * scale
        low = np.array([start.radius * (1 - _NEARER * scale), *np.subtract(start[1:], turn)])
        high = np.array([start.radius * (1 + _FARTHER * scale), *np.add(start[1:], turn)])
        if start.is_above:
            low[1:] = np.maximum(low[1:], (-np.pi, 0.0))
            high[1:] = np.minimum(high[1:], (0.0, np.pi / 2))
        self._low, self._high, self._most_roll = low, high, turn
        angles = [stream.uniform(low[i], high[i]) for i in (1, 2)]
        self._place = Sphere(stream.uniform(low[0], high[0]), *angles)
        self._roll = stream.uniform(-turn, turn)
        speed = scale if is_moving else 0.0
        direction = stream.randn(3)
        direction /= np.linalg.norm(direction)
        self._velocity = direction * stream.uniform(0.0, _MOST_SPEED * speed)
        self._roll_velocity = stream.uniform(-_MOST_ROLL * speed, _MOST_ROLL * speed)
        self._speed, self._unit = speed, start.radius / _RADIUS
        self.changes = -1  # the first picture is taken after one, as in DCS
        self.at(0)

    def at(self, changes: int) -> tuple[Sphere, float]:
        """The place and the roll after a number of changes, at least those made so far."""
        while self.changes < changes:
            self.changes += 1
            self._change()
        return self._place, self._roll

    def _change(self) -> None:
        push = self._stream.randn(3) * _SPEED * self._speed * self._unit
        velocity = self._velocity + push
        roll_velocity = self._roll_velocity + self._stream.randn() * _ROLL * self._speed
        most = _MOST_SPEED * self._speed * self._unit
        speed = np.linalg.norm(velocity)
        if speed > most:
            velocity *= most / speed
        most_roll = _MOST_ROLL * self._speed
        before = self._place.vector
        moved = np.clip(sphere_of(before + velocity), self._low, self._high)
        self._place = Sphere(*moved.tolist())
        self._velocity = self._place.vector - before
        roll = self._roll + np.clip(roll_velocity, -most_roll, most_roll)
        roll = float(np.clip(roll, -self._most_roll, self._most_roll))
        self._roll_velocity, self._roll = roll - self._roll, roll


def distracted(
    pose: Pose,
    place: Sphere,
    roll: float,
    start: Sphere,
    centre: np.ndarray,
    lookat: np.ndarray,
) -> Pose:
    """The pose at another place on the sphere, from which the camera looks at the same point.

    Args:
      pose: the camera's own.
      place: the new place.
      roll: about the direction of view, radians.
      start: the place that the model gives the camera.
      centre: of the sphere, (3,).
      lookat: the point, (3,).
    """
    now = sphere_of(pose.position - centre)
    moved = Sphere(
        place.radius * now.radius / start.radius,
        now.horizontal + place.horizontal - start.horizontal,
        now.vertical + place.vertical - start.vertical,
    )
    position = centre + moved.vector
    direction = lookat - position
    direction = direction / np.linalg.norm(direction)
    axes = _level(direction) if start.is_above else _rotated(pose.axes, direction)
    return turned(Pose(position, axes), _about_view(roll))


def turned(pose: Pose, turn: np.ndarray) -> Pose:
    """The pose turned about the camera's own axes by a matrix, (3, 3)."""
    return Pose(pose.position, pose.axes @ turn)


def rotation(stream: np.random.RandomState, degrees: float) -> np.ndarray:
    """A roll drawn from evenly spaced angles within +- degrees, (3, 3)."""
    share = 2 * stream.randint(_PLACES) / _PLACES - 1
    return _about_view(np.radians(share * degrees))


def shift(stream: np.random.RandomState, name: str, scale: float) -> np.ndarray:
    """A turn that shows the centre at a place drawn from a rectangle's border, (3, 3).

    Args:
      stream: the camera's own.
      name: of the model, which has its rectangle.
      scale: of the rectangle.
    """
    side, up, down = np.multiply(_RECTANGLES.get(name, _RECTANGLE), scale)
    corners = np.array([[-side, -down], [side, -down], [side, up], [-side, up]])
    number, along = divmod(int(stream.randint(_PLACES)), _PLACES // _SIDES)
    step = (corners[(number + 1) % _SIDES] - corners[number]) / (_PLACES // _SIDES)
    pitch, roll = np.radians(corners[number] + along * step)  # about the second and the first axis
    about_second = np.array(
        [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
    )
    about_first = np.array(
        [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    )
    return about_second @ about_first


def _about_view(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def _level(direction: np.ndarray) -> np.ndarray:
    """Axes of a camera that looks in a direction with a level horizon."""
    right = np.cross(direction, _LEVEL)
    length = np.linalg.norm(right)
    right = right / length if length else np.array([1.0, 0.0, 0.0])
    return np.stack([right, np.cross(right, direction), -direction], axis=-1)


def _rotated(axes: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Axes turned by the smallest rotation after which the camera looks in a direction."""
    view = -axes[:, 2]
    about, cos = np.cross(view, direction), float(view @ direction)
    if (
        cos <= -1.0 + 1e-12
    ):  # straight back: any half turn will do, such as one about the second axis
        return axes * np.array([-1.0, 1.0, -1.0])
    x, y, z = about.tolist()
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (np.eye(3) + cross + cross @ cross / (1 + cos)) @ axes
