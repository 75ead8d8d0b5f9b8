"""Checks of actions."""

import numpy as np
import pytest

from limberjack.rl.actions import as_numbers, check_finite, not_finite


@pytest.mark.parametrize("dtype", [float, np.float32, np.int64, np.uint8, bool])
def test_finite_numbers_of_any_real_type_pass(dtype: type) -> None:
    check_finite(as_numbers(np.ones((2, 3), dtype)))


@pytest.mark.parametrize("bad", [np.array(["a"]), np.array([None]), np.array([1j])])
def test_an_action_that_is_not_of_real_numbers_is_a_type_error(bad: np.ndarray) -> None:
    with pytest.raises(TypeError, match=f"dtype {bad.dtype}"):
        as_numbers(bad)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_named_by_its_index(value: float) -> None:
    action = np.zeros((2, 3))
    action[1, 2] = value
    with pytest.raises(ValueError, match=r"not finite at index \[\[1, 2\]\]"):
        check_finite(action)
    np.testing.assert_array_equal(not_finite(action), [[False] * 3, [False, False, True]])
    with pytest.raises(ValueError, match=r"not finite at index \[2\]"):
        check_finite(action[1])


def test_finite_numbers_give_no_mask() -> None:
    assert not_finite(np.zeros(3)) is None
    assert not_finite(np.zeros(3, int)) is None


def test_ragged_actions_are_refused() -> None:
    with pytest.raises(ValueError, match="expected an array of numbers"):
        as_numbers([[1, 2, 3], [4]])
    assert as_numbers([[1, 2], [3, 4]]).shape == (2, 2)
