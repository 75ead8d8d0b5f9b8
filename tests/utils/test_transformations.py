"""Tests of limberjack.utils.transformations; tests/oracle compares it with dm_control."""

import itertools
import logging
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.utils import transformations as tr

_THREE_AXES = ["XYZ", "ZYX", "XZY", "YZX", "ZXY", "YXZ"]
_ORDERINGS = [*_THREE_AXES, "XYX"]
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
_A_LIST: Any = [1.0, 0.0, 0.0, 0.0]


def _quats(count: int, seed: int = 0) -> np.ndarray:
    quats = np.random.RandomState(seed).normal(size=(count, 4))
    return quats / np.linalg.norm(quats, axis=-1, keepdims=True)


def _by_mujoco(function: Callable[..., None], size: int, *args: Any) -> np.ndarray:
    result = np.empty(size)
    function(result, *args)
    return result


def _assert_same_rotation(quat: np.ndarray, other: np.ndarray) -> None:
    np.testing.assert_allclose(quat * np.sign(quat @ other), other, atol=1e-12)


@pytest.mark.parametrize("ordering", ["".join(o) for o in itertools.product("XYZ", repeat=3)])
def test_euler_angles_give_the_product_of_rotations_about_axes(ordering: str) -> None:
    about = {"X": tr.rotation_x_axis, "Y": tr.rotation_y_axis, "Z": tr.rotation_z_axis}
    angles = np.random.RandomState(0).uniform(-4, 4, 3)
    first, second, third = (
        about[axis](angle) for axis, angle in zip(ordering, angles, strict=True)
    )
    rmat = tr.euler_to_rmat(angles, ordering)
    np.testing.assert_allclose(rmat, first @ second @ third, atol=1e-15)
    np.testing.assert_allclose(rmat @ rmat.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rmat) == pytest.approx(1)
    batch = tr.euler_to_rmat(np.stack([angles, -angles]), ordering, full=True)
    assert batch.shape == (2, 4, 4)
    np.testing.assert_allclose(batch[0, :3, :3], rmat, atol=1e-15)
    np.testing.assert_array_equal(batch[:, 3], [[0, 0, 0, 1]] * 2)


@pytest.mark.parametrize("ordering", _ORDERINGS)
def test_euler_angles_are_found_again(ordering: str) -> None:
    random = np.random.RandomState(1)
    for _ in range(50):
        middle = random.uniform(0.1, 3) if ordering == "XYX" else random.uniform(-1.5, 1.5)
        angles = np.array([random.uniform(-3, 3), middle, random.uniform(-3, 3)])
        rmat = tr.euler_to_rmat(angles, ordering)
        np.testing.assert_allclose(tr.rmat_to_euler(rmat, ordering), angles, atol=1e-9)
        quat = tr.euler_to_quat(angles, ordering)
        np.testing.assert_allclose(tr.quat_to_euler(quat, ordering), angles, atol=1e-9)


@pytest.mark.parametrize("ordering", _THREE_AXES)
def test_the_first_angle_is_zero_where_the_others_are_ambiguous(
    ordering: str, caplog: pytest.LogCaptureFixture
) -> None:
    for middle in (np.pi / 2, -np.pi / 2):
        caplog.clear()
        with caplog.at_level(logging.WARNING, logger="limberjack"):
            rmat = tr.euler_to_rmat([0.3, middle, 0.4], ordering)
            first, second, last = tr.rmat_to_euler(rmat, ordering)
        assert first == 0
        assert second == middle
        assert "ambiguous" in caplog.text
        again = tr.euler_to_rmat([first, second, last], ordering)
        # As in dm_control: of three orderings, at one of the poles, the last angle is off by pi.
        is_off = ordering in ("ZYX", "XZY", "YZX") and (middle > 0) == (ordering == "YZX")
        assert np.allclose(again, rmat, atol=1e-12) != is_off


def test_turns_about_x_alone_have_the_sign_that_dm_control_gives_them() -> None:
    # dm_control's sign of the first angle is wrong at 0, and right at pi.
    np.testing.assert_allclose(tr.rmat_to_euler(tr.rotation_x_axis(0.3), "XYX"), [-0.3, 0, 0])
    half_turn = tr.euler_to_rmat([0.3, np.pi, 0.0], "XYX")
    assert half_turn[0, 0] == -1
    np.testing.assert_allclose(tr.rmat_to_euler(half_turn, "XYX"), [0.3, np.pi, 0])


