"""Environments of one task give the same results in parallel threads as one after the other."""

import os
import sys
import threading
from collections.abc import Iterator
from concurrent import futures
from typing import Any

import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.mujoco.wrapper import sharing
from limberjack.suite import stacker
from tests.laws.episodes import DOMAINS, Task, bits, load, play

_THREADS = 4
_EPISODES = 6


@pytest.fixture
def switching_often() -> Iterator[None]:
    """Makes threads switch as often as possible."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def episodes(task: Task, seed: int) -> list[Any]:
    env = load(task, seed)
    return [play(env, 10, seed) for _ in range(_EPISODES)]


@pytest.mark.parametrize("task", DOMAINS)
def test_parallel_episodes_equal_sequential_ones(task: Task, switching_often: None) -> None:
    expected = [episodes(task, seed) for seed in range(_THREADS)]
    with futures.ThreadPoolExecutor(_THREADS) as pool:
        assert list(pool.map(episodes, [task] * _THREADS, range(_THREADS))) == expected


def test_threads_may_load_a_task_at_the_same_moment(switching_often: None) -> None:
    expected = bits(suite.load("stacker", "stack_2", {"random": 0}).reset())
    barrier = threading.Barrier(_THREADS)

    def load_and_reset(_: int) -> Any:
        barrier.wait()
        return bits(suite.load("stacker", "stack_2", {"random": 0}).reset())

    with futures.ThreadPoolExecutor(_THREADS) as pool:
        for _ in range(3):
            sharing._in_use.clear()
            sharing.drop_unused()
            assert list(pool.map(load_and_reset, range(_THREADS))) == [expected] * _THREADS


def test_editing_a_model_in_one_thread_does_not_reach_the_others(switching_often: None) -> None:
    task = ("humanoid", "walk")
    expected = episodes(task, 0)
    done = threading.Event()

    def edit() -> None:
        while not done.is_set():
            physics = load(task).physics
            physics.model.opt.gravity[:] = 3.0
            with physics.model.disable("actuation", "contact"):
                physics.reset()

    with futures.ThreadPoolExecutor(2) as pool:
        editing = pool.submit(edit)
        try:
            assert all(episodes(task, 0) == expected for _ in range(3))
        finally:
            done.set()
        editing.result()


def test_one_environment_in_two_threads_at_once_is_refused(switching_often: None) -> None:
    env = load(("humanoid", "walk"))
    action = np.zeros(21)
    inside, go_on = threading.Event(), threading.Event()

    def wait(physics: Any) -> None:
        inside.set()
        assert go_on.wait(60)

    env.reset()
    env.task.after_step = wait
    with futures.ThreadPoolExecutor(1) as pool:
        stepping = pool.submit(env.step, action)
        assert inside.wait(60)
        for use in (lambda: env.step(action), env.reset, env.snapshot):
            with pytest.raises(RuntimeError, match="this environment is used from two threads"):
                use()
        go_on.set()
        assert stepping.result().mid()
    del env.task.after_step
    assert env.step(action).mid()  # it goes on, in this thread as well


def test_an_error_in_a_step_leaves_the_environment_to_other_threads() -> None:
    env = load(("stacker", "stack_2"))
    env.reset()

    def fail(physics: Any) -> None:
        raise KeyboardInterrupt

    env.task.after_step = fail
    with pytest.raises(KeyboardInterrupt):
        env.step(np.zeros(5))
    del env.task.after_step
    env.reset()
    with pytest.raises(ValueError, match="not finite"):
        env.step(np.full(5, np.nan))
    with futures.ThreadPoolExecutor(1) as pool:
        assert pool.submit(env.reset).result().first()


def test_a_task_may_use_its_environment_within_a_step() -> None:
    taken: list[Any] = []

    class Snapping(stacker.Stack):
        def after_step(self, physics: Any) -> None:
            super().after_step(physics)
            if env.is_running or taken:
                return
            taken.append(env.snapshot())

    env = load(("stacker", "stack_2"))
    env.reset()
    env.task.__class__ = Snapping
    assert env.step(np.zeros(5)).mid()
    assert len(taken) == 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_child_that_is_forked_in_mid_step_can_use_the_environment() -> None:
    env = load(("stacker", "stack_2"))
    env.reset()
    inside, forked = threading.Event(), threading.Event()
    env.task.after_step = lambda physics: (inside.set(), forked.wait(60))
    with futures.ThreadPoolExecutor(1) as pool:
        stepping = pool.submit(env.step, np.zeros(5))
        assert inside.wait(60)
        pid = os.fork()
        if pid == 0:
            status = 1
            try:
                del env.task.after_step
                env.reset()
                status = 0 if env.step(np.zeros(5)).mid() else 2
            finally:
                os._exit(status)
        forked.set()
        stepping.result()
    assert os.waitpid(pid, 0)[1] == 0


def test_an_environment_made_in_one_thread_is_used_in_another() -> None:
    env = load(("manipulator", "bring_peg"))
    with futures.ThreadPoolExecutor(1) as pool:
        first = pool.submit(play, env, 5).result()
    assert first == play(load(("manipulator", "bring_peg")), 5)


def test_threads_may_load_more_models_than_are_kept(
    switching_often: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sharing, "_MOST_KEPT", 2**20)

    def load_some(number: int) -> None:
        for i in range(200):
            source = f"<mujoco model='{(number * i) % 7}'/>"
            mujoco.Physics.from_shared_xml(source, {})

    with futures.ThreadPoolExecutor(_THREADS) as pool:
        list(pool.map(load_some, range(1, _THREADS + 1)))
