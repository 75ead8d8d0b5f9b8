"""Pictures: compatible options, and conversion of raw pixels to arrays."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco.pictures import Style, finished

_COLOURS = Style.of()
_LEFT_OUT = ("shadow", "reflection", "skybox")


def test_the_quality_sets_flags_and_overrides_come_before_it() -> None:
    assert Style.of().flags == {}
    assert Style.of(quality="fast").flags == dict.fromkeys(
        ("shadow", "reflection", "skybox"), False
    )
    mixed = Style.of(quality="fast", render_flag_overrides={"shadow": True, "fog": False})
    assert mixed.flags == {"shadow": True, "reflection": False, "skybox": False, "fog": False}


def test_object_numbers_are_drawn_with_flags_of_their_own_at_any_quality() -> None:
    full, fast = (Style.of(segmentation=True, quality=quality) for quality in ("full", "fast"))
    assert full.flags == fast.flags
    assert full.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR.value] is True


@pytest.mark.parametrize(
    "options",
    [
        {"depth": True, "segmentation": True},
        {"depth": True, "overlays": [object()]},
        {"segmentation": True, "render_flag_overrides": {"fog": True}},
        {"quality": "fsat"},
    ],
)
def test_incompatible_options_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"cannot|need an RGB picture|Did you mean 'fast'"):
        Style.of(**options)


def test_colours_are_turned_the_right_way_up_into_an_array_of_its_own() -> None:
    raw = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    picture = finished(raw, _COLOURS, None, SimpleNamespace())  # type: ignore[arg-type]
    np.testing.assert_array_equal(picture, [raw[1], raw[0]])
    raw[:] = 0
    assert picture.any()


def test_the_depth_buffer_spans_the_near_and_the_far_plane() -> None:
    model = SimpleNamespace(
        vis=SimpleNamespace(map=SimpleNamespace(znear=0.01, zfar=0.5)),
        stat=SimpleNamespace(extent=2.0),
    )
    raw = np.array([[0.0], [1.0]], np.float32)
    scene: Any = None
    metres = finished(raw, Style.of(depth=True), model, scene)
    np.testing.assert_allclose(metres, [[1.0], [0.02]], rtol=1e-5)  # float32, times far by near


def test_each_pixel_has_its_objects_number_and_type_and_minus_one_for_the_background() -> None:
    geoms = [SimpleNamespace(segid=i, objid=10 + i, objtype=5) for i in range(300)]
    scene: Any = SimpleNamespace(ngeom=300, geoms=geoms)
    colours = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (44, 1, 0), (45, 1, 0)]  # 0, 1, 256, 300, 301
    raw = np.array([[colour] for colour in reversed(colours)], np.uint8)
    numbers = finished(raw, Style.of(segmentation=True), None, scene)
    assert numbers.dtype == np.int32
    assert numbers[:, 0].tolist() == [[-1, -1], [10, 5], [265, 5], [309, 5], [-1, -1]]
