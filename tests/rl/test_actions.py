"""Checks of actions."""

from typing import Any

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


@pytest.mark.parametrize("value", ["1e400", "-1e400", "inf"])
def test_a_wide_number_that_is_infinite_for_mujoco_is_refused(value: str) -> None:
    given = as_numbers(np.full((2, 3), np.longdouble(value)))
    assert given.dtype == float
    with pytest.raises(ValueError, match="not finite"):
        check_finite(given)
    check_finite(as_numbers(np.full(3, np.longdouble("1e300"))))
    assert as_numbers(np.full(3, np.longdouble("1e-4000"))).tolist() == [0.0] * 3


@pytest.mark.parametrize("dtype", [float, np.float32, np.float16, np.int8, np.uint64, bool])
def test_other_numbers_keep_their_type(dtype: type) -> None:
    action = np.ones(3, dtype)
    assert as_numbers(action) is action


@pytest.mark.parametrize(
    "bad", [[10**400], [10**400, 1.5], [2**70], [None, 1.0], [1 + 2j], "1", b"1", {}, object()]
)
def test_what_is_no_array_of_numbers_is_refused_in_one_sentence(bad: Any) -> None:
    with pytest.raises(
        (TypeError, ValueError), match=r"^action (has dtype|is) .*expected"
    ) as caught:
        as_numbers(bad)
    assert len(str(caught.value)) < 200


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
