"""Tests of limberjack.utils.containers."""

import pytest

from limberjack.utils import containers


def named(name: str):
    def factory() -> str:
        return f"ran {name}"

    factory.__name__ = name
    return factory


def make_tasks() -> containers.TaggedTasks:
    tasks = containers.TaggedTasks()
    tasks.add("easy", "benchmarking")(named("swing"))
    tasks.add("hard", "benchmarking")(named("catch"))
    tasks.add()(named("rest"))
    return tasks


def test_it_is_a_mapping_in_the_order_of_registration() -> None:
    tasks = make_tasks()
    assert list(tasks) == ["swing", "catch", "rest"]
    assert len(tasks) == 3
    assert "catch" in tasks
    assert "nothing" not in tasks
    assert tasks.get("nothing") is None
    assert tasks["catch"]() == "ran catch"


def test_the_decorator_returns_the_factory_itself() -> None:
    factory = named("swing")
    assert containers.TaggedTasks().add("easy")(factory) is factory


def test_tagged_gives_the_tasks_with_all_the_tags_in_order() -> None:
    tasks = make_tasks()
    assert list(tasks.tagged("benchmarking")) == ["swing", "catch"]
    assert list(tasks.tagged("benchmarking", "hard")) == ["catch"]
    assert list(tasks.tagged("hard", "benchmarking")) == ["catch"]
    assert tasks.tagged("easy", "hard") == {}
    assert tasks.tagged("unknown") == {}
    assert tasks.tagged("easy", "unknown") == {}
    assert tasks.tagged() == {}
    assert tasks.tagged("hard")["catch"]() == "ran catch"


def test_tags_are_listed_in_the_order_of_first_use() -> None:
    assert make_tasks().tags() == ["easy", "benchmarking", "hard"]


def test_a_search_for_an_unknown_tag_does_not_make_it() -> None:
    tasks = make_tasks()
    tasks.tagged("unknown")
    assert "unknown" not in tasks.tags()


def test_a_name_is_registered_once() -> None:
    tasks = make_tasks()
    with pytest.raises(ValueError, match="'swing' is already registered"):
        tasks.add("easy")(named("swing"))
    assert tasks["swing"]() == "ran swing"


def test_a_name_may_be_replaced_where_that_is_allowed() -> None:
    tasks = make_tasks()
    tasks.allow_overriding_keys = True
    replacement = tasks.add("hard")(named("swing"))
    assert tasks["swing"] is replacement
    assert tasks.tagged("easy")["swing"] is replacement
    assert list(tasks) == ["swing", "catch", "rest"]


def test_an_unknown_task_is_a_key_error_that_names_the_tasks() -> None:
    with pytest.raises(KeyError, match=r"no task 'swin'.*'rest'.*Did you mean 'swing'\?"):
        make_tasks()["swin"]


def test_the_decorator_without_parentheses_is_refused() -> None:
    tasks = containers.TaggedTasks()
    with pytest.raises(TypeError, match="with parentheses"):
        tasks.add(named("swing"))
    assert len(tasks) == 0


def test_a_tag_may_be_any_key() -> None:
    tasks = make_tasks()
    tasks.add(3, ("a", 1))(named("odd"))
    assert list(tasks.tagged(3)) == list(tasks.tagged(("a", 1), 3)) == ["odd"]
    assert tasks.tags() == ["easy", "benchmarking", "hard", 3, ("a", 1)]
    with pytest.raises(TypeError, match=r"a tag is \['easy'\]; expected a name"):
        tasks.add(["easy"])  # pyright: ignore[reportArgumentType]


def test_repr_shows_the_tasks() -> None:
    assert repr(containers.TaggedTasks()) == "TaggedTasks({})"
    assert "'swing'" in repr(make_tasks())
