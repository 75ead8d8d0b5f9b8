"""Pixel observations: a picture at each step, optionally stacked with the previous ones.

    pixels = {"camera": "side", "height": 84, "width": 84, "frame_stack": 3}
    env = suite.load("humanoid", "walk", environment_kwargs={"pixels": pixels})
    env.reset().observation["pixels"]     # (84, 84, 9) uint8

Stacked pictures are concatenated along the last axis, the newest last: `pixels[..., -3:]` is the
current one. At the start of an episode the stack holds copies of the first picture. A row of a
batch observes the same pixels as the single environment with its seed. Without OpenGL, the first
picture raises.

With a list of C cameras, each frame has 3 C channels, three of each camera in the order of the
list, and frames are stacked as before:

    pixels = {"camera": ["side", "back"], "frame_stack": 3}     # (84, 84, 18)
    frames = np.split(observation["pixels"], 3, axis=-1)        # the oldest first
    side, back = np.split(frames[-1], 2, axis=-1)               # the current pictures
"""

import collections
import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from typing import Self, TypeVar

import numpy as np
from dm_env import specs

from limberjack.rl.contract import Drawn
from limberjack.rl.guards import at_least_one
from limberjack.rl.observations import of_type
from limberjack.utils.suggest import check_names
from limberjack.worlds.appearance.looks import Looks

__all__ = [
    "PIXELS_KEY",
    "Frames",
    "PixelOptions",
    "Pixels",
    "cameras_of",
    "render_arguments",
    "render_cameras",
    "saved_pictures",
]

PIXELS_KEY = "pixels"  # name of the pictures among the observations

_V = TypeVar("_V")
_P = TypeVar("_P")


PixelOptions = Mapping[str, object]  # the attributes of `Pixels`, checked by `Pixels.of`


@dataclasses.dataclass(frozen=True)
class Pixels:
    """Options of pixel observations.

    Attributes:
      camera: name or number of a camera of the model, or a list of them; -1 is the free camera.
      height: height of a picture, pixels.
      width: width of a picture, pixels.
      only: whether to observe nothing else.
      frame_stack: number of most recent pictures observed together.
      quality: 'full' or 'fast'; see `Physics.render`.
    """

    camera: int | str | Sequence[int | str] = -1
    height: int = 84
    width: int = 84
    only: bool = False
    frame_stack: int = 1
    quality: str = "full"

    def __post_init__(self) -> None:
        cameras = cameras_of(self.camera, "pixels' camera")
        # A list of one camera is that camera, and other lists cannot change later.
        object.__setattr__(self, "camera", tuple(cameras) if len(cameras) > 1 else cameras[0])
        at_least_one("pixels' frame_stack", self.frame_stack)
        if not isinstance(self.only, bool | np.bool_):
            raise ValueError(f"pixels' only is {self.only!r}; expected True or False")

    @classmethod
    def of(cls, options: "PixelOptions | Pixels") -> Self:
        """Options from a mapping, with defaults for those omitted.

        Raises:
          TypeError: `options` is not a mapping, or has an unknown option.
          ValueError: an option has an invalid value.
        """
        if isinstance(options, cls):
            return options
        if not isinstance(options, Mapping):
            raise TypeError(
                f"pixels is {options!r}; expected a mapping such as {{'camera': 0, 'height': 84}}"
            )
        known = [field.name for field in dataclasses.fields(cls)]
        check_names("pixels has no option", options, known)
        return dataclasses.replace(cls(), **options)

    @property
    def render_kwargs(self) -> dict[str, object]:
        """The keyword arguments of `Physics.render`, or `render_cameras`, for one frame."""
        size = {"height": self.height, "width": self.width}
        return {**size, "camera_id": self.camera, "quality": self.quality}


