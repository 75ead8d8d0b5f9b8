"""The official visualisation structs with dm_control's additions.

Each has `ptr`, which is the object itself. None of them uses OpenGL.
"""

import contextlib
from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from limberjack.mujoco.allocating import allocating
from limberjack.mujoco.wrapper.model import MjModel

__all__ = ["MjvCamera", "MjvFigure", "MjvOption", "MjvPerturb", "MjvScene", "RenderFlag"]

RenderFlag = str | int | mujoco.mjtRndFlag  # such as 'wireframe'

_FEWEST_SCENE_GEOMS = 1000
_GEOM_BYTES = 236  # size of MuJoCo's mjvGeom


class MjvCamera(mujoco.MjvCamera):
    """A camera of a scene."""

    @property
    def ptr(self) -> "MjvCamera":
        return self

    @property
    def type_(self) -> int:
        """Another name for `type`."""
        return self.type

    @type_.setter
    def type_(self, value: int) -> None:
        self.type = value


class MjvOption(mujoco.MjvOption):
    """Visualisation options; unlike MuJoCo's default, rangefinder rays are not drawn."""

    def __init__(self) -> None:
        super().__init__()
        self.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = False

    @property
    def ptr(self) -> "MjvOption":
        return self


class MjvPerturb(mujoco.MjvPerturb):
    """Selection and perturbation of a body."""

    @property
    def ptr(self) -> "MjvPerturb":
        return self


class MjvFigure(mujoco.MjvFigure):
    """A two-dimensional plot."""

    @property
    def ptr(self) -> "MjvFigure":
        return self

    @property
    def range_(self) -> np.ndarray:
        """Another name for `range`."""
        return self.range

    @range_.setter
    def range_(self, value: np.ndarray) -> None:
        self.range = value


class MjvScene(mujoco.MjvScene):
    """The geoms, lights and cameras that are drawn."""

    def __init__(self, model: MjModel | None = None, max_geom: int | None = None) -> None:
        """Creates a scene.

        Args:
          model: the model to draw, or None for an empty scene.
          max_geom: maximum number of geoms; by default enough for the model and its decorations.
        """
        if model is None:
            super().__init__()
            return
        raw = model._official
        count = max_geom or max(_FEWEST_SCENE_GEOMS, _renderable_geoms(raw))
        with allocating(f"a scene of {count} geoms", count * _GEOM_BYTES):
            super().__init__(raw, count)

    @property
    def ptr(self) -> "MjvScene":
        return self

    @property
    def geoms(self) -> Sequence[mujoco.MjvGeom]:
        """The geoms currently in the scene."""
        return super().geoms[: super().ngeom]

    @contextlib.contextmanager
    def override_flags(self, overrides: Mapping[RenderFlag, bool] | None) -> Iterator[None]:
        """Sets rendering flags within the context.

        Args:
          overrides: values by flag: a name such as 'wireframe', or a `mujoco.mjtRndFlag`.
        """
        if not overrides:
            yield
            return
        before = self.flags.copy()
        try:
            for flag, value in overrides.items():
                self.flags[_render_flag(flag)] = value
            yield
        finally:
            np.copyto(self.flags, before)

    def free(self) -> None:
        """Does nothing: the scene is freed with its last reference."""


def _render_flag(flag: RenderFlag) -> int:
    """Index of a rendering flag, given by name or number."""
    if not isinstance(flag, str):
        return int(flag)
    names = mujoco.mjtRndFlag.__members__
    member = names.get(f"mjRND_{flag.upper()}")
    if member is None:
        known = ", ".join(name.removeprefix("mjRND_").lower() for name in list(names)[:-1])
        raise ValueError(f"{flag!r} is not a rendering flag; expected one of: {known}")
    return member.value


def _renderable_geoms(model: mujoco.MjModel) -> int:
    """Upper bound for the number of geoms of the model and its usual decorations."""
    frames = max(model.nbody, model.ngeom, model.nsite, model.ncam, model.nlight)
    drawn_once = ("nsite", "ntendon", "njnt", "nu", "nskin", "ncam", "nlight")
    axes, per_geom, per_body = 3, 4, 3  # frame axes; contacts and forces; mass and perturbation
    return (
        axes * frames
        + per_geom * model.ngeom
        + per_body * model.nbody
        + sum(getattr(model, size) for size in drawn_once)
    )
