"""Workers of all kinds behind one interface, and those that are used by default."""

import concurrent.futures
import sys
from collections import deque
from typing import Any

import dm_env
import pytest

from limberjack import policies, suite
from limberjack.evaluation import evaluate
from limberjack.workers import Scale, Setup, Unit, WorkError, open_workers, prepare
from limberjack.workers import scale as module
from limberjack.workers.factories import factory_of
from limberjack.workers.pool import Pool

from .playing import TASK, more_of, pid, seeds_of


@pytest.fixture
def four_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "usable_cores", lambda: 4)


def _setup(scale: Scale, policy: str, episodes: int) -> Setup | None:
    factory = factory_of("manipulator", "bring_ball", 0.1)
    environment = factory.make(0)
    actor = policies.find(policy, environment)
    return scale.setup(factory, environment, actor, policy, episodes)


def _threads(scale: Scale, policy: str, episodes: int) -> int | None:
    setup = _setup(scale, policy, episodes)
    assert setup is not None
    return setup.num_threads


@pytest.mark.usefixtures("four_cores")
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


@pytest.mark.usefixtures("four_cores")
@pytest.mark.parametrize(
    ("scale", "policy", "episodes"),
    [
        (Scale(), "random", 1000),  # batches use all cores
        (Scale(), "planner", 1),
        (Scale(num_threads=2), "planner", 16),
    ],
)
def test_otherwise_this_process_plays(scale: Scale, policy: str, episodes: int) -> None:
    assert _setup(scale, policy, episodes) is None


@pytest.mark.usefixtures("four_cores")
def test_a_setup_that_cannot_be_sent_is_an_error_only_where_workers_were_asked_for() -> None:
    def make(seed: int) -> dm_env.Environment:
        return suite.load("manipulator", "bring_ball", {"random": seed, "time_limit": 0.1})

    factory = factory_of(make)
    environment = factory.make(0)
    actor = policies.find("planner", environment)
    assert Scale().setup(factory, environment, actor, "planner", 16) is None
    with pytest.raises(ValueError, match="cannot be imported by other processes: define make"):
        Scale(workers=2).setup(factory, environment, actor, "planner", 16)


@pytest.mark.usefixtures("four_cores")
@pytest.mark.parametrize("name", ["workers", "num_threads"])
def test_numbers_are_at_least_one(name: str) -> None:
    zero: dict[str, Any] = {name: 0}
    with pytest.raises(ValueError, match=f"{name} is 0; expected a whole number of at least 1"):
        Scale(**zero)
    with pytest.raises(ValueError, match=f"{name} is 0; expected a whole number of at least 1"):
        evaluate(*TASK, **zero)


def test_without_any_number_this_process_plays_unit_after_unit() -> None:
    setup = prepare(*TASK, "random")
    units = [Unit(setup, (seed,)) for seed in (3, 1, 2)]
    with open_workers() as workers:
        assert list(workers.results(seeds_of, units)) == [(unit, unit.seeds) for unit in units]


def test_there_are_no_more_workers_than_episodes() -> None:
    with Scale(workers=10**9).open(2) as workers:
        assert isinstance(workers, Pool)
        assert len(workers._workers) == 2


def test_an_error_in_this_process_is_raised_as_it_is() -> None:
    def wrong(setup: object, seeds: object) -> None:
        raise KeyError("mine")

    with open_workers() as workers, pytest.raises(KeyError, match="mine"):
        list(workers.results(wrong, [Unit(prepare(*TASK, "random"), (0,))]))


@pytest.mark.parametrize("kind", ["here", "processes", "executor"])
def test_a_queue_may_be_added_to_while_its_results_are_read(kind: str) -> None:
    setup = prepare(*TASK, "random")
    units, played = deque([Unit(setup, (0,))]), list[int]()
    with concurrent.futures.ThreadPoolExecutor(1) as executor:
        options: dict[str, Any] = {"processes": {"workers": 1}, "executor": {"executor": executor}}
        with open_workers(**options.get(kind, {})) as workers:
            for unit, seeds in workers.results(seeds_of, units):
                assert seeds == unit.seeds
                played += seeds
                if len(played) < 4:
                    units.append(Unit(setup, range(len(played), len(played) + 1)))
    assert played == [0, 1, 2, 3]


@pytest.mark.parametrize("kind", ["here", "processes", "executor"])
def test_a_function_takes_what_a_unit_has_besides_its_seeds(kind: str) -> None:
    unit = Unit(prepare(*TASK, "random"), range(2), ("more", 3))
    with concurrent.futures.ThreadPoolExecutor(1) as executor:
        options: dict[str, Any] = {"processes": {"workers": 1}, "executor": {"executor": executor}}
        with open_workers(**options.get(kind, {})) as workers:
            assert list(workers.results(more_of, [unit])) == [(unit, ("more", 3))]


def test_a_number_opens_other_processes() -> None:
    units = [Unit(prepare(*TASK, "random"), (0,))]
    with open_workers(1) as workers:
        ((_, other),) = workers.results(pid, units)
    assert other != pid(units[0].setup, (0,))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"workers": 0}, "workers is 0; expected a whole number of at least 1"),
        ({"workers": 1.5}, "workers is 1.5; expected a whole number"),
        ({"executor": object()}, "executor is of type object; expected a concurrent.futures"),
        (
            {"executor": concurrent.futures.ThreadPoolExecutor(1), "ray": "local"},
            "executor and ray are both given; expected one of them",
        ),
    ],
)
def test_arguments_are_checked(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message), open_workers(**arguments):
        pass


def test_without_ray_its_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.delitem(sys.modules, "limberjack.workers.ray_tasks", raising=False)
    message = "ray needs the extra 'ray': pip install ray"
    with pytest.raises(WorkError, match=message), open_workers(ray="local"):
        pass
