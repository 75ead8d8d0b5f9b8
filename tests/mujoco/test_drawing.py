"""Pictures of a Physics: shapes known before rendering, and rejected arguments."""

import os
from typing import Any

import numpy as np
import pytest

from limberjack.mujoco import Physics
from limberjack.mujoco.drawing import check_names, picture_spec, render

from .furnished import KINDS, SIZE, furnished

_draws = pytest.mark.skipif(
    os.environ.get("MUJOCO_GL") == "disable", reason="MUJOCO_GL turns rendering off"
)


@pytest.fixture
def physics() -> Physics:
    return furnished()


@_draws
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [{}, SIZE], ids=["the size by default", "another size"])
def test_the_spec_is_the_shape_and_the_type_of_the_picture(
    physics: Physics, kind: str, size: dict[str, Any]
) -> None:
    if not size:
        physics.model.vis.global_.offheight = 240
        physics.model.vis.global_.offwidth = 320
    given = {**size, **KINDS[kind]}
    picture = render(physics, **given)
    assert picture_spec(physics, given) == (picture.shape, picture.dtype)
    np.testing.assert_array_equal(picture, physics.render(**given))


def test_a_spec_is_known_without_drawing(physics: Physics, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("limberjack.mujoco.camera.Camera.render", None)  # so that it would fail
    assert picture_spec(physics, SIZE) == ((96, 128, 3), np.dtype(np.uint8))
    assert picture_spec(physics, {**SIZE, "depth": True}) == ((96, 128), np.dtype(np.float32))
    segmented = picture_spec(physics, {**SIZE, "segmentation": True})
    assert segmented == ((96, 128, 2), np.dtype(np.int32))


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"camera_id": "wal"}, ValueError, "wal"),
        ({"camera_id": 3}, ValueError, "camera"),
        ({"height": 201}, ValueError, "201"),
        ({"width": 0}, ValueError, "width"),
        ({"quality": "fsat"}, ValueError, "Did you mean 'fast'"),
        ({"depth": True, "segmentation": True}, ValueError, "cannot both be true"),
        ({"hieght": 20}, TypeError, r"unexpected keyword argument 'hieght'.*'height'"),
    ],
)
def test_a_spec_is_refused_where_a_picture_would_be(
    physics: Physics, given: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        picture_spec(physics, {**SIZE, **given})


def test_keywords_are_those_of_render_and_a_wrong_one_is_answered_with_all_of_them() -> None:
    check_names({})
    check_names(dict.fromkeys(("height", "camera_id", "scene_callback", "quality")))
    with pytest.raises(TypeError, match=r"'physics'.* It takes: height, width, camera_id, over"):
        check_names({"height": 1, "physics": None})


def test_rendering_a_batch_suggests_the_call_for_its_rows(physics: Physics) -> None:
    rows = physics.replicate(2, 1).physics
    with pytest.raises(
        TypeError, match=r"not support render\(\): call render\(rows, \.\.\.\) of its Batch"
    ):
        render(rows)
