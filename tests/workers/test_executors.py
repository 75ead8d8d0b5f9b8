"""Units in executors of `concurrent.futures`."""

import concurrent.futures
import multiprocessing
import threading
import time
from concurrent.futures import Future
from typing import Any

import pytest

from limberjack.workers import State, Unit, WorkError, executors, open_workers, prepare

from .playing import TASK, exit_status, seeds_of


def _units(count: int) -> list[Unit]:
    setup = prepare(*TASK, "random")
    return [Unit(setup, (64 * number,)) for number in range(count)]


def test_all_units_are_played_at_most_two_per_worker_at_a_time() -> None:
    units, running, most = _units(9), set[int](), 0

    class Counting(concurrent.futures.ThreadPoolExecutor):
        def submit(self, *args: Any, **kwargs: Any) -> "Future[Any]":
            nonlocal most
            future = super().submit(*args, **kwargs)
            running.add(id(future))
            most = max(most, len(running))
            future.add_done_callback(lambda _: running.discard(id(future)))
            return future

    states: list[State] = []
    with Counting(2) as executor:
        with open_workers(2, executor=executor, on_state=states.append) as workers:
            found = dict(workers.results(seeds_of, units))
        assert executor.submit(int).result() == 0  # it is the caller's, and not shut down
    assert found == {unit: unit.seeds for unit in units}
    assert most <= 4
    assert {state.workers for state in states} == {2}


def test_a_process_pool_that_breaks_is_one_line() -> None:
    context = multiprocessing.get_context("spawn")
    with (
        concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as executor,
        open_workers(1, executor=executor) as workers,
        pytest.raises(WorkError, match=r"^the executor failed \(BrokenProcessPool: ") as caught,
    ):
        list(workers.results(exit_status, _units(3)))
    assert "\n" not in str(caught.value)


def test_an_executor_that_is_shut_down_is_one_line() -> None:
    executor = concurrent.futures.ThreadPoolExecutor(1)
    executor.shutdown()
    with (
        open_workers(1, executor=executor) as workers,
        pytest.raises(WorkError, match=r"the executor failed .*cannot schedule new futures"),
    ):
        list(workers.results(seeds_of, _units(1)))


def test_what_an_executor_raises_by_itself_is_one_line() -> None:
    class Losing(concurrent.futures.Executor):
        def submit(self, *args: Any, **kwargs: Any) -> "Future[Any]":
            future: Future[Any] = Future()
            future.set_exception(LookupError("worker 3\nis gone"))
            return future

    with (
        open_workers(1, executor=Losing()) as workers,
        pytest.raises(WorkError, match=r"the executor failed \(LookupError: worker 3 is gone\)"),
    ):
        list(workers.results(seeds_of, _units(1)))


def test_jobs_that_can_only_be_asked_whether_they_are_done_are_played(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(executors, "_LOOK", 0.001)

    class Job:  # as submitit's
        def __init__(self, call: Any) -> None:
            self.call, self.looks = call, 0

        def done(self) -> bool:
            self.looks += 1
            return self.looks > 2

        def result(self) -> object:
            return self.call()

    class Submitting:
        def submit(self, function: Any, *args: Any) -> Job:
            return Job(lambda: function(*args))

    units = _units(5)
    executor: Any = Submitting()
    with open_workers(2, executor=executor) as workers:
        assert dict(workers.results(seeds_of, units)) == {unit: unit.seeds for unit in units}


def test_an_executor_that_forks_is_refused() -> None:
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork on this system")
    context = multiprocessing.get_context("fork")
    executor = concurrent.futures.ProcessPoolExecutor(1, mp_context=context)
    message = r"executor forks this process.*get_context\('spawn'\)"
    with pytest.raises(ValueError, match=message), open_workers(1, executor=executor):
        pass


def test_units_that_have_not_begun_are_cancelled_at_the_end() -> None:
    begun: list[tuple[int, ...]] = []
    leave = threading.Event()

    def waiting(setup: object, seeds: tuple[int, ...]) -> tuple[int, ...]:
        begun.append(seeds)
        if len(begun) > 1:
            leave.wait(10)
        return seeds

    with concurrent.futures.ThreadPoolExecutor(1) as executor:
        with open_workers(4, executor=executor) as workers:
            results = iter(workers.results(waiting, _units(6)))
            next(results)  # `results` is kept: collecting it would cancel the units that wait
            while len(begun) < 2:
                time.sleep(0.001)
        leave.set()
    assert len(begun) == 2
