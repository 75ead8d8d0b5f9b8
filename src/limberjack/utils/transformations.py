"""Rotations as quaternions, matrices, Euler angles and axis-angle vectors, as dm_control's module.

    quat = euler_to_quat(np.array([0.1, 0.2, 0.3]))     # radians about x, y and z
    quat_rotate(quat, np.array([1.0, 0.0, 0.0]))        # the x axis, rotated
    quat_dist(quat, np.array([1.0, 0.0, 0.0, 0.0]))     # the angle in between, halved

A quaternion is (..., 4) with the real part first, a rotation matrix (3, 3) or, as the upper left
part of a homogeneous transform, (4, 4). Angles are in radians. Names, arguments, results and kinds
of errors are dm_control's, the odd ones included: each is marked by a comment. Functions whose
shapes begin with `...` take any number of leading axes; the others take one rotation.

For speed in simulations prefer MuJoCo's own `mujoco.mju_...` functions.
"""

import functools

import numpy as np
from numpy.typing import ArrayLike

from limberjack.utils.log import log
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "axisangle_to_quat",
    "euler_to_quat",
    "euler_to_rmat",
    "mat_to_quat",
    "quat_conj",
    "quat_diff",
    "quat_dist",
    "quat_inv",
    "quat_log",
    "quat_mul",
    "quat_rotate",
    "quat_to_axisangle",
    "quat_to_euler",
    "quat_to_mat",
    "rmat_to_euler",
    "rotation_matrix_2d",
    "rotation_x_axis",
    "rotation_y_axis",
    "rotation_z_axis",
]

# The numbers of dm_control: results depend on them.
_TOLERANCE = 1e-10  # rounding that is forgiven, and the smallest rotation and squared norm
_POLE = 1.0 - 1e-6  # sine of the middle Euler angle from which the other two are not separated

# Component and sign of each element of the matrix L with p q = L q, for the quaternion product.
_LEFT_COMPONENT = np.bitwise_xor.outer(np.arange(4), np.arange(4))
_LEFT_SIGN = np.array([[1, -1, -1, -1], [1, 1, -1, 1], [1, 1, 1, -1], [1, -1, 1, 1]])


class _OutOfRangeError(ValueError, TypeError):
    """Components that no unit quaternion has: a ValueError, and where dm_control raises one, a
    TypeError, since it fails to format an array as a number."""


def euler_to_quat(euler_vec: ArrayLike, ordering: str = "XYZ") -> np.ndarray:
    """The quaternion, (4,), of three Euler angles, (3,); arguments and errors of `euler_to_rmat`.

    Its sign is that of `mat_to_quat`.
    """
    return mat_to_quat(euler_to_rmat(euler_vec, ordering=ordering))


def euler_to_rmat(euler_vec: ArrayLike, ordering: str = "ZXZ", full: bool = False) -> np.ndarray:
    """The product of three rotations about axes, in the order of `ordering`.

    Args:
      euler_vec: angles, (3,), or (N, 3) for N products.
      ordering: three of the letters X, Y and Z, such as 'XYZ' for R_x(a) R_y(b) R_z(c).
      full: whether to return homogeneous transforms.

    Returns:
      (3, 3), or (4, 4) if `full`, with a leading N for several.

    Raises:
      KeyError: another letter.
      IndexError: fewer than three letters, or fewer angles than letters.
      ValueError: more axes than two.
    """
    axes = [_axis_number(letter, ordering) for letter in ordering]
    angles = np.atleast_2d(euler_vec)
    columns = range(angles.shape[1])
    turns = [_about_axis(i, angles[:, j], full) for i, j in zip(axes, columns, strict=False)]
    if len(turns) < max(len(axes), 3):
        raise IndexError(
            f"ordering is {ordering!r} and euler_vec has shape {np.shape(euler_vec)}; expected "
            "three letters, and one angle for each along the last axis"
        )
    first, second, third, *_ = turns
    if first.ndim == 2:
        return first.dot(second).dot(third)
    # Not `matmul`, which may round differently from dm_control's einsum.
    product = np.einsum("nij,njk->nik", first, second)
    return np.einsum("nij,njk->nik", product, third).squeeze()


