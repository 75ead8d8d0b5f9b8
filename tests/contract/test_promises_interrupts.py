"""Ctrl-C at any point leaves the environment whole, and is answered within a second."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

import mujoco
import numpy as np
import pytest
from laws.episodes import DOMAINS, Task, actions, bits, load, play

import limberjack
from limberjack import suite
from limberjack.mujoco import engine

_PACKAGE = os.path.dirname(limberjack.__file__) + os.sep
_KEEPS_STATE = ("control.py", "simulation.py")  # looked at more closely

# What happens at each instruction; it may raise.
Visit = Callable[[FrameType], None]


def watched(call: Callable[[], Any], visit: Visit) -> None:
    """Calls, and visits before each instruction that runs in the package."""

    def enter(frame: FrameType, event: str, argument: Any) -> Any:
        if not frame.f_code.co_filename.startswith(_PACKAGE):
            return None
        frame.f_trace_lines, frame.f_trace_opcodes = False, True
        return instruction

    def instruction(frame: FrameType, event: str, argument: Any) -> Any:
        if event == "opcode":
            visit(frame)
        return instruction

    before = sys.gettrace()
    sys.settrace(enter)
    try:
        call()
    finally:
        sys.settrace(before)


def places(call: Callable[[], Any]) -> list[int]:
    """Where to interrupt: counts of instructions.

    The first and the last time that each line runs, and where state is kept each instruction.
    """
    first: dict[Any, int] = {}
    last: dict[Any, int] = {}
    count = 0

    def visit(frame: FrameType) -> None:
        nonlocal count
        name = os.path.basename(frame.f_code.co_filename)
        place = (frame.f_code, frame.f_lasti if name in _KEEPS_STATE else frame.f_lineno)
        first.setdefault(place, count)
        last[place] = count
        count += 1

    watched(call, visit)
    return sorted({*first.values(), *last.values()})


def interrupted(call: Callable[[], Any], place: int) -> None:
    """Calls, with Ctrl-C before the instruction of that number."""
    left = iter(range(place, -1, -1))

    def visit(frame: FrameType) -> None:
        if next(left) == 0:
            sys.settrace(None)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        watched(call, visit)


# Environments whose model is shared or, once the user has edited it, their own.
_CASES = [
    *(pytest.param(*case.values, False, id=f"{case.id}-shared") for case in DOMAINS),
    pytest.param(("humanoid", "walk"), True, id="humanoid:walk-own"),
]


def under_way(task: Task, is_own: bool) -> Any:
    """An environment in the middle of an episode, its model shared or its own."""
    env = load(task, seed=1)
    if is_own:
        env.physics.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SPRING.value
    play(env, 2)
    env.task._random = np.random.RandomState(9)
    return env


def replayed(env: Any) -> Any:
    """The bits of an episode that is the same in every whole environment, and its flags."""
    env.task._random = np.random.RandomState(9)
    return [*play(env, 3), env.physics.model._model.opt.disableflags]


@pytest.mark.parametrize(("task", "is_own"), _CASES)
def test_a_reset_interrupted_anywhere_is_undone_done_or_made_again(
    task: Task, is_own: bool
) -> None:
    env = under_way(task, is_own)
    action = actions(env, 1)[0]
    undone, begun = bits(env.step(action)), bits(env.reset())
    done = bits(env.step(action))
    expected = replayed(env)
    where = places(under_way(task, is_own).reset)
    assert len(where) > 200
    outcomes = []
    for place in where:
        env = under_way(task, is_own)
        interrupted(env.reset, place)
        env.task._random = np.random.RandomState(9)
        outcomes.append(bits(env.step(action)))
        assert outcomes[-1] in (undone, done, begun), place
        assert replayed(env) == expected, place
    assert outcomes.count(begun) > 0.9 * len(outcomes)


@pytest.mark.parametrize(("task", "is_own"), _CASES)
def test_a_step_interrupted_anywhere_is_undone_done_or_ends_the_episode(
    task: Task, is_own: bool
) -> None:
    env = under_way(task, is_own)
    action = actions(env, 1)[0]
    undone, done, begun = bits(env.step(action)), bits(env.step(action)), bits(env.reset())
    expected = replayed(env)
    env = under_way(task, is_own)
    where = places(lambda: env.step(action))
    assert len(where) > 150
    outcomes = []
    for place in where:
        env = under_way(task, is_own)
        interrupted(lambda env=env: env.step(action), place)
        outcomes.append(bits(env.step(action)))
        assert outcomes[-1] in (undone, done, begun), place
        assert replayed(env) == expected, place
    assert begun in outcomes


@pytest.mark.parametrize("task", DOMAINS)
def test_a_load_interrupted_anywhere_can_be_made_again(task: Task) -> None:
    def load_and_begin() -> Any:
        return suite.load(*task, {"random": 0}).reset()

    expected = replayed(load(task))
    for place in places(load_and_begin)[::9]:
        interrupted(load_and_begin, place)
    assert replayed(load(task)) == expected


def test_a_first_load_interrupted_anywhere_can_be_made_again() -> None:
    def compile_and_begin() -> None:
        engine._models.clear()
        suite.load("stacker", "stack_2").reset()

    expected = replayed(load(("stacker", "stack_2")))
    where = places(compile_and_begin)
    for place in where[:: len(where) // 12]:
        interrupted(compile_and_begin, place)
        assert replayed(suite.load("stacker", "stack_2")) == expected, place


@pytest.fixture
def ctrl_c_soon() -> Iterator[None]:
    """A tenth of a second later KeyboardInterrupt is raised, wherever the program is then."""
    if not hasattr(signal, "setitimer"):
        pytest.skip("there are no timers here")

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("what", ["steps", "resets", "a start that cannot be"])
def test_ctrl_c_is_answered_within_a_second(what: str, ctrl_c_soon: None) -> None:
    env = load(("stacker", "stack_4"))
    margins = env.physics.model.geom_margin.copy()
    if what == "a start that cannot be":
        env.physics.model.geom_margin[:] = 10.0
    action = np.zeros(5)

    def go_on() -> None:
        while True:
            env.step(action) if what == "steps" else env.reset()

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        go_on()
    assert time.monotonic() - start < 1.0
    env.physics.model.geom_margin[:] = margins
    assert replayed(env) == replayed(load(("stacker", "stack_4")))
