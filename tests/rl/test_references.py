"""References of objects, and the state that functions keep."""

import functools
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack.rl import references

from . import odd_environments as odd


class _Slots:
    __slots__ = ("held",)

    def __init__(self, held: Any) -> None:
        self.held = held


@pytest.mark.parametrize(
    "hide",
    [
        lambda it: [({"a": it},)],
        lambda it: {it: 1},
        lambda it: np.array([it, None], object),
        lambda it: functools.partial(print, it),
        lambda it: functools.partial(print, end=it),
        _Slots,
        lambda it: itertools.chain([it]),
        lambda it: [it].append,
        lambda it: lambda: it,
        lambda it: lambda given=it: given,
    ],
)
def test_an_object_is_found_wherever_it_is_hidden(hide: Any) -> None:
    it = frozenset({"it"}), object()
    assert references.reaches(hide(it), {id(it)})
    assert not references.reaches(hide(object()), {id(it)})


def test_paths_name_the_attribute_and_the_key() -> None:
    env = odd.environment(odd.Queues, 0)
    held = object()
    env.task.means["held"] = [held]
    paths = {id(value): path for path, value in references.reachable(env)}
    assert paths[id(held)] == "_task.means['held']"


def test_objects_that_refer_to_each_other_end_the_search() -> None:
    one: list[Any] = []
    other = {"one": one}
    one.append(other)
    assert len(list(references.reachable(one))) == 2
    assert not references.reaches(lambda: one, {1})


def test_only_functions_with_something_to_change_keep_something() -> None:
    numbers, constant, text = [1], np.ones(2), ("a", 1.0)
    assert references.kept_by(lambda: constant[0]) is None
    assert references.kept_by(lambda: text) is None
    assert references.kept_by(functools.partial(np.clip, a_min=0.0)) is None
    assert references.kept_by(np.add) is None
    assert references.kept_by(len) is None
    assert references.kept_by(lambda: numbers) == "a list"
    assert references.kept_by(lambda: numbers, {id(numbers)}) is None
    assert references.kept_by(functools.partial(print, numbers)) == "a list"
    assert references.kept_by(numbers.append) == "a list"
    assert references.kept_by(lambda given=numbers: given) == "a list"


def test_live_memory_is_told_from_copies() -> None:
    physics = odd.environment(odd.Pole, 0).physics
    for value in (physics.data.qpos, physics.data.qpos[:1], physics.model.body_mass.T):
        assert references.is_live(value)
    for value in (physics.named.data.qpos, physics.model.opt):
        assert references.is_live(value)
    for value in (physics.data.qpos.copy(), np.ones(3)[1:], physics, physics.data, None):
        assert not references.is_live(value)


def test_an_assignment_to_a_class_or_a_base_is_noticed() -> None:
    class Base:
        array = np.zeros(2)

        def act(self) -> int:
            return 1

    class Derived(Base):
        pass

    changes: list[Callable[[], None]] = [
        lambda: setattr(Base, "act", lambda self: 2),
        lambda: setattr(Base, "array", np.zeros(2)),
        lambda: setattr(Derived, "act", Base.act),
        lambda: delattr(Derived, "act"),
    ]
    for change in changes:
        assigned = references.Assigned(Derived)
        assert assigned.is_same()
        change()
        assert not assigned.is_same()