def _axis_number(letter: str, ordering: str) -> int:
    if letter not in ("X", "Y", "Z"):
        raise KeyError(f"ordering is {ordering!r}; expected letters X, Y and Z, such as 'XYZ'")
    return "XYZ".index(letter)


def rotation_x_axis(theta: ArrayLike, full: bool = False) -> np.ndarray:
    """The rotation about the x axis.

    Args:
      theta: an angle, or N angles, (N,).
      full: whether to return homogeneous transforms.

    Returns:
      (3, 3), or (4, 4) if `full`, with a leading N unless N is 1.

    Raises:
      TypeError: an array without axes.
      ValueError: an array of several axes.
    """
    return _about_axis(0, theta, full)


def rotation_y_axis(theta: ArrayLike, full: bool = False) -> np.ndarray:
    """The rotation about the y axis; arguments, shapes and errors of `rotation_x_axis`."""
    return _about_axis(1, theta, full)


def rotation_z_axis(theta: ArrayLike, full: bool = False) -> np.ndarray:
    """The rotation about the z axis; arguments, shapes and errors of `rotation_x_axis`."""
    return _about_axis(2, theta, full)


def _about_axis(axis: int, theta: ArrayLike, full: bool) -> np.ndarray:
    count = 1 if np.isscalar(theta) else len(np.asarray(theta))
    if np.ndim(theta) > 1 and np.shape(theta) != (1, 1):
        raise ValueError(f"angles have shape {np.shape(theta)}; expected one angle or (N,)")
    cosine, sine = np.cos(theta), np.sin(theta)
    size = 4 if full else 3
    turned = np.zeros((count, size, size))
    turned[:, range(size), range(size)] = 1.0
    j, k = (axis + 1) % 3, (axis + 2) % 3
    turned[:, j, j] = turned[:, k, k] = cosine
    turned[:, j, k] = -sine
    turned[:, k, j] = sine
    return turned.squeeze()


def rotation_matrix_2d(theta: ArrayLike) -> np.ndarray:
    """The rotation of the plane by an angle, (2, 2); (2, 2, ...) for angles of shape (...)."""
    cosine, sine = np.cos(theta), np.sin(theta)
    return np.array([[cosine, -sine], [sine, cosine]])


def rmat_to_euler(rmat: np.ndarray, ordering: str = "ZXZ") -> np.ndarray:
    """The Euler angles of a rotation, (3,), in the order of `ordering`.

    Where the middle angle makes the others ambiguous, dm_control's choice is returned, which does
    not always give `rmat` back: see the comments in the code.

    Args:
      rmat: (3, 3), or a homogeneous transform.
      ordering: 'XYZ', 'XZY', 'YXZ', 'YZX', 'ZXY', 'ZYX' or 'XYX'. The default is dm_control's, and
        not among them.

    Raises:
      KeyError: another ordering.
      TypeError: `rmat` is not an array.
      IndexError: an array smaller than (3, 3).
      ValueError: an array of several matrices.
    """
    if ordering not in _eulermap:
        raise KeyError(
            f"ordering is {ordering!r}; expected one of {', '.join(_eulermap)}."
            f"{did_you_mean(ordering, _eulermap)}"
        )
    _check_matrix(rmat)
    return _eulermap[ordering](rmat)


def _check_matrix(rmat: np.ndarray) -> None:
    _require_array("rmat", rmat, TypeError)
    shape = rmat.shape
    if len(shape) > 2 and np.prod(shape[2:]) != 1:
        # Both a ValueError and an IndexError, of which dm_control raises one or the other.
        raise np.exceptions.AxisError(f"rmat has shape {shape}; expected one matrix, (3, 3)")
    if len(shape) < 2 or min(shape[:2]) < 3:
        raise IndexError(f"rmat has shape {shape}; expected (3, 3) or (4, 4)")


