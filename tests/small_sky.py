"""Models of the suite with a sky of few pixels, which compile in a twentieth of the time, and with
a terrain of few points.

    with small_sky(), small_terrain():
        suite.load("humanoid", "walk")

MuJoCo draws the sky of each model when it compiles it: 800 x 800 pixels of each of six sides take
50 ms and 12 MB, and the rest of a humanoid 2 ms. Nothing but pictures depends on it. In a process
of many models the package's cache keeps ten with the whole sky, and all with a small one.

The terrain of the quadruped's escape has 201 x 201 points, which are computed at each start, copied
into each row's model and, in pictures, made into triangles: a picture of two rows takes 0.5 s.
With 41 x 41 points everything is done with a twenty-fourth of the numbers.
"""

import contextlib
import functools
import re
import sys
from collections.abc import Callable, Iterator
from types import ModuleType

__all__ = ["small_sky", "small_terrain"]

_SKY = "./common/skybox.xml"
_WHOLE, _SMALL = b'width="800" height="800"', b'width="8" height="8"'
_TERRAIN, _FEW = re.compile(rb'((?:nrow|ncol)=")201(")'), 41


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


@contextlib.contextmanager
def small_terrain() -> Iterator[None]:
    """Models of the quadruped that are made meanwhile, also by dm_control if it is imported, have a
    height field of few points.
    """
    from limberjack.suite import common  # after the renderer is chosen

    known: list[ModuleType] = [common]
    if theirs := sys.modules.get("dm_control.suite.common"):
        known.append(theirs)
    with contextlib.ExitStack() as stack:
        for module in known:
            before = module.read_model
            patched = functools.partial(_with_few_points, before)
            setattr(module, "read_model", patched)  # noqa: B010 (no attribute of every module)
            stack.callback(setattr, module, "read_model", before)
        yield


def _with_few_points(read: Callable[[str], bytes], model_filename: str) -> bytes:
    text = read(model_filename)
    return _TERRAIN.sub(rb"\g<1>%d\g<2>" % _FEW, text)
