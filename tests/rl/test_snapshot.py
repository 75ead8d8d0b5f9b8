"""Snapshots: what must agree before anything is restored."""

import pickle
from typing import Any

import numpy as np
import pytest

from limberjack.rl.snapshot import Snapshot

_ORIGIN = {"task": "Humanoid", "fields": ("body_pos",), "nq": 28}


def _snapshot(size: int = 2, **origin: Any) -> Snapshot:
    return Snapshot(
        {**_ORIGIN, **origin},
        {"state": np.zeros((size, 3))},
        np.zeros(size, int),
        np.zeros(size, bool),
        [None] * size,
    )


def test_its_length_is_the_number_of_environments() -> None:
    assert [len(_snapshot(size)) for size in (1, 5)] == [1, 5]


def test_one_of_the_same_origin_and_size_is_accepted() -> None:
    _snapshot().check(_ORIGIN, size=2, step_limit=np.inf)


@pytest.mark.parametrize(
    ("name", "value"), [("task", "Stack"), ("fields", ("body_quat",)), ("nq", 27)]
)
def test_one_of_another_origin_is_refused_by_name_with_both_values(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=name) as caught:
        _snapshot(**{name: value}).check(_ORIGIN, size=2, step_limit=np.inf)
    assert repr(value) in str(caught.value)
    assert repr(_ORIGIN[name]) in str(caught.value)


def test_one_that_lacks_a_part_of_the_origin_is_refused() -> None:
    with pytest.raises(ValueError, match="camera"):
        _snapshot().check({**_ORIGIN, "camera": "side"}, size=2, step_limit=np.inf)


@pytest.mark.parametrize("size", [1, 3])
def test_one_of_another_size_is_refused_with_both_sizes(size: int) -> None:
    with pytest.raises(ValueError, match=f"2 environments; expected {size}"):
        _snapshot().check(_ORIGIN, size, np.inf)


def test_it_is_the_same_after_pickling() -> None:
    snapshot = _snapshot()
    again = pickle.loads(pickle.dumps(snapshot))
    again.check(_ORIGIN, size=2, step_limit=np.inf)
    np.testing.assert_array_equal(again.physics["state"], snapshot.physics["state"])
