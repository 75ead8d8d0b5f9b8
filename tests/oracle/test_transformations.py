"""`utils.transformations` gives dm_control's bits, dtypes and kinds of errors."""

import functools
import inspect
import itertools
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from .oracle import BOTH, ours, theirs
from .same import assert_same_outcome, assert_same_pair

pytestmark = pytest.mark.oracle

_NAME = "utils.transformations"
_PUBLIC = [
    name
    for name, value in vars(theirs(_NAME)).items()
    if inspect.isfunction(value) and not name.startswith("_")
]
_ORDERINGS = ["XYZ", "XYX", "ZYX", "XZY", "YZX", "ZXY", "YXZ"]
_ALL_ORDERINGS = ["".join(letters) for letters in itertools.product("XYZ", repeat=3)]
_RIGHT_ANGLES = [0.0, np.pi / 2, -np.pi / 2, np.pi, 0.3]
_AROUND = [0.0, np.pi / 2, 0.3]


def _agree(name: str, *args: Any, **kwargs: Any) -> None:
    """Compares a call; where the original divides by 0, ours may do without the warning."""
    calls = [functools.partial(getattr(package(_NAME), name), *args, **kwargs) for package in BOTH]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        assert_same_outcome(map(_without_sign_of_nan, calls), f"{name}{args}{kwargs or ''}")


def _without_sign_of_nan(call: Any) -> Any:
    def result() -> Any:
        value = call()
        return np.where(np.isnan(value), np.nan, value) if value.dtype.kind == "f" else value

    return result


def _unit(*shape: int, seed: int = 0) -> np.ndarray:
    quats = np.random.RandomState(seed).normal(size=(*shape, 4))
    return quats / np.linalg.norm(quats, axis=-1, keepdims=True)


def _quaternions() -> Iterator[np.ndarray]:
    yield from _unit(200)
    half, root = 0.5, np.sqrt(0.5)
    yield from map(np.array, itertools.product([0, 1.0, -1.0, half, -half, root, -root], repeat=4))
    yield from np.random.RandomState(1).normal(size=(50, 4)) * 3
    for angle in (1e-12, 1e-9, 1e-7, 1e-5, np.pi - 1e-9, np.pi / 2, np.pi, 2 * np.pi - 1e-8):
        yield np.array([np.cos(angle), np.sin(angle), 0, 0])
    for real in (1 + 1e-11, -1 - 1e-11, 1 + 3e-10, -1.5, np.nan, np.inf):
        yield np.array([real, 1e-6, 0, 0])


_QUATERNIONS = list(_quaternions())
_OTHER_KINDS = [
    *_unit(100).astype(np.float32),
    *_unit(30).astype(np.float16),
    *np.rint(_unit(30) * 3).astype(int),
    np.array([1, 2, 3, 4], np.uint8),
    np.array([True, False, True, False]),
    *(_unit(5).tolist()),
    *map(tuple, _unit(5)),
]
_BATCHES = [_unit(*shape) for shape in [(1,), (2,), (3,), (4,), (5,), (2, 3), (4, 4), (3, 1)]]
_BATCHES += [batch.astype(np.float32) for batch in _BATCHES] + [np.zeros((0, 4)), np.zeros((3, 4))]
_WRONG = [
    None, 5, 5.0, np.float64(1), np.array(1.0), [], np.zeros(3), np.ones(3), np.ones(2), np.ones(5),
    np.ones((2, 3)), np.ones((4, 1)), np.ones(0), np.ones((3, 0)), [1, [2]],
    np.array(["a", "b", "c", "d"]),
]  # fmt: skip

_OF_A_QUATERNION = [
    "quat_conj", "quat_inv", "quat_log", "quat_to_axisangle", "quat_to_euler", "quat_to_mat",
    "axisangle_to_quat",
]  # fmt: skip


def test_every_public_function_is_there_with_the_same_arguments() -> None:
    assert sorted(ours(_NAME).__all__) == sorted(_PUBLIC)
    for name in _PUBLIC:
        mine, yours = (inspect.signature(getattr(package(_NAME), name)) for package in BOTH)
        arguments = [
            [(each.name, each.default, each.kind) for each in signature.parameters.values()]
            for signature in (mine, yours)
        ]
        assert arguments[0] == arguments[1], name


