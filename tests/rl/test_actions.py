"""Checks of actions."""

from typing import Any

import numpy as np
import pytest

from limberjack.rl.actions import as_array, check_numbers, not_finite


@pytest.mark.parametrize("dtype", [float, np.float32, np.int64, np.uint8, bool])
def test_finite_numbers_of_any_real_type_pass(dtype: Any) -> None:
    check_numbers(np.ones((2, 3), dtype))


@pytest.mark.parametrize("bad", [np.array(["a"]), np.array([None]), np.array([1j])])
def test_what_is_no_real_number_is_a_type_error(bad: np.ndarray) -> None:
    with pytest.raises(TypeError, match=f"dtype {bad.dtype}"):
        check_numbers(bad)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_named_by_its_index(value: float) -> None:
    action = np.zeros((2, 3))
    action[1, 2] = value
    with pytest.raises(ValueError, match=r"not finite at index \[\[1, 2\]\]"):
        check_numbers(action)
    np.testing.assert_array_equal(not_finite(action), [[False] * 3, [False, False, True]])


def test_where_all_is_finite_there_is_no_mask() -> None:
    assert not_finite(np.zeros(3)) is None
    assert not_finite(np.zeros(3, int)) is None


def test_ragged_actions_are_refused_with_the_shape_that_was_expected() -> None:
    spec = np.zeros((2, 3))
    with pytest.raises(ValueError, match=r"expected \(2, 3\) numbers"):
        as_array([[1, 2, 3], [4]], lambda: spec)
    assert as_array([[1, 2], [3, 4]], lambda: spec).shape == (2, 2)
