"""The number of workers and threads that are used by default."""

from typing import Any

import pytest

from limberjack.evaluation import evaluate
from limberjack.workers import Scale
from limberjack.workers import scale as module

from .playing import TASK

_BRING = ("manipulator", "bring_ball")


@pytest.fixture(autouse=True)
def _four_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "usable_cores", lambda: 4)


def _threads(scale: Scale, policy: str, episodes: int) -> int | None:
    setup = scale.setup(*_BRING, policy, 0.1, episodes)
    assert setup is not None
    return setup.num_threads


@pytest.mark.parametrize(
    ("scale", "episodes", "threads"),
    [
        (Scale(), 16, 1),
        (Scale(), 2, 2),  # fewer episodes than cores share them
        (Scale(workers=1), 16, 4),
        (Scale(workers=2), 16, 2),
        (Scale(workers=8), 16, 1),
        (Scale(workers=2, num_threads=3), 16, 3),
        (Scale(ray="local"), 16, 1),
    ],
)
def test_workers_share_the_cores(scale: Scale, episodes: int, threads: int) -> None:
    assert _threads(scale, "planner", episodes) == threads


@pytest.mark.parametrize(
    ("scale", "policy", "episodes"),
    [
        (Scale(), "random", 1000),  # batches use all cores
        (Scale(), "planner", 1),
        (Scale(num_threads=2), "planner", 16),
    ],
)
def test_otherwise_this_process_plays(scale: Scale, policy: str, episodes: int) -> None:
    assert scale.setup(*_BRING, policy, 0.1, episodes) is None


def test_a_setup_that_cannot_be_sent_is_an_error_only_where_workers_were_asked_for() -> None:
    def make(seed: int) -> Any:
        raise AssertionError

    with pytest.raises((ValueError, AssertionError)):
        Scale(workers=2).setup(make, None, "planner", None, 16)


@pytest.mark.parametrize("name", ["workers", "num_threads"])
def test_numbers_are_at_least_one(name: str) -> None:
    zero: dict[str, Any] = {name: 0}
    with pytest.raises(ValueError, match=f"{name} is 0; expected a whole number of at least 1"):
        Scale(**zero)
    with pytest.raises(ValueError, match=f"{name} is 0; expected a whole number of at least 1"):
        evaluate(*TASK, **zero)
