"""Pixel observations: a picture at each step, optionally stacked with the previous ones.

    pixels = {"camera": "side", "height": 84, "width": 84, "frame_stack": 3}
    env = suite.load("humanoid", "walk", environment_kwargs={"pixels": pixels})
    env.reset().observation["pixels"]     # (84, 84, 9) uint8

Stacked pictures are concatenated along the last axis, the newest last: `pixels[..., -3:]` is the
current one. At the start of an episode the stack holds copies of the first picture. A row of a
batch observes the same pixels as the single environment with its seed. Without OpenGL, the first
picture raises.
"""

import collections
import dataclasses
from collections.abc import Mapping, MutableMapping
from typing import Any, Self, TypeVar

import numpy as np
from dm_env import specs

from limberjack.rl.contract import Drawn
from limberjack.rl.guards import at_least_one
from limberjack.utils.suggest import did_you_mean

__all__ = ["PIXELS_KEY", "Frames", "PixelOptions", "Pixels", "render_arguments"]

PIXELS_KEY = "pixels"  # name of the pictures among the observations

_COLOURS = 3

_V = TypeVar("_V")
_P = TypeVar("_P")


PixelOptions = Mapping[str, Any]  # Any: the attributes of `Pixels`, checked by `Pixels.of`


@dataclasses.dataclass(frozen=True)
class Pixels:
    """Options of pixel observations.

    Attributes:
      camera: name or number of a camera of the model; -1 is the free camera.
      height: height of a picture, pixels.
      width: width of a picture, pixels.
      only: whether to observe nothing else.
      frame_stack: number of most recent pictures observed together.
      quality: 'full' or 'fast'; see `Physics.render`.
    """

    camera: int | str = -1
    height: int = 84
    width: int = 84
    only: bool = False
    frame_stack: int = 1
    quality: str = "full"

    def __post_init__(self) -> None:
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
        for name in options:
            if name not in known:
                raise TypeError(
                    f"pixels has no option {name!r}.{did_you_mean(name, known)} It takes: "
                    f"{', '.join(known)}."
                )
        return cls(**options)

    @property
    def render_kwargs(self) -> dict[str, int | str]:
        """The keyword arguments of `Physics.render` for one picture."""
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
        shape, dtype = physics.picture_spec(**pixels.render_kwargs)
        height, width, colours = shape
        self.pixels = pixels
        self._is_single = physics.num_envs is None
        stacked = height, width, colours * pixels.frame_stack
        self._stack = np.zeros((physics.num_envs or 1, *stacked), dtype)
        self._is_seen = np.zeros(len(self._stack), bool)  # rows with a picture of this episode

    @classmethod
    def of(cls, pixels: PixelOptions | Pixels | None, physics: Drawn) -> Self | None:
        """Frames for a user's options; None for None. Raises like `Pixels.of` and `__init__`."""
        return None if pixels is None else cls(Pixels.of(pixels), physics)

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
          is_step: whether to render every row; if False, only those without a picture of their
            episode.
        """
        rows = None if is_step else np.flatnonzero(~self._is_seen)
        if rows is None or rows.size:
            self._add(physics.render_rows(rows, **self.pixels.render_kwargs), rows)
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

    def _add(self, pictures: np.ndarray, rows: np.ndarray | None) -> None:
        """Pushes a picture per row onto its stack; an episode's first picture fills the stack."""
        index = slice(None) if rows is None else rows
        stack = np.concatenate([self._stack[index][..., _COLOURS:], pictures], axis=-1)
        is_first = ~self._is_seen[index]
        stack[is_first] = np.tile(pictures[is_first], self.pixels.frame_stack)
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
        make: Any = type(state)  # a mapping type whose constructor accepts a mapping
        both: MutableMapping[str, _V | _P] = make(state)
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
