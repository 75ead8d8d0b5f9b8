"""The form of observations that Gymnasium gets, of one simulation and of a batch."""

from collections import OrderedDict
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack.gym.observations import Observations, action_space, specs_of_one_row

_SHAPES = {"height": (), "limbs": (2, 3), "angles": (4,)}
_SPECS = OrderedDict((name, specs.Array(shape, float)) for name, shape in _SHAPES.items())
_SIZE = 1 + 6 + 4
_ROWS = 3


def _batched(seed: int = 0) -> dict[str, np.ndarray]:
    stream = np.random.RandomState(seed)
    return {name: stream.randn(_ROWS, *shape) for name, shape in _SHAPES.items()}


def _row(batched: dict[str, np.ndarray], row: int) -> dict[str, Any]:
    return {name: value[row] for name, value in batched.items()}


def test_the_layout_has_each_part_in_order_without_gaps() -> None:
    layout = Observations(_SPECS, flat=True, dtype="float64").layout
    assert [part.name for part in layout] == list(_SHAPES)
    assert [(part.slice.start, part.slice.stop) for part in layout] == [(0, 1), (1, 7), (7, 11)]
    assert [part.shape for part in layout] == list(_SHAPES.values())


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("flat", [True, False])
def test_a_row_of_a_batch_is_the_observation_of_one_simulation(flat: bool, dtype: str) -> None:
    observations: Any = Observations(_SPECS, flat, dtype)
    together = observations.of_batch(_batched(), observations.buffer(_ROWS))
    for row in range(_ROWS):
        one = observations.of_one(_row(_batched(), row))
        assert observations.space.contains(one)
        if flat:
            assert one.dtype == together.dtype == dtype
            np.testing.assert_array_equal(together[row], one)
            continue
        assert list(one) == list(together) == list(_SHAPES)
        for name, value in one.items():
            assert value.dtype == together[name].dtype == dtype
            np.testing.assert_array_equal(together[name][row], value)


@pytest.mark.parametrize("flat", [True, False])
def test_the_flat_array_is_read_back_by_the_layout(flat: bool) -> None:
    observations: Any = Observations(_SPECS, flat=True, dtype="float64")
    joined = observations.of_batch(_batched(), observations.buffer(_ROWS))
    assert joined.shape == (_ROWS, _SIZE)
    for name, columns, shape in observations.layout:
        read = joined[..., columns].reshape(_ROWS, *shape)
        np.testing.assert_array_equal(read, _batched()[name])


@pytest.mark.parametrize("flat", [True, False])
def test_one_simulations_observation_is_in_arrays_of_its_own(flat: bool) -> None:
    observations: Any = Observations(_SPECS, flat, "float64")
    memory = _row(_batched(), 0)  # views of the batch's arrays
    one = observations.of_one(memory)
    before = one.copy() if flat else {name: np.array(value) for name, value in one.items()}
    memory["limbs"][:] = -9
    np.testing.assert_array_equal(
        one if flat else one["limbs"], before if flat else before["limbs"]
    )


@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("rows", [[0, 2], [1], [2]])
def test_copies_of_rows_are_those_rows_and_do_not_change_later(flat: bool, rows: list[int]) -> None:
    observations: Any = Observations(_SPECS, flat, "float64")
    batched = _batched()
    together = observations.of_batch(batched, observations.buffer(_ROWS))
    copies = observations.copies_of_rows(together, np.array(rows))
    for value in (together,) if flat else together.values():
        value[:] = 0
    assert len(copies) == len(rows)
    for row, copy in zip(rows, copies, strict=True):
        expected = observations.of_one(_row(_batched(), row))
        for name in [None] if flat else list(_SHAPES):
            got, wanted = (copy, expected) if name is None else (copy[name], expected[name])
            assert isinstance(got, np.ndarray)
            np.testing.assert_array_equal(got, wanted)


def test_without_a_flat_array_there_is_no_buffer_and_numbers_of_the_type_are_not_copied() -> None:
    observations: Any = Observations(_SPECS, flat=False, dtype="float64")
    batched = _batched()
    assert observations.buffer(_ROWS) is None
    assert observations.of_batch(batched, None)["limbs"] is batched["limbs"]


@pytest.mark.parametrize("dtype", ["float16", "int64", "no such type", None, complex])
def test_other_types_of_numbers_are_refused(dtype: Any) -> None:
    with pytest.raises(ValueError, match="expected 'float64' or 'float32'"):
        Observations(_SPECS, flat=True, dtype=dtype)


def test_a_task_that_observes_nothing_has_an_empty_array() -> None:
    observations: Any = Observations({}, flat=True, dtype="float64")
    assert observations.layout == ()
    assert observations.of_one({}).shape == observations.space.shape == (0,)


def test_the_specs_of_a_row_lack_the_first_axis() -> None:
    batched = {"limbs": specs.Array((_ROWS, 2, 3), np.float32)}
    found = specs_of_one_row(batched)["limbs"]
    assert (found.shape, found.dtype) == ((2, 3), np.float32)


def test_the_action_space_has_the_specs_bounds_for_each_actuator() -> None:
    spec = specs.BoundedArray((3,), float, [-1.0, -2.0, 0.0], 5.0)
    space: Any = action_space(spec)
    assert space.dtype == np.float32
    assert space.low.tolist() == [-1.0, -2.0, 0.0]
    assert space.high.tolist() == [5.0] * 3


def test_the_action_space_lies_within_bounds_that_float32_rounds() -> None:
    low, high = np.array([-0.1, 0.1, -0.3]), np.array([0.1, 0.3, 0.7])
    space: Any = action_space(specs.BoundedArray((3,), float, low, high))
    assert (np.float32(low) < low).any()  # the nearest numbers would not do
    assert (np.float32(high) > high).any()
    assert (space.low >= low).all()
    assert (space.high <= high).all()
    np.testing.assert_allclose(space.low, low, rtol=2e-7)  # float32 has 24 binary digits
    np.testing.assert_allclose(space.high, high, rtol=2e-7)


def test_an_unlimited_action_has_infinite_bounds_so_that_samples_are_moderate() -> None:
    bounds = specs.BoundedArray((3,), float, [-1e10, -2.0, -1e10], [1e10, 1e10, 3.0])
    space: Any = action_space(bounds)
    assert space.low.tolist() == [-np.inf, -2.0, -np.inf]
    assert space.high.tolist() == [np.inf, np.inf, 3.0]
    assert max(abs(space.sample()).max() for _ in range(100)) < 100
