"""Appearance: other colours, cameras and backgrounds for pictures; the simulation stays the same.

    env = suite.load("walker", "walk", appearance={"background": "noise", "colors": "hard"})
    env = suite.load("walker", "walk", appearance="rotate_hard")      # a preset
    env.physics.render(84, 84, camera_id="side")

See `options` for what there is, and `looks` for how it is drawn.
"""

from limberjack.worlds.appearance.looks import Look, Looks
from limberjack.worlds.appearance.options import (
    INTENSITIES,
    PRESETS,
    Appearance,
    AppearanceOptions,
)

__all__ = ["INTENSITIES", "PRESETS", "Appearance", "AppearanceOptions", "Look", "Looks"]
