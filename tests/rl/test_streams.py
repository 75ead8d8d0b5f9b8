"""Random streams of rows: one for starts, a separate one for model fields."""

import numpy as np
import pytest

from limberjack.rl.randomize import stream_beside
from limberjack.rl.streams import Streams

_LARGEST = 2**32 - 1


def test_a_row_draws_from_a_stream_with_its_seed() -> None:
    streams = Streams(seed=7, count=3)
    for row in range(3):
        assert streams.own[row].rand() == np.random.RandomState(7 + row).rand()
        beside = stream_beside(np.random.RandomState(7 + row))
        assert streams.beside[row].rand() == beside.rand()


def test_without_a_seed_rows_differ_from_each_other_and_from_time_to_time() -> None:
    drawn = [stream.rand() for _ in range(2) for stream in Streams(None, 3).own]
    assert len(set(drawn)) == 6


def test_replacing_a_stream_replaces_the_one_for_model_fields() -> None:
    streams = Streams(seed=0, count=2)
    streams.replace(1, np.random.RandomState(40))
    assert streams.own[1].rand() == np.random.RandomState(40).rand()
    assert streams.beside[1].rand() == stream_beside(np.random.RandomState(40)).rand()
    assert streams.own[0].rand() == np.random.RandomState(0).rand()


def test_the_seed_of_a_row_is_known_until_its_stream_is_loaded() -> None:
    streams = Streams(seed=7, count=3)
    streams.replace(1, np.random.RandomState(40), 40)
    assert streams.seeds == [7, 40, 9]
    streams.replace(0, np.random.RandomState(41))
    streams.load(np.array([2]), streams.save(np.array([1]), with_beside=True))
    assert streams.seeds == [None, 40, None]


@pytest.mark.parametrize("with_beside", [True, False])
def test_saved_streams_continue_in_other_rows(with_beside: bool) -> None:
    source = Streams(seed=3, count=4)
    for stream in (*source.own, *source.beside):
        stream.rand(5)
    saved = source.save(np.array([1, 3]), with_beside)
    target = Streams(seed=90, count=4)
    target.load(np.array([2, 0]), saved)
    assert target.own[2].rand() == source.own[1].rand()
    assert target.own[0].rand() == source.own[3].rand()
    if with_beside:
        assert target.beside[2].rand() == source.beside[1].rand()
        assert target.beside[0].rand() == source.beside[3].rand()
    else:
        assert target.beside[0].rand() == Streams(seed=90, count=4).beside[0].rand()


def test_saved_states_do_not_advance_with_the_stream() -> None:
    streams = Streams(seed=3, count=1)
    saved = streams.save(np.array([0]), with_beside=True)
    drawn = streams.own[0].rand(3), streams.beside[0].rand(3)
    streams.load(np.array([0]), saved)
    np.testing.assert_array_equal(drawn, (streams.own[0].rand(3), streams.beside[0].rand(3)))


def test_the_largest_seed_is_accepted_and_the_next_is_refused() -> None:
    assert (
        Streams(seed=_LARGEST - 2, count=3).own[2].rand() == np.random.RandomState(_LARGEST).rand()
    )
    with pytest.raises(ValueError, match="expected a whole number from 0 to 2\\*\\*32 - 1"):
        Streams(seed=_LARGEST - 2, count=4)
