"""Keyword arguments in a mapping."""

import collections
from typing import Any

import pytest

from limberjack import gym, suite
from limberjack.utils.keywords import keywords, with_keywords


def test_they_are_a_new_dict() -> None:
    given = collections.OrderedDict(random=0)
    found = keywords("task_kwargs", given)
    found["time_limit"] = 1
    assert list(given) == ["random"]
    assert keywords("task_kwargs", None) == {}


def test_an_object_with_keys_is_accepted() -> None:
    class Config:
        def keys(self) -> list[str]:
            return ["random"]

        def __getitem__(self, name: str) -> int:
            return len(name)

    assert keywords("task_kwargs", Config()) == {"random": 6}  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("bad", ["ab", 5, [1], ["ab", "c"]])
@pytest.mark.parametrize("name", ["task_kwargs", "environment_kwargs", "render_kwargs"])
def test_anything_else_is_refused_by_name(name: str, bad: Any) -> None:
    makers = [gym.load, suite.load] if name != "render_kwargs" else [gym.load]
    for make in makers:
        with pytest.raises(TypeError, match=f"{name} is .*; expected a mapping of keyword"):
            make("pendulum", "swingup", **{name: bad})


def test_a_batch_refuses_them_too() -> None:
    with pytest.raises(TypeError, match="task_kwargs is 5; expected a mapping"):
        suite.load_batch("pendulum", "swingup", 2, task_kwargs=5)  # pyright: ignore[reportArgumentType]


def test_keywords_are_added_unless_they_are_none_or_there_already() -> None:
    given = {"random": 0}
    joined = with_keywords("task_kwargs", given, time_limit=2.0, other=None)
    assert joined == {"random": 0, "time_limit": 2.0}
    assert with_keywords("task_kwargs", given, time_limit=None) == given == {"random": 0}
    assert with_keywords("task_kwargs", None) == {}
    with pytest.raises(
        TypeError, match="random is given twice: once alone and once in task_kwargs"
    ):
        with_keywords("task_kwargs", given, random=1)
