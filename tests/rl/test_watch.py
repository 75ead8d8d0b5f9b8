"""Changes that the hooks of a task make to the task, its physics and their classes."""

import collections
import functools
import os
import random
import signal
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack import mujoco
from limberjack.rl.watch import MEASUREMENT, QuickWatch, Watch, measurements_of

from . import odd_environments as odd


class _Held:
    def __init__(self) -> None:
        self.inside: Any = [1]


class _Task(odd.Pole):
    of_class: Any = None

    def __init__(self) -> None:
        super().__init__(random=0)
        self.number = 1
        self.array = np.zeros(3)
        self.objects = np.array([[1], None], object)
        self.queue = collections.deque([1])
        self.table: dict[Any, Any] = {"a": {"b": [1]}}
        self.some = {1}
        self.stream = np.random.RandomState(0)
        self.generator = np.random.default_rng(0)
        self.python = random.Random(0)
        self.held = _Held()
        self.partial = functools.partial(print, [1])
        self.function = _counter()
        self.numbers = (number for number in range(9))
        self.not_a_number = float("nan")

    @functools.cached_property
    def slow(self) -> int:
        return 3

    @property
    def double(self) -> int:
        return self.number

    @double.setter
    def double(self, value: int) -> None:
        self.number = value // 2


def _counter() -> Callable[[], int]:
    count = [0]

    def counted() -> int:
        count[0] += 1
        return count[0]

    return counted


def _assign(name: str, value: Any) -> Callable[[Any, Any], None]:
    return lambda task, physics: setattr(task, name, value)


def _watched() -> tuple[Any, Any]:
    return _Task(), odd.OddPhysics.from_xml_string(odd.POLE)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda task, physics: setattr(task, "number", 1), "self.number"),
        (lambda task, physics: setattr(task, "more", 1), "self.more"),
        (lambda task, physics: setattr(task, "double", 2), "self.double"),
        (lambda task, physics: delattr(task, "number"), "self.number"),
        (lambda task, physics: task.__dict__.update(number=2), "self.number"),
        (lambda task, physics: object.__setattr__(task, "number", 5), "self.number"),
        (lambda task, physics: task.array.__setitem__(0, 1.0), "self.array"),
        (lambda task, physics: task.array.__setitem__(0, -0.0), "self.array"),
        (lambda task, physics: task.objects[0].append(2), "self.objects"),
        (lambda task, physics: task.queue.append(2), "self.queue"),
        (lambda task, physics: task.table["a"]["b"].append(2), "self.table"),
        (lambda task, physics: task.some.add(2), "self.some"),
        (lambda task, physics: task.stream.uniform(), "self.stream"),
        (lambda task, physics: task.generator.uniform(), "self.generator"),
        (lambda task, physics: task.python.random(), "self.python"),
        (lambda task, physics: setattr(task.held, "inside", 2), "self.held"),
        (lambda task, physics: task.held.inside.append(2), "self.held"),
        (lambda task, physics: task.partial.args[0].append(2), "self.partial"),
        (lambda task, physics: task.function(), "self.function"),
        (lambda task, physics: next(task.numbers), "self.numbers"),
        (lambda task, physics: setattr(_Task, "of_class", object()), "_Task.of_class"),
        (lambda task, physics: setattr(physics, "total", 0.0), "physics.total"),
        (lambda task, physics: physics.measured(), "physics.total"),
    ],
)
def test_a_change_is_noticed_by_name(change: Any, name: str) -> None:
    task, physics = _watched()
    with Watch(task, physics) as watch:
        change(task, physics)
        assert name in watch.changed()
        assert watch.changed() == []


@pytest.mark.parametrize(
    "use",
    [
        lambda task, physics: task.slow,
        lambda task, physics: task.get_observation(physics),
        lambda task, physics: task.before_step(np.zeros(1), physics),
        lambda task, physics: task.random.uniform(),
        lambda task, physics: physics.step(),
        lambda task, physics: physics.named.data.qpos["hinge"],
        lambda task, physics: setattr(_Task(), "number", 3),
        lambda task, physics: [task.number, task.not_a_number, list(task.table)],
    ],
)
def test_what_changes_nothing_goes_unnoticed(use: Any) -> None:
    task, physics = _watched()
    with Watch(task, physics) as watch:
        use(task, physics)
        assert watch.changed() == []


def test_classes_are_as_they_were_afterwards_even_after_an_error() -> None:
    task, physics = _watched()
    before = _Task.__setattr__, odd.OddPhysics.__setattr__
    with pytest.raises(ZeroDivisionError), Watch(task, physics):
        raise ZeroDivisionError
    assert (_Task.__setattr__, odd.OddPhysics.__setattr__) == before
    assert "__setattr__" not in vars(_Task)


class _Assigning(odd.Pole):
    seen = 0

    def __setattr__(self, name: str, value: object) -> None:
        type(self).seen += 1
        super().__setattr__(name, value)


def test_a_class_that_assigns_in_its_own_way_still_does() -> None:
    task, physics = _Assigning(random=0), odd.OddPhysics.from_xml_string(odd.POLE)
    own = vars(_Assigning)["__setattr__"]
    with Watch(task, physics) as watch:
        seen = _Assigning.seen
        task.number = 1  # pyright: ignore[reportAttributeAccessIssue]
        assert _Assigning.seen == seen + 1
        assert "self.number" in watch.changed()
    assert vars(_Assigning)["__setattr__"] is own


def test_a_slot_is_watched() -> None:
    task, physics = odd.Slotted(random=0), odd.OddPhysics.from_xml_string(odd.POLE)
    with Watch(task, physics) as watch:
        task.before_step(np.zeros(1), physics)
        assert watch.changed() == ["self.count"]