def test_the_orderings_are_the_same_in_the_same_order() -> None:
    assert list(ours(_NAME)._eulermap) == list(theirs(_NAME)._eulermap) == _ORDERINGS


@pytest.mark.parametrize("name", _OF_A_QUATERNION)
def test_functions_of_one_quaternion_are_the_same(name: str) -> None:
    for quat in [*_QUATERNIONS, *_OTHER_KINDS, *_BATCHES, *_WRONG]:
        _agree(name, quat)


@pytest.mark.parametrize("tol", [0.0, 1e-6, -1e-3, np.float64(1e-8), np.float32(1e-3)])
@pytest.mark.parametrize("name", ["quat_log", "axisangle_to_quat"])
def test_tolerances_are_used_alike(name: str, tol: float) -> None:
    for quat in [*_QUATERNIONS[:300], *_OTHER_KINDS, *_BATCHES, *_WRONG]:
        _agree(name, quat, tol)
        _agree(name, quat, tol=tol)


@pytest.mark.parametrize("name", ["quat_mul", "quat_diff", "quat_dist"])
def test_functions_of_two_quaternions_are_the_same(name: str) -> None:
    random = np.random.RandomState(2)
    every: list[Any] = [*_OTHER_KINDS, *_BATCHES, *_WRONG]
    every += [_QUATERNIONS[i] for i in random.randint(len(_QUATERNIONS), size=80)]
    for first in every:
        for second in [first, *(every[i] for i in random.randint(len(every), size=8))]:
            _agree(name, first, second)
        if isinstance(first, np.ndarray) and first.dtype.kind == "f":
            _agree(name, first, -first)
            _agree(name, first, first * (1 + 1e-9))


def test_rotated_vectors_are_the_same() -> None:
    random = np.random.RandomState(3)
    for quat in [*_QUATERNIONS[::7], *_OTHER_KINDS, *_BATCHES, *_WRONG]:
        vector = random.normal(size=3)
        for vec in [vector, vector.tolist(), vector.astype(np.float32), np.ones(2), 5, None]:
            _agree("quat_rotate", quat, vec)


@pytest.mark.parametrize("ordering", _ALL_ORDERINGS)
def test_euler_angles_of_all_orderings_are_the_same_at_right_angles_and_elsewhere(
    ordering: str,
) -> None:
    random = np.random.RandomState(4)
    # The second angle decides whether the first and the third can be told apart.
    turns = itertools.product(_AROUND, _RIGHT_ANGLES, _AROUND)
    vectors = [np.array(angles) for angles in turns]
    vectors += list(random.uniform(-7, 7, (20, 3)))
    vectors += [vector.astype(np.float32) for vector in vectors[::5]]
    for vector in vectors:
        _agree("euler_to_rmat", vector, ordering)
        _agree("euler_to_quat", vector, ordering)
        rmat = theirs(_NAME).euler_to_rmat(vector, ordering)
        nearby = rmat + random.normal(size=(3, 3)) * 1e-7
        for mat in (rmat, nearby, -rmat, rmat.astype(np.float32)):
            _agree("mat_to_quat", mat)
            _agree("rmat_to_euler", mat, ordering)


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("ordering", ["XYZ", "XYX", "ZXZ"])
def test_batches_and_wrong_euler_angles_have_the_same_outcome(ordering: str, full: bool) -> None:
    random = np.random.RandomState(5)
    vectors: list[Any] = [random.normal(size=(count, 3)) for count in (0, 1, 2, 5)]
    vectors += [random.normal(size=(4, 3)).astype(np.float32), [0.1, 0.2, 0.3], (1, 2, 3)]
    vectors += [np.ones(2), np.ones(4), np.ones((2, 4)), np.ones((2, 2, 3)), np.ones((1, 3, 1))]
    vectors += [5, None, "abc", [], np.full(3, np.nan), np.full(3, np.inf)]
    for vector in vectors:
        _agree("euler_to_rmat", vector, ordering, full)
        _agree("euler_to_quat", vector, ordering)


