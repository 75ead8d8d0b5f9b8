"""The curves that the package knows are those of the bundled policies' runs."""

import pytest

from limberjack import policies
from limberjack.policies import known_tasks, learning_of

_MILLION = 1_000_000  # control steps


def test_each_bundled_policy_has_curves() -> None:
    assert known_tasks() == [(one.domain, one.task) for one in policies.bundled()]


@pytest.mark.parametrize(("domain", "task"), known_tasks())
def test_curves_begin_with_no_steps_and_end_with_those_of_the_policy(
    domain: str, task: str
) -> None:
    known = learning_of(domain, task)
    (steps,) = (
        one.card.steps for one in policies.bundled() if (one.domain, one.task) == (domain, task)
    )
    assert known.title == f"{domain} {task}"
    assert known.own is None
    assert len(known.runs) >= (1 if steps == _MILLION else 3)  # a run of a million takes an hour
    for run in known.runs:
        assert run.name.startswith("reference run, seed ")
        assert (run.steps[0], run.steps[-1]) == (0, steps)
        assert len(run.steps) == len(run.seconds) == len(run.returns) == 21
        assert (run.steps[1:] > run.steps[:-1]).all()
        assert (run.seconds[1:] > run.seconds[:-1]).all()


def test_the_published_mean_is_named() -> None:
    level, name = learning_of("cartpole", "swingup").published or (0.0, "")
    assert level > 850
    assert name.startswith("published, ")


def test_a_task_without_a_bundled_policy_has_no_curves() -> None:
    known = learning_of("swing", "up")
    assert (known.title, known.runs, known.published) == ("swing up", (), None)
