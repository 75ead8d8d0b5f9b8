"""Validation of a batch's arguments: numbers, rows, seeds, actions, memory and threads."""

import pickle
import threading
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack.rl import guards

_NONE_BEGINS = np.zeros(3, bool)


@pytest.mark.parametrize("value", [1, 7, np.int64(3)])
def test_whole_numbers_of_at_least_1_are_taken_as_ints(value: Any) -> None:
    assert guards.at_least_one("num_envs", value) == value
    assert type(guards.at_least_one("num_envs", value)) is int


@pytest.mark.parametrize("value", [0, -1, 1.0, "1", None, True, np.True_, np.float64(2)])
def test_other_numbers_are_refused_by_name(value: object) -> None:
    with pytest.raises(ValueError, match=r"^num_envs is .*; expected a whole number of at least 1"):
        guards.at_least_one("num_envs", value)


def test_on_divergence_is_one_of_two_words() -> None:
    assert guards.raises_on_divergence("raise") is True
    assert guards.raises_on_divergence("end") is False
    with pytest.raises(ValueError, match="on_divergence is 'stop'; expected 'end' or 'raise'"):
        guards.raises_on_divergence("stop")


# Memory.


def test_rows_that_cannot_fit_are_refused_with_the_bytes() -> None:
    row = [np.zeros(10**5), np.zeros((10**3, 10**2), np.float32)]  # 1.2 MB
    guards.check_memory(100, row)
    with pytest.raises(MemoryError, match=r"num_envs is 10{9}, which takes (\d+) bytes") as error:
        guards.check_memory(10**9, row)
    needed, memory = [int(word) for word in str(error.value).split() if word.isdigit()]
    assert needed > 2 * 10**9 * 1_200_000
    assert 2**28 < memory < needed


# Rows.


@pytest.mark.parametrize(
    ("ids", "expected"),
    [
        ([0, 2], [0, 2]),
        (np.array([1], np.uint8), [1]),
        (range(3), [0, 1, 2]),
        ([], []),
        ([True, False, True], [0, 2]),
        (np.zeros(3, bool), []),
    ],
)
def test_rows_are_given_by_numbers_or_a_mask(ids: Any, expected: list[int]) -> None:
    rows = guards.as_rows(ids, 3)
    assert rows.tolist() == expected
    assert rows.dtype == int