@pytest.mark.parametrize(
    "ordering", ["xyz", "XY", "XYZX", "", "A", "XYA", None, 5, ["X", "Y", "Z"], ("X", "Y", "Z")]
)
def test_other_orderings_have_the_same_outcome(ordering: Any) -> None:
    for vector in (np.array([0.1, 0.2, 0.3]), np.ones(4), np.ones((2, 3))):
        _agree("euler_to_rmat", vector, ordering)
        _agree("euler_to_quat", vector, ordering)
    _agree("rmat_to_euler", np.eye(3), ordering)
    _agree("quat_to_euler", np.array([1.0, 0.0, 0.0, 0.0]), ordering)


def _matrices() -> Iterator[Any]:
    random = np.random.RandomState(6)
    for shape in [(3, 3), (4, 4), (5, 5), (3, 4), (4, 3), (2, 2), (3,), (), (2, 3, 3), (5, 4, 4)]:
        yield random.normal(size=shape)
        yield np.zeros(shape)
    for diagonal in itertools.product([1, -1], repeat=3):  # half turns, and reflections
        yield np.diag(np.array(diagonal, float))
        yield np.diag(diagonal)
    for scale in [1, 2, -1, 0] * 20:
        mat = theirs(_NAME).quat_to_mat(random.normal(size=4))
        mat[:3, 3] = random.normal(size=3)
        mat[3, 3] = scale
        yield from (mat, mat.astype(np.float32), np.asfortranarray(mat), -mat)
    for row, column in itertools.permutations(range(3), 2):  # at and beside the poles
        for sine in (1, -1, 1 - 1e-6, 1 - 1.0000001e-6, 1 - 0.9e-6, -1 + 1e-6, -1 + 1.1e-6, 1.5):
            mat = theirs(_NAME).quat_to_mat(random.normal(size=4))[:3, :3]
            mat[row, column] = sine
            yield from (mat, mat.astype(np.float32))
            mat = mat.copy()
            mat[0, 0] = sine
            yield mat
    yield from (None, 5, "a", np.eye(3).tolist(), np.full((3, 3), np.nan), np.eye(3, dtype=bool))


def test_matrices_of_every_kind_are_converted_alike() -> None:
    for mat in _matrices():
        _agree("mat_to_quat", mat)
        _agree("rmat_to_euler", mat)
        for ordering in _ORDERINGS:
            _agree("rmat_to_euler", mat, ordering)


@pytest.mark.parametrize("axis", "xyz")
def test_rotations_about_one_axis_are_the_same(axis: str) -> None:
    random = np.random.RandomState(7)
    angles: list[Any] = [
        0,
        1,
        0.3,
        np.float32(0.3),
        np.float64(2),
        True,
        np.nan,
        np.inf,
        [0.1, 0.2],
    ]
    angles += [random.normal(size=shape) for shape in [(1,), (3,), (2, 2), (1, 1), (1, 2), (2, 1)]]
    angles += [random.normal(size=3).astype(np.float32), np.array([1, 2]), (0.1,), []]
    angles += [np.array(0.5), None, "a"]
    for theta in angles:
        for full in (False, True, 0, 1):
            _agree(f"rotation_{axis}_axis", theta, full)
        _agree("rotation_matrix_2d", theta)


def test_axis_angles_of_all_sizes_are_the_same() -> None:
    random = np.random.RandomState(8)
    vectors: list[Any] = [
        random.normal(size=3) * size for size in (1e-300, 1e-12, 1e-5, 1, 4, 100) for _ in range(30)
    ]
    vectors += [np.zeros(3), np.zeros((2, 3)), np.vstack([np.zeros(3), np.ones(3)]), np.ones(1)]
    vectors += [np.ones((2, 4, 3)), np.array([np.inf, 0, 0])]
    vectors += [vector.astype(np.float32) for vector in vectors] + [[0, 0, 0], np.array([1, 0, 0])]
    for vector in vectors:
        for tol in (0.0, 1e-6, 1.0, -1):
            _agree("axisangle_to_quat", vector, tol)


def test_equal_quaternions_are_as_far_apart_as_in_dm_control() -> None:
    for quat in _unit(50):
        for other in (quat, -quat, quat * (1 + 1e-12)):
            assert_same_pair(
                [package(_NAME).quat_dist(quat, other) for package in BOTH], f"{quat} and {other}"
            )
