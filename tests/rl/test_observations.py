"""Observations: flat or by name, of a single simulation or of a batch."""

from collections import OrderedDict
from typing import Any, cast

import numpy as np
import pytest

from limberjack.rl.observations import flatten_observation, of_rows, specs_of


def test_flattening_follows_an_ordered_dict_and_else_the_alphabet() -> None:
    values = {"b": np.array([1.0, 2.0]), "a": np.array(3.0), "c": np.array([[4.0, 5.0]])}
    assert flatten_observation(OrderedDict(values))["observations"].tolist() == [1, 2, 3, 4, 5]
    flat = flatten_observation(dict(values), output_key="all")
    assert type(flat) is dict
    assert flat["all"].tolist() == [3, 1, 2, 4, 5]


@pytest.mark.parametrize("make", [dict, OrderedDict])
def test_a_row_of_a_flat_batch_is_the_flat_observation_of_that_row(make: type) -> None:
    stream = np.random.RandomState(0)
    batched = make({"b": stream.rand(3, 2, 2), "a": stream.rand(3)})
    rows = [make({name: value[row] for name, value in batched.items()}) for row in range(3)]
    flat = of_rows(batched, 3, flat=True)
    assert list(flat) == ["observations"]
    for row, single in enumerate(rows):
        np.testing.assert_array_equal(
            flat["observations"][row], flatten_observation(single)["observations"]
        )


def test_arrays_of_a_batch_are_its_own_and_views_are_copied() -> None:
    memory = np.arange(6.0).reshape(3, 2)
    fresh = np.ones((3, 2))
    observed = of_rows({"view": memory[:], "fresh": fresh}, 3, flat=False)
    assert observed["fresh"] is fresh  # no one else holds it, so it need not be copied
    memory[:] = -1
    np.testing.assert_array_equal(observed["view"], np.arange(6.0).reshape(3, 2))


def test_specs_have_each_arrays_shape_type_and_name_in_order() -> None:
    specs = specs_of({"z": np.zeros((2, 3), np.float32), "a": np.zeros(4, np.uint8)})
    assert [(s.name, s.shape, s.dtype) for s in specs.values()] == [
        ("z", (2, 3), np.float32),
        ("a", (4,), np.uint8),
    ]
    assert list(specs) == ["z", "a"]


@pytest.mark.parametrize("returned", [None, np.zeros(3)])
def test_an_observation_without_names_is_refused(returned: Any) -> None:
    with pytest.raises(TypeError, match=r"returned .*; expected a mapping from names to arrays"):
        specs_of(returned)


def test_a_nested_observation_is_refused_by_name() -> None:
    with pytest.raises(TypeError, match="observation 'arm' is a dict; expected an array"):
        specs_of(cast(Any, {"angle": np.zeros(2), "arm": {"angle": np.zeros(2)}}))
