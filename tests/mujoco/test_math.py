"""Quaternions."""

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import math

_EPSILON = 1e-15  # of a few roundings


def _about(axis: str, degrees: float) -> np.ndarray:
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.eye(3)["xyz".index(axis)], np.deg2rad(degrees))
    return quaternion


def _turned(quaternion: np.ndarray, vector: list[float]) -> np.ndarray:
    result = np.empty(3)
    mujoco.mju_rotVecQuat(result, np.array(vector), quaternion)
    return result


def test_euler_angles_turn_about_x_then_y_then_z_in_degrees() -> None:
    expected = math.mj_quatprod(_about("z", 50), math.mj_quatprod(_about("y", 30), _about("x", 20)))
    np.testing.assert_allclose(math.euler2quat(20, 30, 50), expected, atol=_EPSILON)
    np.testing.assert_allclose(math.euler2quat(90, 0, 0), _about("x", 90), atol=_EPSILON)


def test_a_product_turns_by_its_second_factor_first() -> None:
    product = math.mj_quatprod(_about("z", 90), _about("x", 90))
    np.testing.assert_allclose(_turned(product, [0, 1, 0]), [0, 0, 1], atol=_EPSILON)


def test_the_opposite_of_a_rotation_undoes_it() -> None:
    turn = math.euler2quat(10, -70, 130)
    identity = math.mj_quatprod(turn, math.mj_quatneg(turn))
    np.testing.assert_allclose(identity, [1, 0, 0, 0], atol=_EPSILON)
    assert turn[1] != 0  # the argument is left alone
    np.testing.assert_array_equal(turn, math.euler2quat(10, -70, 130))


def test_a_difference_leads_from_the_source_to_the_target_in_the_sources_frame() -> None:
    source, target = math.euler2quat(10, 20, 30), math.euler2quat(-40, 5, 80)
    difference = math.mj_quatdiff(source, target)
    np.testing.assert_allclose(math.mj_quatprod(source, difference), target, atol=4 * _EPSILON)


@pytest.mark.parametrize("degrees", [30.0, -120.0])
def test_a_rotation_in_some_seconds_is_an_angular_velocity(degrees: float) -> None:
    velocity = math.mj_quat2vel(_about("y", degrees), 0.5)
    np.testing.assert_allclose(velocity, [0, np.deg2rad(degrees) / 0.5, 0], atol=1e-14)


def test_rows_of_a_larger_array_are_taken_as_they_lie() -> None:
    turns = np.array([_about("x", 20), _about("z", 70)]).T  # so that a quaternion is a column
    product = math.mj_quatprod(turns[:, 0], turns[:, 1])
    np.testing.assert_array_equal(product, math.mj_quatprod(_about("x", 20), _about("z", 70)))
