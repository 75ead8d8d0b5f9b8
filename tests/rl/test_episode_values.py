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
    keep_own(task, declared(task))
    given[:] = 9
    assert task.last_action == 1
    assert task.change == 0.0


def test_a_mock_declares_nothing() -> None:
    mock = unittest.mock.Mock()
    assert values_of(mock) == {}
    keep_own(mock, mock.EPISODE_ATTRIBUTES)


@pytest.mark.parametrize("names", ["change", 3, ("change", 3)])
def test_names_of_another_form_are_refused(names: Any) -> None:
    task = Smooth(random=0)
    task.EPISODE_ATTRIBUTES = names
    with pytest.raises(TypeError, match="EPISODE_ATTRIBUTES of task Smooth is"):
        declared(task)
