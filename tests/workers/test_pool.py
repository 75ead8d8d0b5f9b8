"""Processes of this machine, and what happens where they die."""

import concurrent.futures
import errno
import functools
import os
import pickle
import queue
import re
import socket
import sys
import threading
import time
from pathlib import Path
from typing import Any, BinaryIO

import pytest

from limberjack.evaluation.experiment import play_unit
from limberjack.workers import Setup, State, Unit, WorkError, prepare, units_of
from limberjack.workers.pool import Pool
from limberjack.workers.process import write_message

from .killing import is_alive, kill_often
from .playing import (
    TASK,
    Unreadable,
    exit_status,
    pid,
    real_time_signal,
    scores_slowly,
    seeds_of,
    unpicklable,
)

_KILLS = 5
_POLICY = "tests.workers.playing:BatchedMemory"


def _units(setup: Setup, seeds: range) -> list[Unit]:
    return [Unit(setup, block) for block in units_of(seeds, setup.unit_size)]


def test_units_are_spread_over_processes_that_end_with_the_pool() -> None:
    setup = prepare(*TASK, "random")
    states: list[State] = []
    with Pool(2, states.append) as pool:
        results = list(pool.results(pid, _units(setup, range(640))))
        assert all(is_alive(number) for _, number in results)
        again = dict(pool.results(pid, _units(setup, range(64))))
    numbers = {number for _, number in results}
    assert os.getpid() not in numbers
    assert set(again.values()) <= numbers  # a worker plays on with what it has opened
    assert len(results) == 10
    assert not any(is_alive(number) for number in numbers)
    assert {state.workers for state in states} == {2}
    assert max(state.playing + state.starting for state in states) >= 1


def test_a_process_is_sent_a_function_and_a_setup_once(monkeypatch: pytest.MonkeyPatch) -> None:
    messages: list[Any] = []

    def writing(stream: BinaryIO, parts: list[bytes]) -> None:
        messages.extend(map(pickle.loads, parts))
        write_message(stream, parts)

    monkeypatch.setattr("limberjack.workers.pool.write_message", writing)
    setups = [prepare(*TASK, policy) for policy in ("random", "zero")]
    with Pool(1) as pool:
        for function in (seeds_of, pid, functools.partial(seeds_of)):
            for setup in (*setups, *setups):
                list(pool.results(function, [Unit(setup, (0,))]))
    assert [len(new) for new, *_ in messages] == [2, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]


def test_results_are_held_back_until_they_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
    monkeypatch.setattr("limberjack.workers.pool._Answers", lambda: answers)
    setup = prepare(*TASK, "random")
    units = iter(_units(setup, range(64 * 100)))
    with Pool(1) as pool:
        results = pool.results(seeds_of, units)
        next(results)
        time.sleep(0.2)
        assert answers.qsize() <= 1


def test_results_that_are_given_up_do_not_reach_later_ones() -> None:
    first, second, third = _units(prepare(*TASK, "random"), range(64 * 3))
    with Pool(1) as pool:
        next(pool.results(seeds_of, [first, second]))  # the worker plays on
        assert list(pool.results(seeds_of, [third])) == [(third, third.seeds)]


def test_results_of_two_functions_may_be_read_in_turn() -> None:
    units = _units(prepare(*TASK, "random"), range(64 * 3))
    with Pool(1) as pool:
        both = zip(pool.results(seeds_of, units), pool.results(pid, units), strict=True)
        found = list(both)
    assert [(unit, seeds) for (unit, seeds), _ in found] == [(unit, unit.seeds) for unit in units]
    assert [unit for _, (unit, _) in found] == units


def test_a_unit_that_ends_its_worker_three_times_ends_the_run_and_nothing_else() -> None:
    setup = prepare(*TASK, "random")
    kept: list[Unit] = []
    with Pool(1) as pool, pytest.raises(WorkError) as caught:
        kept.extend(unit for unit, _ in pool.results(exit_status, _units(setup, range(60, 130))))
    assert str(caught.value) == (
        f"policy 'random', seeds 64 to 127 lost 3 workers on node {socket.gethostname()}, the "
        "last one by exit status 7"
    )
    assert pool._lost == 3
    assert [unit.seeds[0] for unit in kept] == [60]


