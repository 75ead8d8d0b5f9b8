"""Pictures that are drawn in a tenth of the time, for tests that only compare them."""

from typing import Any

import pytest

from limberjack.mujoco import pictures

__all__ = ["draw_plainly", "draw_without_shadows"]

# Parts of a sphere or cylinder, around it and along it; MuJoCo draws 28 and 16.
_SLICES, _STACKS = 8, 4


def draw_plainly(model: Any) -> None:
    """Turns off shadows and smooth edges, and draws round things with corners.

    `model` is that of a physics of either package.
    """
    model.light_castshadow[:] = False
    quality = model.vis.quality
    quality.offsamples, quality.numslices, quality.numstacks = 0, _SLICES, _STACKS


def draw_without_shadows(patch: pytest.MonkeyPatch) -> None:
    """Turns off the shadows and reflections of all pictures that this process draws.

    With a software renderer they take two thirds of the time.
    """
    patch.setitem(pictures._QUALITIES, "full", {"shadow": False, "reflection": False})
