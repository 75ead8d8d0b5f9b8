"""`Counter`: step types, rewards and discounts of rows that begin and end episodes."""

from typing import Any

import dm_env
import numpy as np
import pytest

from limberjack.rl.endings import Counter, Repeated

_FIRST, _MID, _LAST = (int(kind) for kind in dm_env.StepType)
_OBSERVATION = {"angle": np.zeros((3, 1))}
_NONE = np.zeros(3, bool)
_NAN = float("nan")


def _mask(*rows: int) -> np.ndarray:
    mask = np.zeros(3, bool)
    mask[list(rows)] = True
    return mask


# Any: the quantities are numbers or arrays, the masks None or arrays.
def _count(
    counter: Counter,
    *,
    begins: Any = None,
    diverged: Any = _NONE,
    reward: Any = 0.5,
    termination: Any = None,
) -> tuple[list[int], list[float], list[float], list[bool]]:
    """The step types, rewards, discounts and last rows of a step."""
    step, last = counter.count(begins, diverged, reward, termination, _OBSERVATION)
    assert step.observation is _OBSERVATION
    return step.step_type.tolist(), step.reward.tolist(), step.discount.tolist(), last.tolist()


def test_in_mid_episode_rows_have_the_tasks_reward_and_discount_1() -> None:
    counter = Counter(3, 10)
    reward = np.array([0.1, -2.0, 3.0])
    assert _count(counter, reward=reward) == (
        [_MID] * 3,
        [0.1, -2.0, 3.0],
        [1.0] * 3,
        [False] * 3,
    )
    assert counter.steps.tolist() == [1, 1, 1]


def test_a_number_is_the_reward_of_every_row() -> None:
    assert _count(Counter(3, 10), reward=2)[1] == [2.0] * 3


def test_arrays_of_a_step_are_its_own() -> None:
    counter = Counter(3, 10)
    given = np.array([0.1, 0.2, 0.3])
    first, _ = counter.count(None, _NONE, given, None, _OBSERVATION)
    for array in (first.reward, first.discount, first.step_type):
        array[...] = 0
    assert given.tolist() == [0.1, 0.2, 0.3]
    again = _count(counter, reward=np.full(3, 0.5))
    assert again == ([_MID] * 3, [0.5] * 3, [1.0] * 3, [False] * 3)


def test_a_row_whose_episode_begins_has_reward_0_and_counts_from_0() -> None:
    counter = Counter(3, 10)
    _count(counter)
    step_type, reward, discount, last = _count(counter, begins=_mask(1))
    assert step_type == [_MID, _FIRST, _MID]
    assert reward == [0.5, 0.0, 0.5]
    assert discount == [1.0] * 3
    assert not any(last)
    assert counter.steps.tolist() == [2, 0, 2]


def test_the_time_limit_ends_an_episode_with_discount_1() -> None:
    counter = Counter(3, 2)
    assert not any(_count(counter, begins=_mask(0))[3])
    assert _count(counter) == (
        [_MID, _LAST, _LAST],
        [0.5] * 3,
        [1.0] * 3,
        [False, True, True],
    )
    assert counter.at_limit.tolist() == [False, True, True]


@pytest.mark.parametrize("limit", [2.5, 3.0])
def test_a_limit_between_two_steps_ends_the_episode_at_the_later_one(limit: float) -> None:
    counter = Counter(3, limit)
    lasts = [_count(counter)[3][0] for _ in range(3)]
    assert lasts == [False, False, True]


def test_without_a_limit_no_step_is_the_last() -> None:
    counter = Counter(3, float("inf"))
    counter.steps[:] = 10**9
    assert not any(_count(counter)[3])


def test_a_row_that_begins_is_not_ended_by_the_limit_of_its_last_episode() -> None:
    counter = Counter(3, 2)
    counter.steps[:] = 2
    step_type, _, _, last = _count(counter, begins=_mask(0, 1, 2))
    assert step_type == [_FIRST] * 3
    assert last == [False] * 3


def test_the_task_ends_rows_with_its_discount_and_nan_continues() -> None:
    step_type, reward, discount, last = _count(
        Counter(3, 10), termination=np.array([_NAN, 0.0, 0.25])
    )
    assert step_type == [_MID, _LAST, _LAST]
    assert discount == [1.0, 0.0, 0.25]
    assert reward == [0.5] * 3
    assert last == [False, True, True]


def test_the_task_does_not_end_an_episode_that_begins() -> None:
    step_type, _, discount, last = _count(Counter(3, 10), begins=_mask(0), termination=np.zeros(3))
    assert step_type == [_FIRST, _LAST, _LAST]
    assert discount == [1.0, 0.0, 0.0]
    assert last == [False, True, True]


