"""Attributes that a task declares as an episode's, in a single environment."""

import unittest.mock
from typing import Any

import numpy as np
import pytest

from limberjack.rl.episode_values import declared, keep_own, values_of

from .remembering import Smooth


def test_values_are_copies_of_what_the_task_has() -> None:
    task = Smooth(random=0)
    values: Any = values_of(task)
    values["last_action"][:] = 5
    assert task.last_action == 0
    assert values["change"] == 0.0
    del task.change
    assert list(values_of(task)) == ["last_action"]


def test_arrays_become_the_tasks_own() -> None:
    task, given = Smooth(random=0), np.ones(1)
    task.last_action = given
    keep_own(task, declared(task), {})
    given[:] = 9
    assert task.last_action == 1
    assert task.change == 0.0


@pytest.mark.parametrize("kept", [np.float32(0.1), np.array([0.1], np.float32), np.float16(2)])
def test_numbers_take_the_dtype_of_their_first_values(kept: Any) -> None:
    task = Smooth(random=0)
    first = values_of(task)
    task.change = kept
    keep_own(task, declared(task), first)
    assert task.change.dtype == np.float64
    assert type(task.change) is (np.ndarray if np.ndim(kept) else np.float64)
    assert task.change == kept


@pytest.mark.parametrize(
    ("before", "kept"), [(0, np.float32(0.5)), (np.float32(0), np.float64(0.1)), ([[1], []], None)]
)
def test_numbers_that_do_not_fit_and_lists_stay(before: Any, kept: Any) -> None:
    task = Smooth(random=0)
    task.change = np.zeros(2, np.float32) if kept is None else kept
    expected = task.change
    keep_own(task, ["change"], {"change": before})
    assert task.change.dtype == expected.dtype
    np.testing.assert_array_equal(task.change, expected)


def test_a_mock_declares_nothing() -> None:
    mock = unittest.mock.Mock()
    assert values_of(mock) == {}
    keep_own(mock, mock.EPISODE_ATTRIBUTES, {})


@pytest.mark.parametrize("names", ["change", 3, ("change", 3)])
def test_names_of_another_form_are_refused(names: Any) -> None:
    task = Smooth(random=0)
    task.EPISODE_ATTRIBUTES = names
    with pytest.raises(TypeError, match="EPISODE_ATTRIBUTES of task Smooth is"):
        declared(task)
