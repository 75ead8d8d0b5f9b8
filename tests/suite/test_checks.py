"""Validation of a domain's module, with all problems in one message."""

from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest

from limberjack.registry import Row
from limberjack.rl import control
from limberjack.suite import _checks, base, humanoid
from limberjack.utils import containers


def _module(*factories: Callable[..., object], **attributes: object) -> ModuleType:
    """A module with these factories as its tasks."""
    module = ModuleType("made")
    tasks = containers.TaggedTasks()
    for factory in factories:
        tasks.add()(factory)
    vars(module).update(attributes, SUITE=tasks)
    return module


# Any: keyword arguments of the factories of the suite.
def good(**kwargs: Any) -> control.Environment:
    return humanoid.stand(**kwargs)


def _with(**attributes: object) -> Callable[..., object]:
    """A factory whose task has these attributes."""

    def odd(**kwargs: Any) -> control.Environment:
        env = humanoid.stand(**kwargs)
        vars(env.task).update(attributes)
        return env

    return odd


def test_the_rows_have_the_tags_the_length_and_the_degrees_of_freedom_of_each_task() -> None:
    module = _module(good)

    def short(time_limit=1, random=None, environment_kwargs=None):
        return humanoid.stand(time_limit, random, environment_kwargs=environment_kwargs)

    def endless(random: Any = None, **kwargs: Any) -> control.Environment:
        return humanoid.stand(float("inf"), random, **kwargs)

    module.SUITE.add("easy", "mine")(short)
    module.SUITE.add("mine")(endless)
    assert _checks.rows_of("body", module) == (
        Row("body", "good", (), 1000, 27),
        Row("body", "short", ("easy", "mine"), 40, 27),
        Row("body", "endless", ("mine",), None, 27),
    )


def test_the_modules_of_the_suite_pass() -> None:
    rows = _checks.rows_of("humanoid", humanoid)
    assert [row.task for row in rows] == list(humanoid.SUITE)


def test_everything_that_is_wrong_is_in_one_numbered_message() -> None:
    def takes_nothing() -> None: ...

    def fails(**kwargs: object) -> None:
        raise KeyError("no model")

    def returns_nothing(**kwargs: object) -> None: ...

    broken = _module(takes_nothing, fails, good, returns_nothing, PICTURES={"none": 3})
    with pytest.raises(ValueError, match="domain 'my-broken', module made, cannot be") as error:
        _checks.rows_of("my-broken", broken)
    for part in (
        ": (1) the name 'my-broken' is not a Python identifier; (2) ",
        "PICTURES has a task 'none', SUITE has not",
        "PICTURES['none'] is 3; expected a limberjack.suite.base.Picture",
        "factory takes_nothing does not accept time_limit, random, environment_kwargs",
        "factory fails raises KeyError: 'no model'",
        "(6) factory returns_nothing returns a NoneType; expected a control.Environment, or "
        "another dm_env.Environment",
    ):
        assert part in str(error.value)
    assert "good" not in str(error.value)


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"GOAL": "high"}, "GOAL = 'high'; expected a tuple of names"),
        ({"STARTS": ("one", 2)}, r"STARTS = \('one', 2\); expected a tuple of names"),
        ({"EPISODE_FIELDS": ["body_pos"]}, r"EPISODE_FIELDS = \['body_pos'\]; expected a tuple"),
        ({"planner_cost": "no_colon"}, "planner_cost = 'no_colon'; expected 'module:Class'"),
        ({"planner_cost": humanoid}, "planner_cost = <module .*; expected 'module:Class'"),
    ],
)
def test_attributes_of_a_task_that_other_modules_read_are_checked(
    attributes: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=f"the task of odd has {message}"):
        _checks.rows_of("body", _module(_with(**attributes)))


def test_a_cost_with_a_module_and_a_class_is_accepted() -> None:
    (row,) = _checks.rows_of("body", _module(_with(planner_cost="my_package.cost:Cost")))
    assert row.task == "odd"


@pytest.mark.parametrize("keyword", ["time_limit", "random", "environment_kwargs"])
def test_a_keyword_that_a_factory_does_not_take_is_named(keyword: str) -> None:
    factories: dict[str, Callable[..., object]] = {
        "time_limit": lambda random=None, environment_kwargs=None: None,
        "random": lambda time_limit=1, environment_kwargs=None: None,
        "environment_kwargs": lambda time_limit=1, random=None: None,
    }
    lacking = factories[keyword]
    lacking.__name__ = "lacking"
    with pytest.raises(ValueError, match=f"factory lacking does not accept {keyword}$"):
        _checks.rows_of("body", _module(lacking))


def test_pictures_may_be_given_for_some_tasks_as_a_mapping_only() -> None:
    assert _checks.rows_of("body", _module(good, PICTURES={"good": base.Picture(camera="side")}))
    with pytest.raises(ValueError, match=r"PICTURES is \[\]; expected a base\.Picture for each"):
        _checks.rows_of("body", _module(good, PICTURES=[]))


@pytest.mark.parametrize(
    ("tasks", "message"),
    [
        (None, "SUITE is missing; expected a limberjack.utils.containers.TaggedTasks"),
        ({}, "SUITE is {}; expected a limberjack.utils.containers.TaggedTasks"),
        (containers.TaggedTasks(), "SUITE has no tasks; decorate each factory"),
    ],
    ids=repr,
)
def test_a_module_without_tasks_is_refused(tasks: object, message: str) -> None:
    module = ModuleType("empty")
    if tasks is not None:
        module.SUITE = tasks  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match=message):
        _checks.rows_of("empty", module)


def test_a_task_that_no_id_can_name_is_refused() -> None:
    module = ModuleType("made")
    tasks = containers.TaggedTasks()
    factory: Callable[..., object] = lambda **kwargs: good(**kwargs)  # noqa: E731
    factory.__name__ = "no-name"
    tasks.add()(factory)
    module.SUITE = tasks  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match="the task name 'no-name' is not a Python identifier"):
        _checks.rows_of("body", module)