def test_quaternions_are_converted_and_multiplied_as_by_mujoco() -> None:
    for quat, other in zip(_quats(100), _quats(100, seed=1), strict=True):
        rmat = tr.quat_to_mat(quat)
        expected = _by_mujoco(mujoco.mju_quat2Mat, 9, quat).reshape(3, 3)
        np.testing.assert_allclose(rmat[:3, :3], expected, atol=1e-14)
        np.testing.assert_array_equal(rmat[3], [0, 0, 0, 1])
        np.testing.assert_array_equal(rmat[:3, 3], 0)
        _assert_same_rotation(tr.mat_to_quat(rmat), quat)
        _assert_same_rotation(tr.mat_to_quat(rmat[:3, :3]), quat)
        product = _by_mujoco(mujoco.mju_mulQuat, 4, quat, other)
        np.testing.assert_allclose(tr.quat_mul(quat, other), product, atol=1e-15)
        vector = other[:3]
        rotated = _by_mujoco(mujoco.mju_rotVecQuat, 3, vector, quat)
        np.testing.assert_allclose(tr.quat_rotate(quat, vector), rotated, atol=1e-14)


def test_conjugates_and_inverses_undo_a_rotation() -> None:
    quats = _quats(10) * 3
    np.testing.assert_allclose(tr.quat_mul(quats, tr.quat_inv(quats)), [_IDENTITY] * 10, atol=1e-15)
    np.testing.assert_array_equal(tr.quat_conj(quats), quats * [1, -1, -1, -1])
    difference = tr.quat_diff(quats[0] / 3, quats[1] / 3)
    np.testing.assert_allclose(tr.quat_mul(quats[0], difference), quats[1], atol=1e-14)


def test_axis_angles_are_found_again() -> None:
    random = np.random.RandomState(2)
    for angle in (1e-5, 0.1, 1, 3, 3.1):
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        quat = tr.axisangle_to_quat(angle * axis)
        expected = _by_mujoco(mujoco.mju_axisAngle2Quat, 4, axis, angle)
        np.testing.assert_allclose(quat, expected, atol=1e-15)
        np.testing.assert_allclose(tr.quat_to_axisangle(quat), angle * axis, atol=1e-10)
    np.testing.assert_allclose(
        tr.quat_to_axisangle(tr.axisangle_to_quat([4, 0, 0])), [4 - 2 * np.pi, 0, 0]
    )


def test_no_rotation_gives_the_identity_without_a_warning() -> None:
    np.testing.assert_array_equal(tr.axisangle_to_quat(np.zeros((2, 3))), [_IDENTITY] * 2)
    np.testing.assert_array_equal(tr.axisangle_to_quat([1e-7, 0, 0], tol=1e-6), _IDENTITY)
    np.testing.assert_array_equal(tr.quat_to_axisangle(_IDENTITY), np.zeros(3))
    np.testing.assert_array_equal(tr.quat_to_mat(np.zeros(4)), np.eye(4))
    np.testing.assert_array_equal(tr.mat_to_quat(np.eye(3)), _IDENTITY)
    np.testing.assert_allclose(tr.quat_log(_IDENTITY), np.zeros(4), atol=1e-9)


def test_half_turns_have_a_quaternion_without_a_real_part() -> None:
    for axis in range(3):
        rmat = -np.eye(3)
        rmat[axis, axis] = 1
        np.testing.assert_array_equal(tr.mat_to_quat(rmat), np.eye(4)[axis + 1])


def test_distances_are_half_the_angle() -> None:
    quats = _quats(5)
    for angle in (0.1, 1, 3):
        turned = tr.quat_mul(quats, tr.axisangle_to_quat([0, angle, 0]))
        distances = tr.quat_dist(quats, turned)
        assert distances.shape == (5, 1)
        np.testing.assert_allclose(distances, angle / 2, atol=1e-5)


def test_single_precision_is_kept_or_widened_as_in_dm_control() -> None:
    quat = _quats(1)[0].astype(np.float32)
    widened = [tr.quat_conj(quat), tr.quat_mul(quat, quat), tr.axisangle_to_quat(quat[1:])]
    assert [array.dtype for array in widened] == [np.float64] * 3
    assert tr.quat_log(quat).dtype == tr.quat_to_axisangle(quat).dtype == np.float32
    assert tr.rmat_to_euler(np.eye(3, dtype=np.float32), "XYZ").dtype == np.float32


