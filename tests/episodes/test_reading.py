"""Steps of made-up episodes as transitions and windows, each compared with a loop."""

import dataclasses
import pickle

import numpy as np
import pytest

from limberjack.episodes.episode import Episode
from limberjack.episodes.reading import (
    Batch,
    Form,
    Reading,
    Recent,
    Rows,
    Windows,
    WindowsOf,
    joined,
    stream,
    taken,
)

_LENGTHS = (4, 1, 7, 7, 2)
_DISCOUNT = 0.9


def _episode(seed: int, length: int) -> Episode:
    random = np.random.default_rng(seed)
    last = np.arange(length) == length - 1
    return Episode(
        seed,
        None,
        random.normal(size=length),
        actions=random.normal(size=(length, 2)),
        terminated=last & (seed % 2 == 0),
        truncated=last & (seed % 2 == 1),
        observations={
            "position": random.normal(size=(length + 1, 3)),
            "count": np.arange(length + 1, dtype=np.int32) + 100 * seed,
        },
    )


_EPISODES = [_episode(seed, length) for seed, length in enumerate(_LENGTHS)]


def _rows(**choices: float | bool) -> Rows:
    return Rows(_EPISODES, dataclasses.replace(Reading(), **choices))


def _return(rewards: np.ndarray) -> float:
    """The discounted sum, from its end as a loop adds it."""
    total = 0.0
    for reward in rewards[::-1]:
        total = reward + _DISCOUNT * total
    return total


@pytest.mark.parametrize("n_step", [1, 2, 3, 50])
def test_a_transition_has_the_sum_of_its_rewards_and_what_follows(n_step: int) -> None:
    rows = _rows(discount=_DISCOUNT, n_step=n_step)
    batch = rows.take(np.arange(len(rows)))
    number = 0
    for episode in _EPISODES:
        for t in range(episode.length):
            rewards = episode.rewards[t : t + n_step]
            end = t + len(rewards)
            expected = sum(_DISCOUNT**k * reward for k, reward in enumerate(rewards))
            # The loop and the arrays add in another order.
            np.testing.assert_allclose(batch.rewards[number], expected, rtol=1e-14)
            for name, values in episode.observations.items():
                np.testing.assert_array_equal(batch.observations[name][number], values[t])
                np.testing.assert_array_equal(batch.next_observations[name][number], values[end])
            np.testing.assert_array_equal(batch.actions[number], episode.actions[t])
            assert batch.terminated[number] == episode.terminated[end - 1]
            assert batch.truncated[number] == episode.truncated[end - 1]
            assert batch.discounts is not None
            power = 0.0 if episode.terminated[end - 1] else _DISCOUNT ** len(rewards)
            # NumPy's power and Python's may differ in the last bit.
            np.testing.assert_allclose(batch.discounts[number], power, rtol=1e-15)
            number += 1
    assert number == len(batch) == sum(_LENGTHS)


def test_returns_to_go_are_those_of_a_loop_from_the_end() -> None:
    rows = _rows(discount=_DISCOUNT, n_step=3)
    expected = [_return(e.rewards[t:]) for e in _EPISODES for t in range(e.length)]
    np.testing.assert_array_equal(rows.take(np.arange(len(rows))).returns_to_go, expected)
    single = Rows([_EPISODES[0]], Reading(discount=1.0)).take(np.arange(4)).returns_to_go
    np.testing.assert_array_equal(single, np.cumsum(_EPISODES[0].rewards[::-1])[::-1])


def test_without_a_discount_there_are_no_returns() -> None:
    batch = _rows().take(np.arange(3))
    assert (batch.discounts, batch.returns_to_go) == (None, None)
    windows = WindowsOf(_rows(), Form(2))
    assert windows.take(np.arange(3)).returns_to_go is None


def test_numbers_of_64_bits_become_ones_of_32_and_others_stay() -> None:
    rows = _rows(float32=True, discount=_DISCOUNT)
    batch, windows = rows.take(np.arange(5)), WindowsOf(rows, Form(3)).take(np.arange(2))
    for found in (batch, windows):
        for name in ("actions", "rewards", "returns_to_go"):
            assert getattr(found, name).dtype == np.float32, name
        assert found.observations["position"].dtype == np.float32
        assert found.observations["count"].dtype == np.int32
    assert batch.discounts is not None
    assert batch.discounts.dtype == np.float32
    exact = _rows().take(np.arange(5))
    np.testing.assert_array_equal(batch.rewards, exact.rewards.astype(np.float32))


def _windows(form: Form) -> list[tuple[Episode, int]]:
    """The episode and the first step of each window."""
    return [
        (episode, first)
        for episode in _EPISODES
        for first in range(-form.before, episode.length + form.after - form.length + 1, form.stride)
    ]


_FORMS = [
    Form(1),
    Form(3),
    Form(7, stride=2),
    Form(2, stride=5),
    Form(4, after=3),
    Form(4, before=3),
    Form(5, stride=3, before=2, after=4),
    Form(9, before=8, after=8),
]