class Frames:
    """The most recent pictures of each simulation."""

    def __init__(self, pixels: Pixels, physics: Drawn) -> None:
        """Validates the options; renders nothing yet.

        Args:
          pixels: the options.
          physics: a single simulation or batch, such as a `mujoco.Physics`.

        Raises:
          ValueError: there is no such camera, or the size is not positive or too large.
          TypeError: the physics cannot be rendered.
        """
        if not hasattr(physics, "render_rows"):
            raise TypeError(
                f"a {type(physics).__name__} cannot be rendered; pixels need a limberjack.mujoco."
                "Physics"
            )
        # Validates each camera; the pictures of all have the same shape.
        kwargs, cameras = pixels.render_kwargs, cameras_of(pixels.camera)
        pictures = [physics.picture_spec(**{**kwargs, "camera_id": one}) for one in cameras]
        (height, width, colours), dtype = pictures[0]
        self._colours = colours * len(pictures)  # of one frame
        self.pixels = pixels
        self._is_single = physics.num_envs is None
        stacked = height, width, self._colours * pixels.frame_stack
        self._stack = np.zeros((physics.num_envs or 1, *stacked), dtype)
        self._is_seen = np.zeros(len(self._stack), bool)  # rows with a picture of this episode
        # Steps between two pictures of a row; only where it is not 1, steps are counted.
        self.interval = 1
        self._since_picture = np.zeros(len(self._stack), int)

    @classmethod
    def of(cls, pixels: PixelOptions | Pixels | None, physics: Drawn) -> Self | None:
        """Frames for a user's options; None for None. Raises like `Pixels.of` and `__init__`."""
        return None if pixels is None else cls(Pixels.of(pixels), physics)

    @property
    def schedule(self) -> tuple[int, np.ndarray]:
        """The interval, and the steps since the last picture of each row, (n,)."""
        return self.interval, self._since_picture.copy()

    @schedule.setter
    def schedule(self, schedule: tuple[int, np.ndarray]) -> None:
        self.interval, self._since_picture = schedule

    def forget(self, rows: np.ndarray | slice = slice(None)) -> None:
        """Makes rows that begin an episode start a new stack with their next picture."""
        self._is_seen[rows] = False

    def observe(
        self, physics: Drawn, state: Mapping[str, _V], is_step: bool = True
    ) -> MutableMapping[str, _V | np.ndarray]:
        """The observation with the current pictures.

        Args:
          physics: the single simulation or batch to render.
          state: the other observations.
          is_step: whether this is a step, after which every row is rendered, or every row whose
            `interval` is over; if False, only rows without a picture of their episode.
        """
        rows = None if is_step and self.interval == 1 else self._due(is_step)
        if rows is None or rows.size:
            draw = functools.partial(physics.render_rows, rows)
            self._add(render_cameras(draw, self.pixels.render_kwargs, axis=-1), rows)
        return self._with(state, self._stack[0].copy() if self._is_single else self._stack.copy())

    def spec_with(self, state: Mapping[str, specs.Array]) -> MutableMapping[str, specs.Array]:
        """The observation specs, given those of the other observations."""
        shape = self._stack.shape[1:] if self._is_single else self._stack.shape
        dtype = self._stack.dtype
        return self._with(state, specs.BoundedArray(shape, dtype, 0, 255, name=PIXELS_KEY))

    def save(self, rows: np.ndarray | None) -> dict[str, np.ndarray]:
        """Copies of the stacks of rows, None for all: (n, ...) each."""
        index = slice(None) if rows is None else rows
        return {"stack": self._stack[index].copy(), "is_seen": self._is_seen[index].copy()}

    def load(self, saved: dict[str, np.ndarray], rows: np.ndarray | None) -> None:
        """Restores the result of `save`."""
        index = slice(None) if rows is None else rows
        self._stack[index] = saved["stack"]
        self._is_seen[index] = saved["is_seen"]

    def origin(self) -> dict[str, object]:
        """Options that must match for a saved stack to be loaded."""
        settings = dataclasses.asdict(self.pixels)
        del settings["only"]  # the stack does not depend on it
        return {"pixels": settings}

    def _due(self, is_step: bool) -> np.ndarray:
        """The rows to render: those without a picture, and those whose interval is over."""
        self._since_picture += is_step
        is_over = is_step & (self._since_picture >= self.interval)
        rows = np.flatnonzero(is_over | ~self._is_seen)
        self._since_picture[rows] = 0
        return rows

    def _add(self, frames: np.ndarray, rows: np.ndarray | None) -> None:
        """Pushes a frame per row onto its stack; an episode's first frame fills the stack."""
        index = slice(None) if rows is None else rows
        stack = np.concatenate([self._stack[index][..., self._colours :], frames], axis=-1)
        is_first = ~self._is_seen[index]
        stack[is_first] = np.tile(frames[is_first], self.pixels.frame_stack)
        self._stack[index] = stack
        self._is_seen[index] = True

    def _with(self, state: Mapping[str, _V], pixels: _P) -> MutableMapping[str, _V | _P]:
        """Observations, or their specs, together with the pictures or their spec."""
        if self.pixels.only:
            return collections.OrderedDict({PIXELS_KEY: pixels})
        if not isinstance(state, MutableMapping) or PIXELS_KEY in state:
            what = f"one {PIXELS_KEY!r}" if isinstance(state, MutableMapping) else type(state)
            raise ValueError(
                f"the task observes {what}; expected a dict without {PIXELS_KEY!r}, to which "
                "pictures can be added: use pixels with only=True, or no pixels"
            )
        both: MutableMapping[str, _V | _P] = of_type(state, state)
        both[PIXELS_KEY] = pixels
        return both