@pytest.mark.parametrize(
    ("ids", "message"),
    [
        ([True, False], r"the mask has shape \(2,\); expected \(3,\)"),
        ([0, 3], "expected numbers from 0 to 2"),
        ([-1], "expected numbers from 0 to 2"),
        ([2, 0], "expected sorted numbers without repeats"),
        ([1, 1], "expected sorted numbers without repeats"),
        ([0.0], "expected a list of row numbers or a mask"),
        (1, "expected a list of row numbers or a mask"),
        ([[0, 1]], "expected a list of row numbers or a mask"),
        ("0", "expected a list of row numbers or a mask"),
    ],
)
def test_other_rows_are_refused(ids: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        guards.as_rows(ids, 3)


# Threads.


# Seeds.


def test_each_row_has_its_seed_and_none_stays_none() -> None:
    seeds: Any = [3, None, np.int32(5)]
    assert guards.seeds_of_rows(seeds, 3) == [3, None, 5]
    array: Any = np.array([7])
    assert guards.seeds_of_rows(array, 1) == [7]
    assert guards.seeds_of_rows(None, 2) == [None, None]


@pytest.mark.parametrize(
    ("seeds", "error", "message"),
    [
        ([1], ValueError, "there are 1 seeds; expected 2, one for each row"),
        ([1, -1], ValueError, "seed is -1"),
        ([1, 2**32], ValueError, "expected a whole number from 0 to 2"),
        ([True, 1], TypeError, "seed is True"),
        ([1, 0.5], TypeError, "seed is 0.5"),
    ],
)
def test_other_seeds_are_refused(seeds: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        guards.seeds_of_rows(seeds, 2)


# Actions.


@pytest.mark.parametrize(
    "actions", [np.zeros((3, 2)), [[0, 1]] * 3, np.ones(3, bool), np.zeros((3, 2, 2), np.float32)]
)
def test_actions_are_numbers_with_one_row_for_each_environment(actions: Any) -> None:
    given = guards.check_actions(actions, 3, _NONE_BEGINS)
    np.testing.assert_array_equal(given, np.asarray(actions))


@pytest.mark.parametrize(
    ("actions", "error", "message"),
    [
        (np.zeros((2, 2)), ValueError, r"actions have shape \(2, 2\); expected 3 rows"),
        (0.0, ValueError, r"actions have shape \(\); expected 3 rows, one for each"),
        ([[0.0], [0.0, 1.0], [0.0]], ValueError, "expected an array of numbers"),
        (np.array(["a", "b", "c"]), TypeError, "expected numbers"),
        ([None] * 3, TypeError, "expected numbers"),
    ],
)
def test_other_actions_are_refused(actions: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        guards.check_actions(actions, 3, _NONE_BEGINS)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_rows_that_are_not_finite_are_named_unless_they_begin(bad: float) -> None:
    actions = np.zeros((3, 2))
    actions[[0, 2], 1] = bad
    with pytest.raises(ValueError, match=r"not finite in rows \[0, 2\]; nothing was stepped"):
        guards.check_actions(actions, 3, _NONE_BEGINS)
    with pytest.raises(ValueError, match=r"not finite in rows \[12\]"):
        guards.check_actions(actions, 3, np.array([True, False, False]), first_row=10)
    begins = np.array([True, False, True])
    assert guards.check_actions(actions, 3, begins) is actions


def test_a_spec_of_rows_has_the_bounds_of_one_in_each() -> None:
    one = specs.BoundedArray((2,), np.float32, [-1.0, -2.0], 3.0, name="torque")
    spec = guards.batched_spec(one, 3)
    assert (spec.shape, spec.dtype, spec.name) == ((3, 2), np.float32, "torque")
    np.testing.assert_array_equal(spec.minimum, [[-1.0, -2.0]] * 3)
    np.testing.assert_array_equal(np.broadcast_to(spec.maximum, (3, 2)), np.full((3, 2), 3.0))


# Threads.


def _in_another_thread(use: guards.OneUser) -> list[str]:
    """The errors of a thread that enters."""
    errors: list[str] = []

    def enter() -> None:
        try:
            with use:
                pass
        except RuntimeError as error:
            errors.append(str(error))

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    return errors


def test_a_second_thread_is_refused_while_the_first_is_within() -> None:
    use = guards.OneUser("batch")
    assert _in_another_thread(use) == []
    with use:
        (error,) = _in_another_thread(use)
    assert error.startswith("this batch is used from two threads at once: give each thread one of")
    assert _in_another_thread(use) == []


def test_a_context_that_fails_is_left() -> None:
    use = guards.OneUser("batch")
    with pytest.raises(ZeroDivisionError), use:
        _ = 1 / 0
    assert _in_another_thread(use) == []


def test_one_thread_may_enter_again_after_an_interrupt_that_left_it_within() -> None:
    use = guards.OneUser("batch")
    use.__enter__()  # and Ctrl-C before `__exit__`
    with use:
        pass
    assert _in_another_thread(use) == []


def test_entering_or_checking_an_unusable_context_raises_its_reason() -> None:
    use = guards.OneUser("batch")
    use.check()
    use.what_is_wrong = "this batch is closed"
    with pytest.raises(RuntimeError, match="this batch is closed"):
        use.check()
    with pytest.raises(RuntimeError, match="this batch is closed"), use:
        raise AssertionError("it was entered")


def test_a_copy_is_free_and_has_the_name() -> None:
    use = guards.OneUser("environment")
    with use:
        copied = pickle.loads(pickle.dumps(use))
        assert _in_another_thread(copied) == []
        with copied:
            assert "this environment is used" in _in_another_thread(copied)[0]


def test_a_switch_is_true_or_false() -> None:
    assert guards.yes_or_no("stagger", np.True_) is True
    assert guards.yes_or_no("stagger", False) is False
    for wrong in (None, 0, 1, "yes", np.ones(2, bool)):
        with pytest.raises(ValueError, match=r"stagger is .*; expected True or False"):
            guards.yes_or_no("stagger", wrong)
