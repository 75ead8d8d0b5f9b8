"""Named sets of tasks."""

from typing import Any

import pytest

from limberjack import suite
from limberjack.evaluation import published
from limberjack.registry import sets
from tests import plain_domain

_PAPERS = "dmc28", "dmc-hard", "dmc-sparse"


@pytest.mark.parametrize("name", sets.names())
def test_every_task_of_a_set_is_in_the_suite_once(name: str) -> None:
    found = sets.find(name)
    assert found.name == name
    assert found.source
    assert len(set(found.tasks)) == len(found.tasks) > 0
    others = set(found.tasks) - set(suite.ALL_TASKS)
    assert len(others) == (11 if name == "mt30" else 0)  # which files of TD-MPC2 add


def test_the_thirty_tasks_of_tdmpc2_are_19_of_the_suite_and_11_of_its_domains() -> None:
    tasks = sets.tasks_of("mt30")
    assert len(tasks) == 30
    assert set(tasks[:19]) <= set(sets.tasks_of("dmc28"))
    assert {domain for domain, _ in tasks[19:]} <= set(suite.TASKS_BY_DOMAIN)


def test_the_six_tasks_of_dmcgb2_are_of_the_suites_benchmark() -> None:
    tasks = sets.tasks_of("dmcgb2")
    assert len(tasks) == 6
    assert set(tasks) <= set(suite.BENCHMARKING)
    assert {domain for domain, _ in tasks} == {
        *("walker", "cheetah", "finger", "cartpole", "ball_in_cup")
    }


def test_the_tasks_of_the_real_worlds_challenges_are_four() -> None:
    walks = {(domain, "walk") for domain in ("humanoid", "quadruped", "walker")}
    assert set(sets.tasks_of("rwrl")) == {("cartpole", "swingup"), *walks}


def test_the_sets_of_papers_have_their_sizes_and_the_order_of_the_suite() -> None:
    assert [len(sets.tasks_of(name)) for name in _PAPERS] == [28, 7, 8]
    for name in _PAPERS:
        tasks = sets.tasks_of(name)
        assert list(tasks) == sorted(tasks, key=suite.ALL_TASKS.index)


def test_the_hard_and_the_sparse_tasks_of_papers_are_among_the_28() -> None:
    dmc28, hard, sparse = map(set, map(sets.tasks_of, _PAPERS))
    assert hard < dmc28
    assert sparse < dmc28 - hard
    assert {domain for domain, _ in hard} == {"dog", "humanoid"}


@pytest.mark.parametrize("source", ["tdmpc2", "simbav2", "mrq", "bro"])
def test_the_28_tasks_are_those_that_papers_report(source: str) -> None:
    reported = {
        (score.domain, score.task)
        for score in published.scores()
        if score.source.name == source and score.steps == 1_000_000
    }
    assert reported == set(sets.tasks_of("dmc28"))


def test_tags_are_those_of_the_suite() -> None:
    def same() -> None:
        assert sets.tasks_of("all") == suite.ALL_TASKS
        assert sets.tasks_of("benchmarking") == suite.BENCHMARKING
        assert sets.tasks_of("extra") == suite.EXTRA
        assert sets.tasks_of("easy") == suite.EASY
        assert sets.tasks_of("hard") == suite.HARD

    same()
    suite.register("swing", plain_domain)
    try:
        assert sets.tasks_of("all")[-1][0] == "swing"
        same()
    finally:
        suite.unregister("swing")


def test_an_unknown_set_is_refused_with_a_close_name() -> None:
    with pytest.raises(ValueError, match=r"no set of tasks 'dmc-28'; .*Did you mean 'dmc28'\?"):
        sets.find("dmc-28")


def test_names_pairs_and_sets_are_tasks() -> None:
    expected = (("cheetah", "run"), ("walker", "walk"))
    assert sets.tasks_of(["cheetah:run", "walker:walk"]) == expected
    assert sets.tasks_of(expected) == expected
    assert sets.tasks_of([*map(list, expected)]) == expected  # pyright: ignore[reportArgumentType]
    assert sets.tasks_of("cheetah:run, walker:walk") == expected
    assert sets.find(["cheetah:run", "walker:walk"]).name == "cheetah:run,walker:walk"
    own = sets.TaskSet("own", expected, "this test")
    assert sets.find(own) is own


class _OtherError(ValueError):
    pass


def _fail_later(on_progress: Any) -> None:
    with sets.refusals_named("walker", "walk", on_progress) as show:
        show("zero", 3, 0.5)
        raise ValueError("no number")


def test_a_task_is_named_that_is_refused_before_its_first_step() -> None:
    calls: list[tuple[str, int, float]] = []

    def count(*call: Any) -> None:
        calls.append(call)

    with (
        pytest.raises(sets.SetError, match=r"^walker walk: no folder$") as caught,
        sets.refusals_named("walker", "walk", count),
    ):
        raise ValueError("no folder")
    assert type(caught.value.__cause__) is ValueError
    with pytest.raises(_OtherError, match=r"^other$"), sets.refusals_named("walker", "walk", count):
        raise _OtherError("other")
    with pytest.raises(ValueError, match=r"^no number$"):
        _fail_later(count)
    assert calls == [("zero", 3, 0.5)]


@pytest.mark.parametrize(
    ("tasks", "error", "message"),
    [
        ("dmc27", ValueError, r"no set of tasks 'dmc27'.*Did you mean 'dmc28'"),
        ("walker:walk,fish", ValueError, "a task is 'fish'"),
        ([], ValueError, "the list of tasks is empty"),
        (7, TypeError, "tasks are 7; expected"),
        (["walker"], ValueError, "a task is 'walker'; expected a name such as 'walker:walk'"),
        ("walker:walk,fish:swim,walker:walk", ValueError, "has walker:walk twice"),
        (["walker:walk:fast"], ValueError, "a task is 'walker:walk:fast'"),
        ([("walker", 3)], ValueError, r"a task is \('walker', 3\)"),
    ],
)
def test_what_is_no_list_of_tasks_is_refused(
    tasks: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        sets.tasks_of(tasks)