def _three_axes_to_euler(rmat: np.ndarray, ordering: str) -> np.ndarray:
    """Angles a, b, c of R_i(a) R_j(b) R_k(c), for three different axes i, j and k.

    At b = 90 and -90 degrees, where only the sum or difference of a and c is determined, a is 0.
    """
    i, j, k = map("XYZ".index, ordering)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0  # that of the permutation
    sine = rmat[i, k]  # times sign
    if sine > _POLE or sine < -_POLE:
        log.warning("Euler angles are ambiguous: the first one is taken as 0")
        middle = sign * np.pi / 2 if sine > 0 else -sign * np.pi / 2
        if ordering in ("ZYX", "XZY", "YZX"):
            # As dm_control; where `sine` is positive, c is off by pi.
            last = -sign * np.arctan2(rmat[k, j], rmat[k, i])
        else:
            last = sign * np.arctan2(rmat[j, i], rmat[j, j])
        return np.array([0.0, middle, last])
    first = -sign * np.arctan2(rmat[j, k], rmat[k, k])
    last = -sign * np.arctan2(rmat[i, j], rmat[i, i])
    return np.array([first, sign * np.arcsin(sine), last])


def _xyx_to_euler(rmat: np.ndarray) -> np.ndarray:
    """Angles a, b, c of R_x(a) R_y(b) R_x(c), with b from 0 to pi; c is 0 where b is either."""
    cosine = rmat[0, 0]
    if -1.0 < cosine < 1.0:
        first = np.arctan2(rmat[1, 0], -rmat[2, 0])
        return np.array([first, np.arccos(cosine), np.arctan2(rmat[0, 1], rmat[0, 2])])
    # As dm_control; where b is 0, the sign of a is wrong.
    first = -np.arctan2(-rmat[1, 2], rmat[1, 1])
    return np.array([first, np.pi if cosine <= -1.0 else 0.0, 0.0])


# dm_control's name, and its order of keys.
_eulermap = {
    ordering: functools.partial(_three_axes_to_euler, ordering=ordering)
    if len(set(ordering)) == 3
    else _xyx_to_euler
    for ordering in ("XYZ", "XYX", "ZYX", "XZY", "YZX", "ZXY", "YXZ")
}


def quat_conj(quat: ArrayLike) -> np.ndarray:
    """The conjugate, (..., 4) -> (..., 4): the inverse rotation, if the norm is 1.

    Raises:
      IndexError: fewer than four components.
    """
    quat = _quaternion(quat, "quat")
    parts = [quat[..., :1], -quat[..., 1:4]]
    return np.concatenate(parts, axis=-1).astype(np.float64)


def quat_inv(quat: ArrayLike) -> np.ndarray:
    """The inverse of a quaternion of any norm but 0, (..., 4) -> (..., 4).

    Raises:
      IndexError: fewer than four components.
    """
    quat = _quaternion(quat, "quat")
    return quat_conj(quat) / np.sum(quat * quat, axis=-1, keepdims=True)


def quat_mul(quat1: np.ndarray, quat2: np.ndarray) -> np.ndarray:
    """The product of quaternions, (..., 4): the rotation `quat2`, followed by `quat1`.

    The leading axes are broadcast.

    Raises:
      TypeError: an argument is not an array.
      IndexError: `quat1` has fewer than four components.
      ValueError: `quat2` has not four, or the leading axes do not fit together.
    """
    _require_array("quat1", quat1, TypeError)
    left = _quaternion(quat1, "quat1")[..., _LEFT_COMPONENT] * _LEFT_SIGN
    _require_array("quat2", quat2, TypeError)
    if quat2.ndim and quat2.shape[-1] != 4:
        raise ValueError(f"quat2 has shape {quat2.shape}; expected (..., 4)")
    return (left @ quat2[..., None])[..., 0]


def quat_diff(source: ArrayLike, target: np.ndarray) -> np.ndarray:
    """The rotation from `source` to `target` in the frame of `source`, (..., 4).

    The errors are those of `quat_mul`.
    """
    return quat_mul(quat_conj(source), target)


def quat_log(quat: ArrayLike, tol: float = _TOLERANCE) -> np.ndarray:
    """The logarithm of a unit quaternion, (..., 4) -> (..., 4).

    The first component is that of the norm; the others are the axis times half the angle.

    Args:
      quat: the quaternion.
      tol: added to norms, which may be 0, and subtracted from the real part.

    Raises:
      IndexError: fewer than four components.
      ValueError: the real part is beyond -1 or 1 by more than rounding; also a TypeError.
    """
    norm = np.linalg.norm(np.asarray(quat) + tol, axis=-1, keepdims=True)
    quat = _quaternion(quat, "quat")
    vector = quat[..., 1:4]
    length = np.linalg.norm(vector + tol, axis=-1, keepdims=True)
    half_angle = np.arccos(_clipped_cosine(quat[..., :1] - tol, 2.0 * tol))
    return np.concatenate([np.log(norm), vector / length * half_angle / norm], axis=-1)


