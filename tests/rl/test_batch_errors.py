"""Error messages about tasks that are not batch-safe: the difference, its location and advice."""

import collections
from typing import Any

import numpy as np
import pytest

from limberjack.rl.batch_errors import Finding, explained
from limberjack.rl.contract import PhysicsError
from limberjack.utils import arrays

_ADVICE = "index with `...`, reduce over axis -1, and write np.maximum and np.where for max"


def _finding(label: str = "observation 'angle'", **given: Any) -> Finding:
    return Finding(label, "Swing", **{"row": 1, "step": 2, "num_rows": 3, **given})


# Values.


def test_equal_values_pass_and_nan_is_equal_to_nan() -> None:
    found = np.array([[0.0, 1.0], [np.nan, 2.0], [5.0, 6.0]])
    _finding().check(found, np.array([np.nan, 2.0]))
    _finding("is_success").check(np.array([False, True, False]), np.array(True))


def test_the_first_value_that_differs_is_named_with_its_index_and_row() -> None:
    found = np.zeros((3, 2, 2))
    found[1, 1, 0] = 0.5
    with pytest.raises(ValueError, match=r"^observation 'angle' of task Swing is 0\.5 at") as error:
        _finding().check(found, np.zeros((2, 2)))
    assert "at index [1, 0] in row 1 of a batch after 2 steps; expected 0.0, as in a" in str(
        error.value
    )
    assert str(error.value).split(": ", 1)[1].startswith(_ADVICE)


def test_only_the_row_of_the_finding_is_compared() -> None:
    _finding(row=0).check(np.array([1.0, 2.0, 3.0]), np.array(1.0))
    with pytest.raises(ValueError, match=r"is 2\.0 in row 1 of a batch as episodes begin; exp"):
        _finding(row=1, step=0).check(np.array([1.0, 2.0, 3.0]), np.array(1.0))


@pytest.mark.parametrize("value", [np.nextafter(1.0, 2.0), np.nan])
def test_the_last_bit_and_nan_count_as_differences(value: float) -> None:
    with pytest.raises(ValueError, match="in row 1"):
        _finding().check(np.array([1.0, value, 1.0]), np.array(1.0))


# Shapes and types.


@pytest.mark.parametrize("shape", [(), (2,), (3,), (3, 1), (1, 2), (2, 3)])
def test_another_shape_than_one_for_each_row_is_refused(shape: tuple[int, ...]) -> None:
    expected = r"has shape .* in a batch of 3; expected \(3, 2\): index with"
    with pytest.raises(ValueError, match=expected):
        _finding().check(np.zeros(shape), np.zeros(2))


@pytest.mark.parametrize("label", ["the reward", "reward term 'near'", "is_success"])
def test_a_constant_stands_for_all_rows_where_a_task_may_give_one(label: str) -> None:
    _finding(label).check(np.array(1.0), np.array(1.0))
    with pytest.raises(ValueError, match=r"is 1\.0 in row 1"):
        _finding(label).check(np.array(1.0), np.array(0.0))


def test_a_constant_is_refused_as_an_observation() -> None:
    with pytest.raises(ValueError, match=r"has shape \(\) in a batch of 3; expected \(3,\)"):
        _finding().check(np.array(1.0), np.array(1.0))


def test_a_termination_of_none_is_nan_for_all_rows_and_another_number_is_refused() -> None:
    _finding("get_termination").check(np.array(np.nan), np.array(np.nan))
    with pytest.raises(ValueError, match=r"get_termination of task Swing is nan in row 1"):
        _finding("get_termination").check(np.array(np.nan), np.array(0.0))
    with pytest.raises(ValueError, match=r"has shape \(\)"):
        _finding("get_termination").check(np.array(0.0), np.array(0.0))


def test_an_observation_of_another_type_is_refused_and_a_reward_is_not() -> None:
    found, expected = np.zeros(3, np.float32), np.array(0.0)
    with pytest.raises(ValueError, match="dtype float32 in a batch; expected float64, as in a"):
        _finding().check(found, expected)
    _finding("the reward").check(found, expected)


# Measurements.


def test_a_measurement_of_one_value_for_all_rows_must_be_the_rows_value() -> None:
    finding = _finding("physics.distance()")
    finding.check_measurement(np.array(2.0), np.array(2.0))
    finding.check_measurement(np.array([0.5, 2.0, 0.5]), np.array(2.0))
    finding.check_measurement(np.ones((2, 3)), np.zeros(2))  # in columns
    with pytest.raises(
        ValueError, match=r"^physics\.distance\(\) .* has shape \(\) in a batch of 3"
    ):
        finding.check_measurement(np.array(2.0), np.array(1.0))
    with pytest.raises(ValueError, match=r"has shape \(2,\) in a batch of 3; expected \(3, 2\)"):
        finding.check_measurement(np.ones(2), np.zeros(2))
    with pytest.raises(ValueError, match=r"is 2\.0 in row 1 of a batch"):
        finding.check_measurement(np.array([1.0, 2.0, 1.0]), np.array(1.0))


