"""The number of threads, and threads that do a job for each row."""

import copy
import pickle
import signal
import threading
import time

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import threads
from limberjack.rl.threads import RowThreads, interrupts
from limberjack.utils.cores import usable_cores


def test_the_users_number_is_taken_up_to_one_for_each_row() -> None:
    env = suite.load("humanoid", "stand")
    assert threads.threads_for(3, 8, env) == 3
    assert threads.threads_for(3, 2, env) == 2
    with pytest.raises(ValueError, match="num_threads is 0; expected a whole number of at least 1"):
        threads.threads_for(0, 8, env)


def test_by_default_the_work_of_a_step_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    env = suite.load("humanoid", "stand")
    monkeypatch.setattr(threads, "usable_cores", lambda: 8)
    monkeypatch.setattr(threads, "_microseconds_per_step", lambda environment: 10.0)
    monkeypatch.setattr(threads, "_WORTH_A_THREAD", 100.0)
    chosen = [threads.threads_for(None, rows, env) for rows in (1, 10, 20, 45, 80, 10**6)]
    assert chosen == [1, 1, 2, 4, 8, 8]


def test_a_step_of_the_humanoid_is_worth_all_cores() -> None:
    env = suite.load("humanoid", "stand")
    assert threads.threads_for(None, 10**6, env) == usable_cores()
    assert threads.threads_for(None, 1, env) == 1


def test_the_work_is_measured_on_another_simulation() -> None:
    env = suite.load("humanoid", "walk", {"random": 0})
    env.reset()
    before = env.physics.get_state().copy()
    assert threads._microseconds_per_step(env) > 0
    assert (env.physics.get_state() == before).all()


def test_an_environment_that_has_diverged_is_measured_too() -> None:
    env = suite.load("humanoid", "walk", {"random": 0})
    env.reset()
    env.physics.data.qvel[:] = float("nan")
    assert threads._microseconds_per_step(env) > 0


def test_every_row_is_tried_once_and_keeps_its_thread() -> None:
    threads = RowThreads(num_rows=7, num_threads=3)
    seen: list[dict[int, int]] = []
    for rows in (None, None, [0, 3, 6], [5]):
        here: dict[int, int] = {}
        assert (
            threads.each(lambda row, here=here: here.update({row: threading.get_ident()}), rows)
            == []
        )
        assert sorted(here) == (list(range(7)) if rows is None else rows)
        seen.append(here)
    for here in seen[1:]:
        assert here.items() <= seen[0].items()
    assert len(set(seen[0].values())) == 3
    threads.close()


def test_one_thread_is_the_callers_in_order() -> None:
    seen: list[tuple[int, int]] = []
    RowThreads(4, 1).each(lambda row: seen.append((row, threading.get_ident())))
    assert seen == [(row, threading.get_ident()) for row in range(4)]


@pytest.mark.parametrize("num_threads", [1, 2])
def test_errors_come_with_their_rows_and_other_rows_are_done(num_threads: int) -> None:
    done: list[int] = []

    def job(row: int) -> None:
        if row in (1, 4):
            raise ValueError(row)
        done.append(row)

    errors = RowThreads(6, num_threads).each(job)
    assert sorted((row, str(error)) for row, error in errors) == [(1, "1"), (4, "4")]
    assert sorted(done) == [0, 2, 3, 5]


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_an_interrupt_ends_the_share_of_its_thread_only(error: type[BaseException]) -> None:
    done: list[int] = []

    def job(row: int) -> None:
        if row == 0:
            raise error
        done.append(row)

    errors = RowThreads(4, 2).each(job)
    assert [(row, type(one)) for row, one in errors] == [(0, error)]
    assert done == [2, 3]


@pytest.mark.parametrize("num_threads", [1, 2])
def test_threads_run_in_the_context_of_the_caller(num_threads: int) -> None:
    threads = RowThreads(2, num_threads)
    zero = np.zeros(1)
    for under, count in (("raise", 2), ("ignore", 0), ("raise", 2)):
        with np.errstate(divide=under):  # pyright: ignore[reportArgumentType]
            assert len(threads.each(lambda row: 1 / zero)) == count


def test_an_interrupt_of_the_caller_waits_for_all_threads() -> None:
    threads = RowThreads(2, 2)
    done: list[int] = []

    def job(row: int) -> None:
        if row == 0:  # the caller waits, and wakes up for a signal of its own only
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        time.sleep(0.2 * (1 + row))
        done.append(row)

    with pytest.raises(KeyboardInterrupt):
        threads.each(job)
    assert sorted(done) == [0, 1]
    assert threads.each(done.append) == []
    assert len(done) == 4


def test_copies_and_closed_threads_start_again() -> None:
    threads = RowThreads(3, 2)
    threads.each(lambda row: None)
    for one in (copy.deepcopy(threads), pickle.loads(pickle.dumps(threads))):
        done: list[int] = []
        one.each(done.append)
        assert sorted(done) == [0, 1, 2]
        one.close()
    threads.close()
    threads.close()
    done = []
    threads.each(done.append)
    assert sorted(done) == [0, 1, 2]


def test_no_rows_need_no_thread() -> None:
    assert RowThreads(3, 2).each(lambda row: 1 / 0, []) == []


@pytest.mark.parametrize("num_threads", [1, 2, 3])
def test_shared_rows_are_each_tried_once_by_as_many_threads_as_asked_for(num_threads: int) -> None:
    threads = RowThreads(12, 3)
    meet = threading.Barrier(num_threads, timeout=10)
    seen: dict[int, int] = {}

    def job(row: int) -> None:
        if threading.get_ident() not in seen.values():
            seen[row] = threading.get_ident()
            meet.wait()
        seen[row] = threading.get_ident()
        if row in (1, 5):
            raise ValueError(row)

    errors = threads.share(job, [0, 1, 2, 5, 6, 11], num_threads)
    assert sorted((row, str(error)) for row, error in errors) == [(1, "1"), (5, "5")]
    assert sorted(seen) == [0, 1, 2, 5, 6, 11]
    assert threading.get_ident() in seen.values()
    assert len(set(seen.values())) == num_threads


def test_an_interrupt_in_the_callers_share_is_returned_when_all_threads_are_done() -> None:
    done: list[int] = []
    caller = threading.get_ident()

    def job(row: int) -> None:
        if threading.get_ident() == caller:
            signal.raise_signal(signal.SIGINT)
        time.sleep(0.05)
        done.append(row)

    errors = RowThreads(4, 2).share(job, range(4), 2)
    assert [type(error) for _, error in errors] == [KeyboardInterrupt]
    assert interrupts(errors)
    assert sorted([*done, errors[0][0]]) == [0, 1, 2, 3]


def test_only_what_is_no_exception_interrupts() -> None:
    assert not interrupts([])
    assert not interrupts([(0, ValueError())])
    assert interrupts([(0, ValueError()), (1, SystemExit())])
