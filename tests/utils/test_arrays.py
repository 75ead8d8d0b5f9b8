"""Tests of limberjack.utils.arrays: a batch gives the same bits as its rows individually."""

import threading

import numpy as np
import pytest

from limberjack.utils import arrays

_ROWS = 100_000


@pytest.fixture
def stream() -> np.random.RandomState:
    return np.random.RandomState(0)


def wide(stream: np.random.RandomState, *shape: int) -> np.ndarray:
    """Numbers of many sizes."""
    return stream.randn(*shape) * 10.0 ** stream.uniform(-4, 4, shape)


@pytest.mark.parametrize("length", [1, 2, 3, 21])
def test_norm_of_a_batch_has_the_bits_of_its_rows(
    stream: np.random.RandomState, length: int
) -> None:
    x = wide(stream, _ROWS, length)
    one_by_one = np.array([arrays.norm(row) for row in x])
    np.testing.assert_array_equal(arrays.norm(x), one_by_one)
    # dm_control's own words for one simulation.
    np.testing.assert_array_equal([np.linalg.norm(row) for row in x[:5000]], one_by_one[:5000])


def test_norm_reduces_the_last_axis_only(stream: np.random.RandomState) -> None:
    assert arrays.norm(np.array([3.0, 4.0])) == 5.0
    assert arrays.norm(np.zeros((2, 5, 3))).shape == (2, 5)


@pytest.mark.parametrize("shape", [(1,), (7,), (300,), (5, 1), (64, 3), (4, 200)])
def test_mean_has_the_bits_of_numpys(stream: np.random.RandomState, shape: tuple) -> None:
    x = stream.normal(size=shape)
    np.testing.assert_array_equal(arrays.mean(x), x.mean(axis=-1))


def test_to_frame_of_a_batch_has_the_bits_of_its_rows(stream: np.random.RandomState) -> None:
    vectors, frames = wide(stream, _ROWS // 4, 4, 3), wide(stream, _ROWS // 4, 9)
    together = arrays.to_frame(vectors, frames)
    one_by_one = [arrays.to_frame(v, f) for v, f in zip(vectors, frames, strict=True)]
    np.testing.assert_array_equal(together, one_by_one)
    single = arrays.to_frame(vectors[:, 0], frames)
    np.testing.assert_array_equal(single, together[:, 0])
    # dm_control's own words: one vector after the other.
    for rows, limbs, frame in zip(together[:5000], vectors, frames, strict=False):
        for row, limb in zip(rows, limbs, strict=True):
            np.testing.assert_array_equal(row, limb.dot(frame.reshape(3, 3)))
            np.testing.assert_array_equal(row, arrays.to_frame(limb, frame))


def test_to_frame_expresses_world_vectors_in_the_frame() -> None:
    quarter_turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    ahead, up = quarter_turn[:, 0], quarter_turn[:, 2]  # the frame's axes in the world
    np.testing.assert_array_equal(
        arrays.to_frame(np.array([ahead, up]), quarter_turn.ravel()), [[1, 0, 0], [0, 0, 1]]
    )


def test_concat_joins_the_last_axis_into_an_array_of_its_own(stream: np.random.RandomState) -> None:
    a, b = wide(stream, 5, 2), wide(stream, 5, 3)
    joined = arrays.concat((a, b))
    assert joined.shape == (5, 5)
    np.testing.assert_array_equal(
        joined, [arrays.concat(iter(rows)) for rows in zip(a, b, strict=True)]
    )
    assert not np.shares_memory(arrays.concat([a]), a)


def test_minimum_of_takes_the_smallest_of_each_row(stream: np.random.RandomState) -> None:
    values = wide(stream, 4, _ROWS)
    smallest = arrays.minimum_of(iter(values))
    np.testing.assert_array_equal(smallest, values.min(axis=0))
    assert arrays.minimum_of(values[:, 0]) == min(values[:, 0])
    assert np.isnan(arrays.minimum_of([np.array(1.0), np.array(np.nan)]))


def test_one_value_per_row_is_only_known_within_its_batch() -> None:
    x = np.zeros(8)
    assert not arrays.one_value_per_row(x)
    with arrays.rows_of_a_batch(8):
        assert arrays.one_value_per_row(x)
        assert not arrays.one_value_per_row(np.zeros(7))
        assert not arrays.one_value_per_row(np.zeros((8, 3)))
        assert not arrays.one_value_per_row(0.5)
        with arrays.rows_of_a_batch(7):
            assert not arrays.one_value_per_row(x)
        assert arrays.one_value_per_row(x)
    assert not arrays.one_value_per_row(x)


def test_an_error_leaves_the_batch() -> None:
    with pytest.raises(ZeroDivisionError), arrays.rows_of_a_batch(8):
        raise ZeroDivisionError
    assert not arrays.one_value_per_row(np.zeros(8))


def test_another_thread_is_in_no_batch() -> None:
    seen = []
    with arrays.rows_of_a_batch(8):
        thread = threading.Thread(target=lambda: seen.append(arrays.one_value_per_row(np.zeros(8))))
        thread.start()
        thread.join()
    assert seen == [False]