def quat_dist(source: np.ndarray, target: ArrayLike) -> np.ndarray:
    """Half the angle, 0 to pi, between rotations given as unit quaternions, (..., 4) -> (..., 1).

    A quaternion and its negative are the same rotation, yet `q` and nearly `-q` are nearly pi
    apart. The tolerance of `quat_log` blurs distances within 1.4e-5 of 0 and of pi.

    The errors are those of `quat_mul` and `quat_log`.
    """
    product = quat_mul(source, quat_inv(target))
    product /= np.linalg.norm(product, axis=-1, keepdims=True)
    return np.linalg.norm(quat_log(product), axis=-1, keepdims=True)


def quat_rotate(quat: np.ndarray, vec: ArrayLike) -> np.ndarray:
    """A vector, (3,), rotated by one quaternion, (4,); the errors are those of `quat_mul`.

    A quaternion that is not of unit norm scales the vector by its square. As in dm_control, the
    result is meaningless for several quaternions: rotate by one after the other.
    """
    pure = np.hstack([np.zeros(1, int), np.asarray(vec)])
    return quat_mul(quat_mul(quat, pure), quat_conj(quat))[1:]


def quat_to_axisangle(quat: np.ndarray) -> np.ndarray:
    """The axis of a rotation, (3,), times its angle from -pi to pi, of a unit quaternion, (4,).

    Raises:
      AttributeError: `quat` is not an array.
      ValueError: the real part is beyond -1 or 1 by more than rounding, or there are several.
    """
    _require_array("quat", quat[0], AttributeError)
    angle = 2 * np.arccos(_clipped_cosine(quat[0], _TOLERANCE))
    if np.size(angle) != 1:
        raise ValueError(f"quat has shape {np.shape(quat)}; expected one quaternion, (4,)")
    if angle < _TOLERANCE:
        return np.zeros(3)
    axis = quat[1:4] / np.sin(angle / 2)
    return axis * ((angle + np.pi) % (2 * np.pi) - np.pi)


def quat_to_euler(quat: ArrayLike, ordering: str = "XYZ") -> np.ndarray:
    """The Euler angles, (3,), of a quaternion, (4,).

    Orderings and ambiguous rotations are those of `rmat_to_euler`.

    Raises:
      KeyError: an unknown ordering.
      IndexError: fewer than four components.
      ValueError: several quaternions.
    """
    return rmat_to_euler(quat_to_mat(quat)[:3, :3], ordering=ordering)


def quat_to_mat(quat: ArrayLike) -> np.ndarray:
    """The homogeneous transform, (4, 4), of a quaternion, (4,), of any norm; of 0 the identity.

    Raises:
      IndexError: fewer than four components.
      ValueError: several quaternions.
    """
    array = np.array(quat, dtype=np.float64)
    if array.ndim > 1:
        raise ValueError(f"quat has shape {array.shape}; expected one quaternion, (4,)")
    squared_norm = np.dot(array, array)
    transform = np.identity(4)
    if squared_norm < _TOLERANCE:
        return transform
    if array.size < 4:
        raise IndexError(f"quat has shape {array.shape}; expected one quaternion, (4,)")
    array *= np.sqrt(2.0 / squared_norm)
    doubled = np.outer(array, array)[:4, :4]  # twice the products of two components
    real, squares = doubled[0, 1:], doubled.diagonal()[1:]
    rotation = transform[:3, :3]
    rotation[:] = doubled[1:, 1:]
    rotation[[2, 0, 1], [1, 2, 0]] += real
    rotation[[1, 2, 0], [2, 0, 1]] -= real
    rotation[range(3), range(3)] = 1.0 - squares[[1, 0, 0]] - squares[[2, 2, 1]]
    return transform