def render_arguments(given: Mapping[str, object]) -> dict[str, object]:
    """Keyword arguments of `Physics.render`, where `camera` may stand for `camera_id`.

    Raises:
      TypeError: both are given.
    """
    arguments = dict(given)
    if "camera" in arguments:
        if "camera_id" in arguments:
            raise TypeError("camera is given twice: once as camera and once as camera_id")
        arguments["camera_id"] = arguments.pop("camera")
    return arguments


def cameras_of(camera: object, what: str = "camera_id") -> list[object]:
    """The cameras of an argument that takes one camera or a list of them.

    Args:
      camera: a name or number, or a list or tuple of them. The simulation checks names and numbers.
      what: the argument's name, for messages.

    Raises:
      ValueError: the list is empty.
      TypeError: it is a collection of another kind, or nested.
    """
    cameras = list(camera) if isinstance(camera, list | tuple) else [camera]
    if not cameras:
        raise ValueError(f"{what} is {camera!r}; expected at least one camera")
    for one in cameras:
        if np.iterable(one) and not isinstance(one, str):
            raise TypeError(
                f"{what} is {camera!r}; expected the name or number of a camera, or a list of them"
            )
    return cameras


def render_cameras(
    draw: Callable[..., np.ndarray], kwargs: Mapping[str, object], axis: int
) -> np.ndarray:
    """A picture, or those of a list of cameras joined in the order of the list.

    Args:
      draw: draws the picture of one camera, such as `Physics.render`.
      kwargs: the arguments of `draw`, whose `camera_id` may be a list.
      axis: the axis along which pictures are joined; the axis of width puts them side by side.

    Raises:
      ValueError, TypeError: see `cameras_of`, and `draw`.
    """
    if not isinstance(kwargs.get("camera_id"), list | tuple):
        return draw(**kwargs)
    cameras = cameras_of(kwargs["camera_id"])
    given = dict(kwargs)
    overlays = given.get("overlays")
    if isinstance(overlays, Iterable):  # an iterator would serve one picture only
        given["overlays"] = tuple(overlays)
    pictures = [draw(**{**given, "camera_id": camera}) for camera in cameras]
    return pictures[0] if len(pictures) == 1 else np.concatenate(pictures, axis=axis)


def saved_pictures(
    frames: Frames | None, looks: Looks | None, rows: np.ndarray | None
) -> dict[str, np.ndarray]:
    """The stacks of pictures of rows, and what their looks are drawn from, if there are any."""
    found = {} if frames is None else frames.save(rows)
    return found if looks is None else {**found, **looks.save(rows)}