def test_a_rotation_of_the_plane_takes_one_angle_or_many() -> None:
    np.testing.assert_allclose(tr.rotation_matrix_2d(np.pi / 2), [[0, -1], [1, 0]], atol=1e-15)
    assert tr.rotation_matrix_2d(np.zeros(5)).shape == (2, 2, 5)


def test_arguments_are_not_written_and_results_are_fresh() -> None:
    quat, other, rmat = _quats(1)[0], _quats(1, seed=1)[0], np.eye(4)
    for array in (quat, other, rmat):
        array.flags.writeable = False
    for result in (
        tr.quat_conj(quat), tr.quat_inv(quat), tr.quat_mul(quat, other), tr.quat_log(quat),
        tr.quat_dist(quat, other), tr.quat_to_mat(quat), tr.mat_to_quat(rmat),
        tr.quat_to_axisangle(quat), tr.axisangle_to_quat(quat[1:]), tr.quat_rotate(quat, other[1:]),
    ):  # fmt: skip
        assert not any(np.shares_memory(result, array) for array in (quat, other, rmat))
        assert result.flags.writeable


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda: tr.rmat_to_euler(np.eye(3)), KeyError, "'ZXZ'; expected one of XYZ, XYX"),
        (lambda: tr.rmat_to_euler(np.eye(3), "zyx"), KeyError, "Did you mean 'ZYX'"),
        (lambda: tr.rmat_to_euler(_A_LIST, "XYZ"), TypeError, r"rmat is a list.*np\.asarray"),
        (lambda: tr.rmat_to_euler(np.eye(2), "XYZ"), IndexError, r"shape \(2, 2\); expected \(3"),
        (lambda: tr.rmat_to_euler(np.ones((2, 3, 3)), "XYZ"), ValueError, "expected one matrix"),
        (lambda: tr.euler_to_rmat(np.ones(3), "XYW"), KeyError, "'XYW'; expected letters X, Y"),
        (lambda: tr.euler_to_rmat(np.ones(3), "XY"), IndexError, "'XY'.*three letters"),
        (lambda: tr.euler_to_rmat(np.ones(2), "XYZ"), IndexError, r"shape \(2,\); expected three"),
        (lambda: tr.rotation_x_axis(np.ones((2, 2))), ValueError, r"\(2, 2\); expected one angle"),
        (lambda: tr.mat_to_quat(_A_LIST), AttributeError, "mat is a list; expected an array"),
        (lambda: tr.mat_to_quat(np.eye(2)), IndexError, r"shape \(2, 2\); expected \(3, 3\) or"),
        (lambda: tr.mat_to_quat(np.ones((5, 4, 4))), ValueError, "expected one matrix"),
        (lambda: tr.quat_conj(np.ones(3)), IndexError, r"quat has shape \(3,\); expected"),
        (lambda: tr.quat_conj(1.0), IndexError, "quat is .*; expected an array"),
        (lambda: tr.quat_mul(_A_LIST, _IDENTITY), TypeError, "quat1 is a list"),
        (lambda: tr.quat_mul(_IDENTITY, _A_LIST), TypeError, "quat2 is a list"),
        (lambda: tr.quat_mul(_IDENTITY, np.ones(3)), ValueError, r"quat2 has shape \(3,\)"),
        (lambda: tr.quat_to_mat(np.ones((2, 4))), ValueError, "expected one quaternion"),
        (lambda: tr.quat_to_mat(np.ones(3)), IndexError, "expected one quaternion"),
        (lambda: tr.quat_to_axisangle(_A_LIST), AttributeError, "quat is a float"),
        (lambda: tr.quat_to_axisangle(np.full((3, 4), 0.5)), ValueError, r"\(3, 4\); expected one"),
        (lambda: tr.quat_to_axisangle(2 * _IDENTITY), ValueError, "is 2 in magnitude.*its norm"),
        (lambda: tr.quat_log(2 * _IDENTITY), ValueError, "in magnitude; expected at most 1"),
        (lambda: tr.quat_log(2 * _IDENTITY), TypeError, "in magnitude; expected at most 1"),
        (lambda: tr.axisangle_to_quat(np.ones(2)), ValueError, r"\(2,\); expected \(\.\.\., 3\)"),
    ],
)
def test_a_refusal_names_the_argument_and_what_was_expected(
    call: Callable[[], object], kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind, match=message):
        call()