def test_the_time_limit_wins_where_the_task_ends_the_episode_in_the_same_step() -> None:
    counter = Counter(3, 5)
    counter.steps[:] = [4, 0, 4]
    _, _, discount, last = _count(counter, termination=np.array([0.0, 0.0, _NAN]))
    assert discount == [1.0, 0.0, 1.0]
    assert last == [True, True, True]


def test_divergence_ends_a_row_with_0_and_0_even_at_the_limit_and_as_it_begins() -> None:
    counter = Counter(3, 5)
    counter.steps[0] = 4
    step_type, reward, discount, last = _count(
        counter, begins=_mask(1), diverged=_mask(0, 1), reward=np.full(3, 0.5)
    )
    assert step_type == [_LAST, _LAST, _MID]
    assert reward == [0.0, 0.0, 0.5]
    assert discount == [0.0, 0.0, 1.0]
    assert last == [True, True, False]


def test_a_diverged_rows_reward_may_be_nan() -> None:
    reward = np.array([_NAN, 0.5, 0.5])
    assert _count(Counter(3, 5), diverged=_mask(0), reward=reward)[1] == [0.0, 0.5, 0.5]


def test_after_a_reset_rows_are_shown_first_or_in_mid_episode_and_are_not_counted() -> None:
    counter = Counter(3, 10)
    counter.steps[1] = 4
    step = counter.shown(_OBSERVATION)
    assert step.step_type.tolist() == [_FIRST, _MID, _FIRST]
    assert step.reward.tolist() == [0.0] * 3
    assert step.discount.tolist() == [1.0] * 3
    assert counter.steps.tolist() == [0, 4, 0]
    step.discount[:] = 0.0
    assert counter.shown(_OBSERVATION).discount.tolist() == [1.0] * 3


def test_a_row_may_have_a_limit_of_its_own() -> None:
    counter = Counter(3, 10)
    counter.limits = np.array([1.0, 2.0, 10.0])
    assert [_count(counter)[3] for _ in range(2)] == [[True, False, False], [True, True, False]]


def _repeated(total: Repeated, *, shown: Any, stepped: Any, diverged: Any, **kwargs: Any) -> None:
    step_type, reward, discount = (np.array(kwargs[name]) for name in ("types", "rewards", "ends"))
    observation = {"angle": np.array(kwargs["angles"], float)[:, None]}
    time_step = dm_env.TimeStep(step_type, reward, discount, observation)
    total.add(time_step, {"term": reward}, shown, stepped, diverged)


def test_repeated_steps_are_summed_and_show_the_last_one_that_counts_for_a_row() -> None:
    total, all_rows = Repeated(3), np.ones(3, bool)
    _repeated(
        total,
        types=[_MID, _LAST, _MID],
        rewards=[0.1, 0.2, 0.3],
        ends=[1.0, 0.25, 1.0],
        angles=[1, 2, 3],
        shown=all_rows,
        stepped=all_rows,
        diverged=_NONE,
    )
    _repeated(
        total,
        types=[_MID, _FIRST, _LAST],
        rewards=[0.5, 9.0, 0.0],
        ends=[1.0, 1.0, 0.0],
        angles=[4, 5, 6],
        shown=_mask(0, 2),
        stepped=_mask(0, 2),
        diverged=_mask(2),
    )
    step_type, reward, discount, observation = total.time_step()
    assert step_type.tolist() == [_MID, _LAST, _LAST]
    assert reward.tolist() == [0.1 + 0.5, 0.2, 0.3]
    assert discount.tolist() == [1.0, 0.25, 0.0]
    assert observation["angle"].ravel().tolist() == [4, 2, 6]
    assert np.asarray(total.terms["term"]).tolist() == [0.1 + 0.5, 0.2, 0.3]
    assert total.last_terms["term"].tolist() == [0.5, 0.2, 0.3]  # not of the step that diverged


@pytest.mark.parametrize("hook", ["reward", "termination"])
def test_one_number_for_all_rows_is_refused_after_one_for_each(hook: str) -> None:
    counter = Counter(3, 10, "Falls")
    _count(counter, reward=np.zeros(3))
    with pytest.raises(ValueError, match=rf"get_{hook} of task Falls returned 0\.0 for all 3 rows"):
        _count(counter, **{"reward": np.zeros(3), hook: 0.0})
    alone = Counter(1, 10)
    _count(alone, reward=np.zeros(1))
    _count(alone, **{hook: 0.0})
