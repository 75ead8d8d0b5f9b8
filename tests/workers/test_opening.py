"""Workers of all kinds behind one interface."""

import concurrent.futures
import sys
from typing import Any

import pytest

from limberjack.workers import Unit, WorkError, open_workers, prepare

from .playing import TASK, pid, seeds_of


def test_without_any_number_this_process_plays_unit_after_unit() -> None:
    setup = prepare(*TASK, "random")
    units = [Unit(setup, (seed,)) for seed in (3, 1, 2)]
    with open_workers() as workers:
        assert list(workers.results(seeds_of, units)) == [(unit, unit.seeds) for unit in units]


def test_an_error_in_this_process_is_raised_as_it_is() -> None:
    def wrong(setup: object, seeds: object) -> None:
        raise KeyError("mine")

    with open_workers() as workers, pytest.raises(KeyError, match="mine"):
        list(workers.results(wrong, [Unit(prepare(*TASK, "random"), (0,))]))


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