def test_values_that_refer_to_each_other_end_the_comparison() -> None:
    task, physics = _watched()
    task.table["self"] = [task.table, task, physics]
    with Watch(task, physics) as watch:
        assert watch.changed() == []
        task.table["a"]["b"].append(1)
        assert watch.changed() == ["self.table"]


def test_attributes_of_a_class_may_be_exchanged_for_others() -> None:
    class Changing(_Task):
        one = 1

        def helper(self) -> None: ...

    task, (_, physics) = Changing(), _watched()
    with Watch(task, physics) as watch:
        del Changing.one
        Changing.other = 2  # pyright: ignore[reportAttributeAccessIssue]
        assert watch.changed() == ["Changing.one", "Changing.other"]
        Changing.helper = 3  # pyright: ignore[reportAttributeAccessIssue]
        assert watch.changed() == ["Changing.helper"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_process_that_is_forked_while_another_thread_watches_can_watch() -> None:
    watching, done = threading.Event(), threading.Event()

    def watch() -> None:
        with Watch(*_watched()):
            watching.set()
            done.wait()

    thread = threading.Thread(target=watch)
    thread.start()
    watching.wait()
    child = os.fork()
    if child == 0:
        signal.alarm(10)  # ends it if it waits for ever
        with Watch(*_watched()) as one:
            os._exit(len(one.changed()))
    _, status = os.waitpid(child, 0)
    done.set()
    thread.join()
    assert status == 0


def test_two_threads_watch_one_after_the_other() -> None:
    found: list[list[str]] = []

    def watching() -> None:
        task, physics = _watched()
        with Watch(task, physics) as watch:
            task.number = 3
            found.append(watch.changed())

    threads = [threading.Thread(target=watching) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [["self.number"]] * 4
    assert "__setattr__" not in vars(_Task)


class _Watched:
    """Has attributes of several kinds."""

    def __init__(self) -> None:
        self.number = 0.5
        self.items: list[object] = [1]
        self.table: dict[str, object] = {"a": 1}
        self.array = np.zeros(3)
        self.large = np.zeros(10**5)
        self.last = 0

    @functools.cached_property
    def derived(self) -> float:
        """Not a change."""
        return 2.0


_QUICK: list[tuple[Callable[[Any], object], list[str]]] = [
    (lambda one: None, []),
    (lambda one: one.derived, []),
    (lambda one: setattr(one, "last", 5), []),
    (lambda one: setattr(one, "number", 0.5 + 0 * len(one.items)), []),  # equal, another object
    (lambda one: setattr(one, "number", 0.25), ["self.number"]),
    (lambda one: setattr(one, "more", 1), ["self.more"]),
    (lambda one: delattr(one, "number"), ["self.number"]),
    (lambda one: setattr(one, "items", [1]), ["self.items"]),
    (lambda one: one.items.append(2), ["self.items"]),
    (lambda one: one.items.__setitem__(0, 2), ["self.items"]),
    (lambda one: one.table.update(b=1), ["self.table"]),
    (lambda one: one.array.fill(1), ["self.array"]),
    (lambda one: setattr(one, "array", one.array.copy()), ["self.array"]),
    (lambda one: (one.items.pop(), setattr(one, "number", 3.0)), ["self.items", "self.number"]),
]


@pytest.mark.parametrize(("change", "names"), _QUICK)
def test_a_quick_look_finds_other_objects_and_other_elements(
    change: Callable[[Any], object], names: list[str]
) -> None:
    one = _Watched()
    watch = QuickWatch("self", one, ["last"])
    watch.look()
    assert watch.changed() == []
    change(one)
    assert watch.changed() == names
    watch.look()  # from now on that is as it was
    assert watch.changed() == []


_BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


class _Physics(mujoco.Physics):
    def height(self) -> Any:
        return self.data.qpos[2]

    def twice(self, factor: float = 2) -> Any:
        return factor * self.height()

    def live(self) -> Any:
        return self.data.qpos

    def names(self) -> list[str]:
        return ["ball"]

    @staticmethod
    def is_static() -> bool:
        return True

    def velocity(self) -> Any:
        return super().velocity()


def test_numbers_and_arrays_are_recorded_in_the_order_of_the_calls() -> None:
    physics = _Physics.from_xml_string(_BALL)
    measured = measurements_of(physics)
    physics.data.qpos[2] = 0.5
    assert physics.twice(factor=3) == 1.5
    assert physics.is_static()
    assert physics.names() == ["ball"]
    physics.velocity()  # of every physics
    assert [(name, value.item()) for name, value in measured.items()] == [
        ("physics.height()", 0.5),
        ("physics.twice()", 1.5),
        ("physics.is_static()", True),
    ]
    assert all(name.startswith(MEASUREMENT) for name in measured)


def test_each_call_is_recorded_with_a_copy() -> None:
    physics = _Physics.from_xml_string(_BALL)
    measured = measurements_of(physics)
    for height in (1.0, 2.0):
        physics.data.qpos[2] = height
        physics.live()
    heights = {name: value[2] for name, value in measured.items()}
    assert heights == {"physics.live()": 1.0, "physics.live(), call 2,": 2.0}
    measured.clear()
    physics.live()
    assert list(measured) == ["physics.live()"]


def test_another_physics_is_not_recorded() -> None:
    physics, other = (_Physics.from_xml_string(_BALL) for _ in range(2))
    measured = measurements_of(physics)
    np.testing.assert_array_equal(other.live()[:3], 0)
    assert not measured
