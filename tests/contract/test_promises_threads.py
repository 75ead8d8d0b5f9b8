"""Environments of one task in several threads play what they play one after the other."""

import sys
import threading
from collections.abc import Iterator
from concurrent import futures
from typing import Any

import pytest

from limberjack import suite
from limberjack.mujoco.wrapper import sharing
from tests.laws.episodes import DOMAINS, Task, bits, load, play

_THREADS = 4
_EPISODES = 6


@pytest.fixture
def switching_often() -> Iterator[None]:
    """Threads take turns as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def episodes(task: Task, seed: int) -> list[Any]:
    env = load(task, seed)
    return [play(env, 10, seed) for _ in range(_EPISODES)]


@pytest.mark.parametrize("task", DOMAINS)
def test_threads_play_what_one_after_the_other_plays(task: Task, switching_often: None) -> None:
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
            sharing._last_used.clear()
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


def test_an_environment_made_in_one_thread_is_used_in_another() -> None:
    env = load(("manipulator", "bring_peg"))
    with futures.ThreadPoolExecutor(1) as pool:
        first = pool.submit(play, env, 5).result()
    assert first == play(load(("manipulator", "bring_peg")), 5)
