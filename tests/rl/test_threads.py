"""Tests of limberjack.rl.threads."""

import pytest

from limberjack import suite
from limberjack.rl import threads
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