@pytest.mark.parametrize("form", _FORMS, ids=str)
def test_windows_are_those_of_a_loop(form: Form) -> None:
    source = WindowsOf(_rows(discount=_DISCOUNT), form)
    found, expected = source.take(np.arange(len(source))), _windows(form)
    assert len(found) == len(source) == len(expected)
    assert form.counts(np.array(_LENGTHS)).sum() == len(expected)
    for number, (episode, first) in enumerate(expected):
        assert (found.seeds[number], found.steps[number]) == (episode.seed, first)
        steps = np.arange(first, first + form.length)
        mask = (steps >= 0) & (steps < episode.length)
        np.testing.assert_array_equal(found.mask[number], mask)
        nearest = steps.clip(0, episode.length - 1)
        np.testing.assert_array_equal(found.actions[number], episode.actions[nearest])
        for name in ("rewards", "terminated", "truncated"):
            values = np.where(mask, getattr(episode, name)[nearest], 0)
            np.testing.assert_array_equal(getattr(found, name)[number], values)
        rows = np.arange(first, first + form.length + 1).clip(0, episode.length)
        for name, values in episode.observations.items():
            np.testing.assert_array_equal(found.observations[name][number], values[rows])
        assert found.returns_to_go is not None
        to_go = [_return(episode.rewards[t:]) for t in nearest]
        np.testing.assert_array_equal(found.returns_to_go[number], np.where(mask, to_go, 0))


def test_windows_have_the_rewards_of_single_steps_beside_transitions_with_sums() -> None:
    form = Form(3)
    which = np.arange(len(WindowsOf(_rows(), form)))
    windows = WindowsOf(_rows(discount=_DISCOUNT, n_step=3), form).take(which)
    _assert_same(windows, WindowsOf(_rows(discount=_DISCOUNT), form).take(which))


def test_windows_can_be_changed_and_the_next_ones_are_as_before() -> None:
    source = WindowsOf(_rows(discount=_DISCOUNT), Form(4, after=3))
    which = np.arange(len(source))
    before, changed = source.take(which), source.take(which)
    for field in dataclasses.fields(Windows):
        values = getattr(changed, field.name)
        for array in values.values() if isinstance(values, dict) else [values]:
            array[:] = 7
    _assert_same(source.take(which), before)


def _assert_same(one: Batch | Windows, other: Batch | Windows) -> None:
    for field in dataclasses.fields(one):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        if not isinstance(ours, dict):
            ours, theirs = {"": ours}, {"": theirs}
        for name in ours:
            np.testing.assert_array_equal(ours[name], theirs[name])


def _numbers(size: int, seed: int | None, buffer: int = 0) -> list[int]:
    """The counts of the transitions of five files, in the order in which they come."""
    random = None if seed is None else np.random.default_rng(seed)
    files = [Rows([episode], Reading()) for episode in _EPISODES]
    batches = list(stream(files, size, random, buffer))
    assert [len(batch) for batch in batches[:-1]] == [size] * (len(batches) - 1)
    assert 0 < len(batches[-1]) <= size
    return [count for batch in batches for count in batch.observations["count"].tolist()]


_ORDERED = [100 * seed + t for seed, length in enumerate(_LENGTHS) for t in range(length)]


@pytest.mark.parametrize("size", [1, 2, 3, 4, 20, 21, 22])
@pytest.mark.parametrize("buffer", [0, 1, 5, 20, 100])
def test_the_order_depends_on_the_seed_and_the_buffer_alone(size: int, buffer: int) -> None:
    assert _numbers(size, None) == _ORDERED
    found = _numbers(size, 3, buffer)
    assert found == _numbers(7, 3, buffer)
    assert found != _numbers(7, 4, buffer)
    assert sorted(found) == _ORDERED


def test_a_buffer_mixes_files_and_no_buffer_does_not() -> None:
    def changes(numbers: list[int]) -> int:
        """The number of transitions that are of another file than the one before."""
        return int((np.diff(np.array(numbers) // 100) != 0).sum())

    assert changes(_numbers(4, 0)) == 4
    assert changes(_numbers(4, 0, buffer=100)) > 8
    mixed = np.array(_numbers(4, 0, buffer=5)) // 100
    assert (np.diff(mixed) < 0).any()  # some come later than those of the file that follows


def test_a_source_without_windows_gives_none() -> None:
    files = [WindowsOf(Rows([episode], Reading()), Form(4)) for episode in _EPISODES]
    for random in (None, np.random.default_rng(0)):
        found = joined(list(stream(files, 3, random)))
        assert sorted(found.seeds.tolist()) == [0, 2, 2, 2, 2, 3, 3, 3, 3]
    assert list(stream(files[1:2], 3)) == []


def test_parts_are_joined_and_taken_in_order() -> None:
    rows = _rows(discount=_DISCOUNT)
    whole = rows.take(np.arange(10))
    _assert_same(joined([rows.take(np.arange(4)), rows.take(np.arange(4, 10))]), whole)
    which = np.array([7, 0, 7])
    _assert_same(taken(whole, which), rows.take(which))


def test_episodes_that_were_not_used_for_long_make_room() -> None:
    rows = [Rows([episode], Reading()) for episode in _EPISODES]
    recent = Recent(rows[2].nbytes + rows[3].nbytes)
    for number in (2, 3):
        assert recent.put(number, rows[number]) is rows[number]
    assert recent.get(2) is rows[2]
    recent.put(1, rows[1])
    assert [recent.get(number) for number in (1, 2, 3)] == [rows[1], rows[2], None]
    for number, again in enumerate(rows * 3, start=10):
        recent.put(number, again)
    kept = [found for number in range(30) if (found := recent.get(number)) is not None]
    assert 0 < sum(found.nbytes for found in kept) <= rows[2].nbytes + rows[3].nbytes
    small = Recent(1)
    small.put(2, rows[2])
    assert small.get(2) is rows[2]
    assert pickle.loads(pickle.dumps(recent)).get(1) is None
