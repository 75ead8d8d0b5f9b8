"""What a picture is: a scene drawn and read back, as colours, distances or object numbers.

    style = Style.of(depth=True)
    with scene.override_flags(style.flags):
        raw = call(model, draw, scene, style, 240, 320, size=(240, 320))
    metres = finished(raw, style, model, scene)

`draw` runs on the rendering thread; all else is for the caller's.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple, Protocol

import mujoco
import numpy as np

from limberjack.mujoco.wrapper import MjvScene
from limberjack.mujoco.wrapper.visual import RenderFlag
from limberjack.utils.suggest import did_you_mean

__all__ = ["Overlay", "Style", "draw", "finished"]

# Flags by what is asked for: 'full' draws all that the scene's flags say, as dm_control does.
_QUALITIES: dict[str, dict[str, bool]] = {
    "full": {},
    # What takes three quarters of a small picture's time with a software renderer.
    "fast": {"shadow": False, "reflection": False, "skybox": False},
}
_BACKGROUND = -1
_NUMBERED = {  # Each object in a colour that is its number in the scene, plus one.
    mujoco.mjtRndFlag.mjRND_SEGMENT.value: True,
    mujoco.mjtRndFlag.mjRND_IDCOLOR.value: True,
}


class Overlay(Protocol):
    """What is drawn on a picture, such as a `TextOverlay`."""

    def draw(self, context: mujoco.MjrContext, rect: mujoco.MjrRect) -> None:
        """Draws it; called on the rendering thread."""
        ...


class Style(NamedTuple):
    """What is drawn of a scene."""

    overlays: tuple[Overlay, ...]
    depth: bool
    segmentation: bool
    flags: Mapping[RenderFlag, bool]

    @classmethod
    def of(
        cls,
        overlays: Iterable[Overlay] = (),
        depth: bool = False,
        segmentation: bool = False,
        render_flag_overrides: Mapping[RenderFlag, bool] | None = None,
        quality: str = "full",
    ) -> "Style":
        """The style of dm_control's arguments, and of a quality, which the overrides come before.

        Raises:
          ValueError: they cannot be combined, or there is no such quality.
        """
        overlays = tuple(overlays)
        if not isinstance(quality, str) or quality not in _QUALITIES:
            raise ValueError(
                f"quality is {quality!r}; expected 'full' or 'fast'."
                f"{did_you_mean(quality, _QUALITIES)}"
            )
        if depth and segmentation:
            raise ValueError("`depth` and `segmentation` cannot both be true: render twice")
        if overlays and (depth or segmentation):
            raise ValueError("`overlays` are drawn in colours only, without depth or segmentation")
        if render_flag_overrides and (depth or segmentation):
            raise ValueError(
                "`render_flag_overrides` are for colours only, without depth or segmentation"
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
    contents: tuple | None = None,
) -> np.ndarray:
    """The pixels or the depth buffer, (height, width, 3) uint8 or float32, lowest row first.

    Args:
      context: what to draw in.
      scene: what to draw.
      style: how.
      height: pixels.
      width: pixels.
      contents: what `mjv_updateScene` is to take into the scene before; None if it is there.
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
    """The picture, uppermost row first, from what `draw` returned: an array of its own."""
    if style.depth:
        raw = _metres(raw, model)
    elif style.segmentation:
        return _object_numbers(raw[::-1], scene)
    return raw[::-1].copy()


def _metres(depth: np.ndarray, model: mujoco.MjModel) -> np.ndarray:
    """Distances along the camera's axis, float32, from the depth buffer's 0 to 1."""
    near = model.vis.map.znear * model.stat.extent
    far = model.vis.map.zfar * model.stat.extent
    # The inverse of the perspective division; as dm_control, operation by operation.
    return near / (1 - depth * (1 - near / far))


def _object_numbers(rgb: np.ndarray, scene: MjvScene) -> np.ndarray:
    """(height, width, 2) int32 of each pixel's object number and type."""
    pairs = np.full((scene.ngeom + 1, 2), _BACKGROUND, np.int32)
    for geom in scene.geoms:
        if 0 <= geom.segid < scene.ngeom:
            pairs[geom.segid + 1] = geom.objid, geom.objtype
    codes = rgb.astype(np.uint32)
    codes = codes[..., 0] + (codes[..., 1] << 8) + (codes[..., 2] << 16)
    codes[codes > scene.ngeom] = 0  # A geom that a callback added without a number.
    return pairs[codes]
