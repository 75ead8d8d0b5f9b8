"""Tests of limberjack.mujoco.viewpoints."""

from typing import Any

import mujoco
import pytest

from limberjack.mujoco import Physics
from limberjack.mujoco.viewpoints import FREE_CAMERA, checked_size, view_of

_MODEL = """
<mujoco>
  <visual><global offwidth="64" offheight="48"/></visual>
  <worldbody>
    <geom size=".1"/>
    <camera name="side"/>
    <camera name="above" pos="0 0 1"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def physics() -> Physics:
    return Physics.from_xml_string(_MODEL)


@pytest.mark.parametrize(("camera_id", "number"), [("side", 0), ("above", 1), (0, 0), (1, 1)])
def test_a_camera_of_the_model_is_given_by_name_or_number(
    physics: Physics, camera_id: int | str, number: int
) -> None:
    view = view_of(physics, camera_id)
    assert view.fixedcamid == number
    assert view.type == mujoco.mjtCamera.mjCAMERA_FIXED


def test_the_free_camera_is_where_mujoco_puts_it(physics: Physics) -> None:
    view, expected = view_of(physics, FREE_CAMERA), mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(physics.model.ptr, expected)
    assert view.type == mujoco.mjtCamera.mjCAMERA_FREE
    assert view.distance == expected.distance
    assert view.lookat.tolist() == expected.lookat.tolist()


@pytest.mark.parametrize("camera_id", [2, -2])
def test_a_camera_that_does_not_exist_is_refused(physics: Physics, camera_id: int) -> None:
    with pytest.raises(ValueError, match=f"camera_id is {camera_id}; .* the model has 2 cameras"):
        view_of(physics, camera_id)


def test_a_size_that_fits_the_buffer_is_returned_as_ints(physics: Physics) -> None:
    assert checked_size(physics, 48, 64) == (48, 64)
    assert checked_size(physics, True, 1) == (1, 1)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((0, 1), "image height is 0; expected a whole number of pixels, from 1 to 48"),
        ((1, -3), "image width is -3; expected"),
        ((1.5, 1), "image height is 1.5; expected"),
        ((49, 1), "image height 49 > 48"),
        ((1, 65), 'image width 65 > 64.*offwidth="65"'),
    ],
)
def test_a_size_that_the_model_cannot_have_is_refused(
    physics: Physics, size: tuple[Any, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        checked_size(physics, *size)


@pytest.mark.parametrize("camera_id", [None, 0.5, ["side"]])
def test_a_camera_that_is_neither_a_name_nor_a_number_is_refused(
    physics: Physics, camera_id: Any
) -> None:
    with pytest.raises(TypeError, match=r"camera_id is .*; expected the name or the number"):
        view_of(physics, camera_id)
