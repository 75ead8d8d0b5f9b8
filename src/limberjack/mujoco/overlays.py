"""`TextOverlay`: text drawn over a picture.

physics.render(overlays=[TextOverlay("reward", "0.93", position="bottom left")])
"""

from collections.abc import Mapping
from typing import TypeVar

import mujoco

from limberjack.mujoco.wrapper.util import to_binary_string
from limberjack.utils.suggest import did_you_mean

__all__ = ["TextOverlay"]

_FONTS = {
    "normal": mujoco.mjtFont.mjFONT_NORMAL,
    "shadow": mujoco.mjtFont.mjFONT_SHADOW,
    "big": mujoco.mjtFont.mjFONT_BIG,
}
_POSITIONS = {
    "top left": mujoco.mjtGridPos.mjGRID_TOPLEFT,
    "top right": mujoco.mjtGridPos.mjGRID_TOPRIGHT,
    "bottom left": mujoco.mjtGridPos.mjGRID_BOTTOMLEFT,
    "bottom right": mujoco.mjtGridPos.mjGRID_BOTTOMRIGHT,
}


_T = TypeVar("_T")


class TextOverlay:
    """A title and text drawn in a corner of a picture."""

    __slots__ = ("body", "position", "style", "title")

    def __init__(
        self,
        title: str = "",
        body: str = "",
        style: str = "normal",
        position: str = "top left",
    ) -> None:
        """Creates an overlay.

        Args:
          title: the left column.
          body: the right column.
          style: 'normal', 'shadow' or 'big'.
          position: 'top left', 'top right', 'bottom left' or 'bottom right'.

        Raises:
          ValueError: an unknown style or position.
        """
        self.title = title
        self.body = body
        self.style = _one_of("style", style, _FONTS)
        self.position = _one_of("position", position, _POSITIONS)

    def draw(self, context: mujoco.MjrContext, rect: mujoco.MjrRect) -> None:
        """Draws the text; called on the rendering thread."""
        title, body = to_binary_string(self.title), to_binary_string(self.body)
        mujoco.mjr_overlay(self.style, self.position, rect, title, body, context)


def _one_of(what: str, name: str, values: Mapping[str, _T]) -> _T:
    """The value with the given name; raises ValueError if there is none."""
    if name not in values:
        choices = ", ".join(map(repr, values))
        raise ValueError(
            f"{what} is {name!r}; expected one of: {choices}.{did_you_mean(name, values)}"
        )
    return values[name]