def mat_to_quat(mat: np.ndarray) -> np.ndarray:
    """The unit quaternion, (4,), of a rotation matrix, (3, 3), or homogeneous transform, (4, 4).

    Its real part is positive for rotations by less than 120 degrees; otherwise its greatest
    imaginary part is. A matrix that is no rotation gives some quaternion, perhaps NaN.

    Raises:
      AttributeError: `mat` is not an array.
      IndexError: an array of another shape that is too small.
      ValueError: an array of several matrices.
    """
    _require_array("mat", mat, AttributeError)
    if mat.shape == (3, 3):
        rotation, mat = mat, np.eye(4)
        mat[:3, :3] = rotation
    if mat.ndim != 2:  # both a ValueError and an IndexError, of which dm_control raises one
        raise np.exceptions.AxisError(
            f"mat has shape {mat.shape}; expected one matrix, (3, 3) or (4, 4)"
        )
    if min(mat.shape) < 4:
        raise IndexError(f"mat has shape {mat.shape}; expected (3, 3) or (4, 4)")
    scale = mat[3, 3]
    quat = np.empty(4)
    # Shepperd's method (Journal of Guidance and Control 1, 1978): divide by a large component.
    largest = np.trace(mat)
    if largest > scale:
        quat[0] = largest
        quat[1:] = mat[2, 1] - mat[1, 2], mat[0, 2] - mat[2, 0], mat[1, 0] - mat[0, 1]
    else:
        i = int(np.argmax(mat.diagonal()[:3]))
        j, k = (i + 1) % 3, (i + 2) % 3
        largest = mat[i, i] - (mat[j, j] + mat[k, k]) + scale
        quat[0] = mat[k, j] - mat[j, k]
        quat[[i + 1, j + 1, k + 1]] = largest, mat[i, j] + mat[j, i], mat[k, i] + mat[i, k]
    quat *= 0.5 / np.sqrt(largest * scale)
    return quat


def axisangle_to_quat(axisangle: ArrayLike, tol: float = 0.0) -> np.ndarray:
    """The quaternion, (..., 4), of a rotation by the norm of `axisangle`, (..., 3), about it.

    Args:
      axisangle: the axis times the angle.
      tol: the greatest angle for which the identity is returned.

    Raises:
      ValueError: another number of components than three.
    """
    axisangle = np.asarray(axisangle)
    angle = np.linalg.norm(axisangle, axis=-1, keepdims=True)
    if axisangle.shape[-1] not in (1, 3):  # dm_control repeats a single component
        raise ValueError(f"axisangle has shape {axisangle.shape}; expected (..., 3)")
    is_identity = angle <= tol
    axis = axisangle / np.where(is_identity, np.ones_like(angle), angle)
    # Lists, so that the sine and cosine of single precision are taken in double precision.
    axis = np.where(is_identity, [1.0, 0.0, 0.0], axis)
    half_angle = np.where(is_identity, [0.0], angle) / 2
    return np.concatenate([np.cos(half_angle), axis * np.sin(half_angle)], axis=-1)


def _quaternion(quat: ArrayLike, name: str) -> np.ndarray:
    """The quaternion as an array; IndexError if it has fewer than four components."""
    quat = np.asarray(quat)
    if not quat.ndim:
        raise np.exceptions.AxisError(f"{name} is {quat[()]!r}; expected an array (..., 4)")
    if quat.shape[-1] < 4:
        raise IndexError(f"{name} has shape {quat.shape}; expected (..., 4)")
    return quat


def _require_array(name: str, value: object, error: type[Exception]) -> None:
    if not hasattr(value, "shape"):
        raise error(
            f"{name} is a {type(value).__name__}; expected an array: use np.asarray({name})"
        )


def _clipped_cosine(cosine: np.ndarray, precision: float) -> np.ndarray:
    """The cosine between -1 and 1; ValueError if it is beyond by more than `precision`."""
    if np.any(cosine < -1.0 - precision) or np.any(cosine > 1.0 + precision):
        worst = np.max(np.abs(cosine))
        raise _OutOfRangeError(
            f"the real part of a quaternion is {worst:.12g} in magnitude; expected at most 1 "
            f"(within {precision:g}): divide it by its norm"
        )
    return np.clip(cosine, -1.0, 1.0)
