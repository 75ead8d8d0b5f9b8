"""Values that are compared at a later time, or with those of another environment."""

import dataclasses
import enum
import functools
import itertools
from typing import Any

import numpy as np
import pytest

from limberjack.rl.frozen import Alike, Frozen


def test_iterators_and_buffers_are_compared_by_their_place_and_content() -> None:
    for make, change in (
        (lambda: iter([1, 2, 3]), next),
        (lambda: itertools.cycle([1, 2]), next),
        (lambda: itertools.chain([1], [2]), next),
        (lambda: enumerate([1, 2]), next),
        (lambda: bytearray(2), lambda value: value.append(1)),
    ):
        value: Any = make()
        before = Frozen()(value)
        change(value)
        assert Frozen()(value) != before
    value = iter([1, 2, 3])
    assert Frozen()(value) == Frozen()(value)


@dataclasses.dataclass
class _Goal:
    angle: float


class _Side(enum.Enum):
    LEFT = 1
    RIGHT = 2


def _alike(value: object, own: object = None) -> object:
    return Alike(type, {id(own)})(value)


@pytest.mark.parametrize(
    ("make", "one", "other"),
    [
        (_Goal, 1.0, 2.0),
        (lambda angle: {angle}, 1.0, 2.0),
        (lambda angle: {"angle": [angle]}, 1.0, 2.0),
        (lambda angle: functools.partial(np.add, angle), 1.0, 2.0),
        (lambda angle: lambda: angle, 1.0, 2.0),
        (lambda angle: lambda turned=angle: turned, 1.0, 2.0),
        (lambda number: _Side(number), 1, 2),
        (lambda angle: np.array([_Goal(angle)], object), 1.0, 2.0),
        (np.float32, 1.0, 2.0),
    ],
)
def test_objects_are_alike_if_their_parts_are(make: Any, one: Any, other: Any) -> None:
    assert _alike(make(one)) == _alike(make(one))
    assert _alike(make(one)) != _alike(make(other))


def test_streams_and_parts_of_an_environment_are_alike_whatever_they_hold() -> None:
    assert _alike(np.random.RandomState(0)) == _alike(np.random.RandomState(1))
    mine, yours = _Goal(1.0), _Goal(2.0)
    assert _alike([mine], mine) == _alike([yours], yours)


def test_values_that_contain_themselves_are_compared() -> None:
    value: list[object] = [1]
    value.append(value)
    assert Frozen()(value) == Frozen()(value)
