"""Models of the suite with a sky of few pixels, which compile in a twentieth of the time.

    with small_sky():
        suite.load("humanoid", "walk")

MuJoCo draws the sky of each model when it compiles it: 800 x 800 pixels of each of six sides take
50 ms and 12 MB, and the rest of a humanoid 2 ms. Nothing but pictures depends on it. In a process
of many models the package's cache keeps ten with the whole sky, and all with a small one.
"""

import contextlib
import sys
from collections.abc import Iterator

__all__ = ["small_sky"]

_SKY = "./common/skybox.xml"
_WHOLE, _SMALL = b'width="800" height="800"', b'width="8" height="8"'


@contextlib.contextmanager
def small_sky() -> Iterator[None]:
    """Models that are made meanwhile, also by dm_control if it is imported, have a small sky."""
    from limberjack.suite import common  # after the renderer is chosen

    known = [common.ASSETS]
    if theirs := sys.modules.get("dm_control.suite.common"):
        known.append(theirs.ASSETS)
    before = [assets[_SKY] for assets in known]
    for assets in known:
        assert assets[_SKY].count(_WHOLE) == 1
        assets[_SKY] = assets[_SKY].replace(_WHOLE, _SMALL)
    try:
        yield
    finally:
        for assets, sky in zip(known, before, strict=True):
            assets[_SKY] = sky