def test_results_are_the_same_after_workers_were_killed_at_random_moments() -> None:
    setup = prepare(*TASK, _POLICY, time_limit=0.1, num_threads=1)
    units = _units(setup, range(64 * 14))
    done = threading.Event()
    with Pool(2) as pool, concurrent.futures.ThreadPoolExecutor(1) as executor:
        kills = executor.submit(kill_often, pool, done, _KILLS)
        try:
            found = dict(pool.results(scores_slowly, units))
        finally:
            done.set()
        assert kills.result() == _KILLS
        assert pool._lost > _KILLS / 2  # one that is killed between two units is not missed
    assert len(found) == len(units)
    for unit in (units[0], units[7], units[-1]):
        assert found[unit] == play_unit(setup, unit.seeds)


def test_a_policy_that_raises_keyboardinterrupt_is_named_and_not_tried_again() -> None:
    setup = prepare(*TASK, "tests.workers.playing:interrupted")
    states: list[State] = []
    with Pool(1, states.append) as pool, pytest.raises(WorkError) as caught:
        list(pool.results(play_unit, _units(setup, range(3, 5))))
    assert re.fullmatch(
        r"policy 'tests\.workers\.playing:interrupted', seeds 3 to 4: KeyboardInterrupt "
        rf"\(.*playing\.py, line \d+, in interrupted\); on node {socket.gethostname()}",
        str(caught.value),
    )
    assert {state.lost for state in states} == {0}


def test_a_failure_is_not_tried_again() -> None:
    setup = prepare(*TASK, "tests.workers.playing:Unlucky", time_limit=0.2)
    with Pool(1) as pool, pytest.raises(WorkError) as caught:
        list(pool.results(play_unit, _units(setup, range(60, 130))))
    assert re.fullmatch(
        "policy 'tests.workers.playing:Unlucky', step 2 of the episode with seed 64: KeyError: "
        r"'no such\\nthing' \(.*playing\.py, line \d+, in act_batch\); "
        f"on node {socket.gethostname()}",
        str(caught.value),
    )
    assert pool._lost == 0


def test_a_worker_that_cannot_be_started_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "too many processes")

    monkeypatch.setattr("subprocess.Popen", refuse)
    setup = prepare(*TASK, "random")
    with Pool(1) as pool, pytest.raises(WorkError, match=r"too many processes .*; on node "):
        list(pool.results(seeds_of, _units(setup, range(1))))


def test_a_signal_without_a_name_is_an_end_like_any_other() -> None:
    setup = prepare(*TASK, "random")
    with Pool(1) as pool, pytest.raises(WorkError, match=r"the last one by signal 40$"):
        list(pool.results(real_time_signal, _units(setup, range(1))))


def test_neither_entries_of_the_path_that_are_no_texts_nor_stray_modules_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit(5)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*filter(None, sys.path), Path("somewhere")])
    setup = prepare(*TASK, "random")
    with Pool(1) as pool:
        assert [seeds for _, seeds in pool.results(seeds_of, _units(setup, range(1)))] == [(0,)]


def test_what_has_no_pickle_is_one_line() -> None:
    setup = prepare(*TASK, "random")
    for function in (lambda setup, seeds: seeds, unpicklable):
        with Pool(1) as pool, pytest.raises(WorkError, match=r"(?i)pickle.*; on node ") as caught:
            list(pool.results(function, _units(setup, range(1))))
        assert "\n" not in str(caught.value)
        assert pool._lost == 0


def test_what_a_worker_could_not_read_is_sent_to_it_again() -> None:
    setup = prepare(*TASK, "random")
    with Pool(1) as pool:
        for _ in range(2):
            with pytest.raises(WorkError, match="this is of another process"):
                list(pool.results(Unreadable(), _units(setup, range(1))))
        assert list(pool.results(seeds_of, _units(setup, range(1))))


def test_closing_a_pool_ends_units_in_the_middle() -> None:
    setup = prepare(*TASK, "random")
    with Pool(1) as pool:
        (unit,) = _units(setup, range(1))
        pool._workers[0].give(_forever, unit, queue.SimpleQueue())
        while pool._workers[0].state != "playing":
            time.sleep(0.01)
        process: Any = pool._workers[0]._process
        begun = time.monotonic()
    assert not is_alive(process.pid)
    assert time.monotonic() - begun < 5


def _forever(setup: Setup, seeds: tuple[int, ...]) -> None:
    time.sleep(1000)
