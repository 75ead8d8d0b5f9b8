"""Values of JSON from anyone: what an annotation accepts, and what it becomes."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import pytest

from limberjack.policies.entries import entry_of, shown


@dataclasses.dataclass(frozen=True)
class _Pair:
    one: int
    other: float | None = None


@pytest.mark.parametrize(
    ("kind", "value", "found"),
    [
        (int, 3, 3),
        (float, 3, 3.0),
        (str | None, None, None),
        (tuple[int, ...], [1, 2], (1, 2)),
        (tuple[str, tuple[int, ...]], ["a", []], ("a", ())),
        (Mapping[str, str], {"a": "b"}, {"a": "b"}),
        (Mapping[str, object], {"a": [None]}, {"a": [None]}),
        (_Pair, {"one": 1}, _Pair(1)),
        (tuple[_Pair, ...], [{"one": 1, "other": 2}], (_Pair(1, 2.0),)),
    ],
)
def test_a_value_takes_the_form_of_its_annotation(kind: Any, value: object, found: object) -> None:
    assert entry_of(kind, value) == found
    assert type(entry_of(kind, value)) is type(found)


@pytest.mark.parametrize(
    ("kind", "value", "message"),
    [
        (int, True, "expected a whole number from 0 on"),
        (int, -1, "expected a whole number from 0 on"),
        (int, 1.0, "expected a whole number from 0 on"),
        (float, math.nan, "expected a finite number"),
        (float, -math.inf, "expected a finite number"),
        (float, 10**400, "expected a finite number"),
        (float, False, "expected a finite number"),
        (bool, 1, "expected true or false"),
        (str, None, "expected a text"),
        (str, "x" * 10_001, "expected a text of up to 10000 characters"),
        (tuple[int, ...], "12", "expected a list"),
        (tuple[int, int], [1], "expected a list of 2"),
        (Mapping[str, str], {"a": 1}, "expected a text"),
        (_Pair, [1], "expected an object of JSON"),
        (_Pair, {"other": 1.0}, r"entries \['one'\] are missing or unknown"),
        (_Pair, {"one": 1, "more": 1}, r"entries \['more'\] are missing or unknown"),
        (_Pair, {"one": "x" * 100}, r"one is 'x+\.\.\.; expected a whole number"),
    ],
)
def test_a_value_of_another_form_is_refused(kind: Any, value: object, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        entry_of(kind, value)
    assert len(str(caught.value)) < 200


def test_a_long_value_is_shown_in_part() -> None:
    assert shown("x" * 1000) == "'" + "x" * 76 + "..."
    assert shown([1]) == "[1]"