# Advice.


@pytest.mark.parametrize("label", ["data.ctrl", "model.body_pos"])
def test_quantities_set_by_steps_have_advice_on_steps(label: str) -> None:
    with pytest.raises(ValueError, match="before_step and after_step must set it for each row"):
        _finding(label).check(np.zeros(3), np.array(1.0))


def test_a_quantity_that_only_one_side_has_is_named() -> None:
    missing = _finding().missing(["observation 'speed'", "the reward"])
    assert "'angle' of task Swing is missing in a batch after 2 steps, which has only " in str(
        missing
    )
    assert "observation 'speed', the reward: a task must have the same quantities" in str(missing)
    surplus = str(_finding(step=0).surplus())
    assert "exists in a batch as episodes begin, but not in a single simulation" in surplus


# Errors that a task raises.


def _raise(error: BaseException) -> None:
    raise error


@pytest.mark.parametrize(
    "error",
    [
        TypeError("t"),
        ValueError("v"),
        IndexError("i"),
        KeyError("k"),
        AttributeError("a"),
        ZeroDivisionError("z"),
        FloatingPointError("f"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_in_a_batch_has_the_name_the_rows_the_line_and_the_advice(
    error: Exception,
) -> None:
    with (
        pytest.raises(ValueError, match=r"^the reward of task Swing raises ") as caught,
        explained("the reward", "Swing", num_rows=3),
    ):
        _raise(error)
    text = str(caught.value)
    assert f"raises {type(error).__name__} in a batch of 3 rows, but not in a single" in text
    assert f"simulation: {error} (_raise, line " in text
    assert ": `raise error`); " + _ADVICE in text
    assert caught.value.__cause__ is error


@pytest.mark.parametrize("error", [PhysicsError("diverged"), OSError("o"), KeyboardInterrupt()])
def test_unrelated_errors_pass(error: BaseException) -> None:
    with pytest.raises(type(error)) as caught, explained("the reward", "Swing", num_rows=3):
        _raise(error)
    assert caught.value is error


def test_errors_of_a_single_simulation_pass() -> None:
    with pytest.raises(IndexError), explained("the reward", "Swing", 1, is_batch=False):
        _raise(IndexError("i"))


def test_without_an_error_nothing_happens() -> None:
    with explained("the reward", "Swing", num_rows=3):
        pass


def test_the_line_is_the_tasks_own_and_not_that_of_a_function_that_it_calls() -> None:
    with (
        pytest.raises(ValueError, match="the reward of task") as caught,
        explained("the reward", "Swing", num_rows=3),
    ):
        arrays.norm("a word")  # pyright: ignore[reportArgumentType]
    assert '`arrays.norm("a word")' in str(caught.value)
    with (
        pytest.raises(ValueError, match="the reward of task") as caught,
        explained("the reward", "Swing", num_rows=3),
    ):
        np.concatenate([np.zeros(2), np.zeros((2, 2))])
    assert "`np.concatenate(" in str(caught.value)


def test_the_observation_that_was_being_made_is_named() -> None:
    labels = ["the reward", "observation 'angle'", "observation 'speed'", "observation 'goal'"]

    def get_observation(made: int) -> Any:
        obs = collections.OrderedDict()
        for name in ("angle", "speed")[:made]:
            obs[name] = 0.0
        obs["next"] = np.zeros(2) + np.zeros(3)
        return obs

    for made, name in enumerate(("angle", "speed", "goal")):
        with (
            pytest.raises(ValueError, match=f"^observation '{name}' of task Swing raises"),
            explained("get_observation", "Swing", 3, expected=labels),
        ):
            get_observation(made)


def test_an_observation_that_cannot_be_inferred_names_the_whole_method() -> None:
    def get_observation() -> Any:
        return {"angle": np.zeros(2) + np.zeros(3)}

    other = {"elsewhere": 0.0}

    def get_observation_of_others() -> Any:
        obs = dict(other)
        return obs["angle"]

    for broken in (get_observation, get_observation_of_others):
        with (
            pytest.raises(ValueError, match=r"^get_observation of task Swing raises"),
            explained("get_observation", "Swing", 3, expected=["observation 'angle'"]),
        ):
            broken()
