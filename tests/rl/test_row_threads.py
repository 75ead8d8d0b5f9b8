"""Threads of rows: each row keeps its thread, and errors and interrupts wait for all."""

import copy
import pickle
import signal
import threading
import time

import numpy as np
import pytest

from limberjack.rl.row_threads import RowThreads, interrupts


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
