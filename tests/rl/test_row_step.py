"""The time steps of rows in one object, and what is refused."""

import collections
from typing import Any

import dm_env
import numpy as np
import pytest

from limberjack.rl.row_step import RowStep, as_mapping

_MID, _LAST = dm_env.StepType.MID, dm_env.StepType.LAST


def _step() -> RowStep:
    last = {"angle": np.full((3, 2), 7.0)}
    return RowStep({"angle": np.zeros((3, 2))}, last)


def _time_step(kind: Any = _MID, reward: Any = 0.5, discount: Any = 1.0, angle: Any = (1.0, 2.0)):
    observed = collections.OrderedDict(angle=np.array(angle))
    return dm_env.TimeStep(kind, reward, discount, observed)


def test_a_row_has_its_own_values_and_leaves_the_others() -> None:
    found = _step()
    found.take(1, _time_step(), None)
    assert found.reward.tolist() == [0.0, 0.5, 0.0]
    assert found.observation["angle"].tolist() == [[0, 0], [1, 2], [0, 0]]
    found.take(1, _time_step(reward=0.25), None)
    assert found.reward[1] == 0.75  # of two steps with one action


@pytest.mark.parametrize(("discount", "timed_out"), [(1.0, True), (0.0, False), (0.9, False)])
def test_an_end_with_discount_1_is_a_truncation(discount: float, timed_out: bool) -> None:
    found = _step()
    found.take(2, _time_step(_LAST, discount=discount), None)
    assert found.timed_out.tolist() == [False, False, timed_out]
    assert found.step_type[2] == _LAST


def test_a_row_that_diverges_shows_its_last_observation() -> None:
    found = _step()
    found.diverge(0)
    assert found.observation["angle"][0].tolist() == [7, 7]
    assert (found.discount[0], found.step_type[0], found.diverged[0]) == (0.0, _LAST, True)


def test_a_row_may_be_cut_off_at_a_limit_that_its_environment_does_not_know() -> None:
    found = _step()
    found.take(0, _time_step(), None)
    found.cut(0)
    assert (found.step_type[0], found.timed_out[0], found.cut_off[0]) == (_LAST, True, True)


@pytest.mark.parametrize(
    ("time_step", "error", "message"),
    [
        (_time_step(angle=[[1.0, 2.0]]), ValueError, r"'angle' has shape \(1, 2\) and dtype"),
        (_time_step(angle=[[1.0], [2.0]]), ValueError, r"'angle' has shape \(2, 1\) and dtype"),
        (_time_step(reward=None), TypeError, "the reward of a step is None; expected a number"),
        (_time_step(reward="high"), TypeError, "the reward of a step is 'high'"),
        (_time_step(reward=np.zeros(2)), TypeError, "the reward of a step is array"),
        (_time_step(discount="d"), TypeError, "the discount of a step is 'd'"),
        (_time_step(angle=(1.0,)), ValueError, r"observation 'angle' has shape \(1,\)"),
        (_time_step(angle=(1, 2)), ValueError, "dtype int64; expected .* float64"),
        (dm_env.TimeStep(_MID, 0.0, 1.0, {"speed": np.zeros(2)}), ValueError, "has \\['speed'\\]"),
    ],
)
def test_what_does_not_fit_the_specs_is_refused(
    time_step: dm_env.TimeStep, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        _step().take(0, time_step, None)


def test_a_single_array_is_a_flat_observation() -> None:
    array = np.zeros(2)
    assert as_mapping(array)["observations"] is array
    assert as_mapping({"a": array}) == {"a": array}
