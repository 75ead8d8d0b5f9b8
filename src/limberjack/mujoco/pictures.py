"""Pictures of a scene: RGB, depth or segmentation, drawn and read back.

    style = Style.of(depth=True)
    with scene.override_flags(style.flags):
        raw = call(model, draw, scene, style, 240, 320, size=(240, 320))
    metres = finished(raw, style, model, scene)

`draw` runs on the rendering thread; everything else runs on the caller's.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple, Protocol

import mujoco
import numpy as np

from limberjack.mujoco.wrapper import MjvScene
from limberjack.mujoco.wrapper.visual import RenderFlag
from limberjack.utils.suggest import did_you_mean

__all__ = ["Contents", "Overlay", "Style", "draw", "finished"]

# Arguments of `mjv_updateScene` before the scene; None is the perturbation.
Contents = tuple[mujoco.MjModel, mujoco.MjData, mujoco.MjvOption, None, mujoco.MjvCamera, int]

# Flag overrides per quality: 'full' uses the scene's own flags, as dm_control does.
_QUALITIES: dict[str, dict[str, bool]] = {
    "full": {},
    # These take three quarters of the time of a small picture with a software renderer.
    "fast": {"shadow": False, "reflection": False, "skybox": False},
}
_BACKGROUND = -1
_NUMBERED = {  # draws each object in a colour that encodes its id in the scene plus one
    mujoco.mjtRndFlag.mjRND_SEGMENT.value: True,
    mujoco.mjtRndFlag.mjRND_IDCOLOR.value: True,
}


class Overlay(Protocol):
    """Something drawn over a picture, such as a `TextOverlay`."""

    def draw(self, context: mujoco.MjrContext, rect: mujoco.MjrRect) -> None:
        """Draws the overlay; called on the rendering thread."""
        ...


def _check_quality(quality: object) -> None:
    """Raises ValueError unless it is 'full' or 'fast'."""
    if not isinstance(quality, str) or quality not in _QUALITIES:
        raise ValueError(
            f"quality is {quality!r}; expected 'full' or 'fast'.{did_you_mean(quality, _QUALITIES)}"
        )


class Style(NamedTuple):
    """The kind of picture to draw, with overlays and flag overrides."""

    overlays: tuple[Overlay, ...]
    depth: bool
    segmentation: bool
    flags: Mapping[RenderFlag, bool]

    @property
    def is_rgb(self) -> bool:
        """Whether the picture has colours."""
        return not (self.depth or self.segmentation)

    @classmethod
    def of(
        cls,
        overlays: Iterable[Overlay] = (),
        depth: bool = False,
        segmentation: bool = False,
        render_flag_overrides: Mapping[RenderFlag, bool] | None = None,
        quality: str = "full",
    ) -> "Style":
        """The style for these `render` arguments; flag overrides take precedence over the quality.

        Raises:
          ValueError: incompatible arguments, or an unknown quality.
        """
        overlays = tuple(overlays)
        _check_quality(quality)
        if depth and segmentation:
            raise ValueError("`depth` and `segmentation` cannot both be true: render twice")
        if overlays and (depth or segmentation):
            raise ValueError("`overlays` need an RGB picture: omit `depth` and `segmentation`")
        if render_flag_overrides and (depth or segmentation):
            raise ValueError(
                "`render_flag_overrides` need an RGB picture: omit `depth` and `segmentation`"
            )
        drawn = {**_QUALITIES[quality], **(render_flag_overrides or {})}
        flags = _NUMBERED if segmentation else drawn
        return cls(overlays, depth, segmentation, flags)


def draw(
    context: mujoco.MjrContext,
    scene: MjvScene,
    style: Style,
    height: int,
    width: int,
    contents: Contents | None = None,
) -> np.ndarray:
    """Pixels, (height, width, 3) uint8, or depth buffer, (height, width) float32; bottom row first.

    Args:
      context: MuJoCo's rendering context.
      scene: the scene to draw.
      style: the kind of picture.
      height: pixels.
      width: pixels.
      contents: arguments of `mjv_updateScene`, to update the scene before drawing; None if it is
        up to date.
    """
    if contents is not None:
        mujoco.mjv_updateScene(*contents, scene)
    rect = mujoco.MjrRect(0, 0, width, height)
    mujoco.mjr_render(rect, scene, context)
    if style.depth:
        depth = np.empty((height, width), np.float32)
        mujoco.mjr_readPixels(None, depth, rect, context)
        return depth
    for overlay in style.overlays:
        overlay.draw(context, rect)
    rgb = np.empty((height, width, 3), np.uint8)
    mujoco.mjr_readPixels(rgb, None, rect, context)
    return rgb


def finished(raw: np.ndarray, style: Style, model: mujoco.MjModel, scene: MjvScene) -> np.ndarray:
    """The final picture, top row first, from the result of `draw`; always a new array."""
    if style.depth:
        raw = _metres(raw, model)
    elif style.segmentation:
        return _object_numbers(raw[::-1], scene)
    return raw[::-1].copy()


def _metres(depth: np.ndarray, model: mujoco.MjModel) -> np.ndarray:
    """Depth along the camera's axis, float32 metres, from depth buffer values in 0 to 1."""
    near = model.vis.map.znear * model.stat.extent
    far = model.vis.map.zfar * model.stat.extent
    # Inverts the perspective division, with dm_control's order of operations.
    return near / (1 - depth * (1 - near / far))


def _object_numbers(rgb: np.ndarray, scene: MjvScene) -> np.ndarray:
    """Object id and `mjtObj` type of each pixel, (height, width, 2) int32."""
    pairs = np.full((scene.ngeom + 1, 2), _BACKGROUND, np.int32)
    for geom in scene.geoms:
        if 0 <= geom.segid < scene.ngeom:
            pairs[geom.segid + 1] = geom.objid, geom.objtype
    codes = rgb.astype(np.uint32)
    codes = codes[..., 0] + (codes[..., 1] << 8) + (codes[..., 2] << 16)
    codes[codes > scene.ngeom] = 0  # a geom that a callback added without an id
    return pairs[codes]
