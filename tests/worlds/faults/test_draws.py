"""Random numbers that are functions of a key, a step and an index."""

import numpy as np
import pytest

from limberjack.worlds.faults import draws

_MANY = 20_000


def _keys(count: int) -> np.ndarray:
    return np.random.RandomState(0).randint(0, 2**63, count, np.int64).astype(np.uint64)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 16, 33])
@pytest.mark.parametrize("draw", [draws.uniform, draws.normal])
def test_a_row_draws_alone_what_it_draws_among_others(draw: type, count: int) -> None:
    keys, steps = _keys(9), np.arange(9)
    among = draw(keys, steps, 3, count)
    for row in range(9):
        np.testing.assert_array_equal(among[[row]], draw(keys[[row]], steps[[row]], 3, count))


def test_more_numbers_begin_with_the_same_ones() -> None:
    keys, steps = _keys(4), np.zeros(4, int)
    more = draws.uniform(keys, steps, 0, 9)
    np.testing.assert_array_equal(more[:, :5], draws.uniform(keys, steps, 0, 5))


def test_keys_steps_kinds_and_indices_give_different_numbers() -> None:
    keys, steps = np.arange(40, dtype=np.uint64).repeat(40), np.tile(np.arange(40), 40)
    found = np.concatenate([draws.uniform(keys, steps, kind, 4) for kind in range(3)])
    assert len(np.unique(found)) == found.size


def test_uniform_numbers_are_spread_evenly() -> None:
    found = draws.uniform(np.zeros(_MANY, np.uint64), np.arange(_MANY), 0, 1).ravel()
    assert 0.0 <= found.min() < found.max() < 1.0
    counts, _ = np.histogram(found, 20, (0.0, 1.0))
    # 5 standard deviations of a count, which is binomial.
    assert np.abs(counts - _MANY / 20).max() < 5 * np.sqrt(_MANY / 20)
    assert abs(np.corrcoef(found[:-1], found[1:])[0, 1]) < 5 / np.sqrt(_MANY)


def test_normal_numbers_have_the_moments_of_their_distribution() -> None:
    found = draws.normal(_keys(_MANY // 10), np.zeros(_MANY // 10, int), 1, 10)
    assert np.isfinite(found).all()
    # 5 standard errors of each moment.
    error = 5 / np.sqrt(found.size)
    assert abs(found.mean()) < error
    assert abs(found.var() - 1) < error * np.sqrt(2)
    assert abs((found**4).mean() - 3) < error * np.sqrt(96)
    assert abs(np.corrcoef(found[:, 0], found[:, 5])[0, 1]) < 5 / np.sqrt(len(found))


def test_a_key_belongs_to_the_state_of_a_stream_and_does_not_advance_it() -> None:
    stream = np.random.RandomState(3)
    first = draws.key_of(stream, 0)
    assert draws.key_of(np.random.RandomState(3), 0) == first
    assert draws.key_of(np.random.RandomState(4), 0) != first
    assert stream.uniform() == np.random.RandomState(3).uniform()
    assert draws.key_of(stream, 0) != first


def test_a_key_differs_for_each_episode_of_a_stream_that_nothing_draws_from() -> None:
    stream = np.random.RandomState(3)
    assert len({int(draws.key_of(stream, episode)) for episode in range(5)}) == 5
