"""Ctrl-C at any point leaves the environment intact, and takes effect within a second."""

import os
import signal
import sys
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

import mujoco
import numpy as np
import pytest

import limberjack
from limberjack import suite
from limberjack.mujoco.wrapper import sharing
from tests.laws.episodes import LAST_TASKS, Task, actions, bits, load, play

_PACKAGE = os.path.dirname(limberjack.__file__) + os.sep
_EVERY = 36  # of the places in a load, for each domain
_KEEPS_STATE = ("control.py", "simulation.py", "batch_simulation.py")  # tested more densely

# Called at each instruction; it may raise.
Visit = Callable[[FrameType], None]


def watched(call: Callable[[], Any], visit: Visit) -> None:
    """Calls the function, and `visit` before each instruction that runs in the package."""

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
    """Points to interrupt, as instruction counts.

    The first execution of each line; in modules that keep state, the first and the last execution
    of each instruction.
    """
    first: dict[Any, int] = {}
    last: dict[Any, int] = {}
    count = 0

    def visit(frame: FrameType) -> None:
        nonlocal count
        name = os.path.basename(frame.f_code.co_filename)
        if name in _KEEPS_STATE:
            last[frame.f_code, frame.f_lasti] = count
            first.setdefault((frame.f_code, frame.f_lasti), count)
        else:
            first.setdefault((frame.f_code, frame.f_lineno), count)
        count += 1

    watched(call, visit)
    return sorted({*first.values(), *last.values()})


def interrupted(call: Callable[[], Any], place: int) -> None:
    """Calls the function, with Ctrl-C before the given instruction."""
    left = iter(range(place, -1, -1))

    def visit(frame: FrameType) -> None:
        if next(left) == 0:
            sys.settrace(None)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        watched(call, visit)


# With a model that is shared, is copied at the first start, and is edited by the user.
_CASES = [
    pytest.param(("cartpole", "swingup"), False, id="cartpole:swingup"),
    pytest.param(("manipulator", "insert_peg"), False, id="manipulator:insert_peg"),
    pytest.param(("cartpole", "balance"), True, id="cartpole:balance-edited"),
]


def under_way(task: Task, is_edited: bool) -> Any:
    """An environment in the middle of an episode, its model edited or not."""
    env = load(task)
    if is_edited:
        env.physics.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SPRING.value
    go_under_way(env)
    return env


def go_under_way(env: Any) -> None:
    """Plays into the middle of an episode, always the same one if the environment is intact."""
    env.task._random = np.random.RandomState(1)
    play(env, 2)
    env.task._random = np.random.RandomState(9)


def replayed(env: Any) -> Any:
    """The bits of an episode that is the same in every intact environment, and its flags."""
    env.task._random = np.random.RandomState(9)
    return [*play(env, 3), env.physics.model._official.opt.disableflags]


@pytest.mark.parametrize(("task", "is_edited"), _CASES)
def test_a_reset_interrupted_anywhere_is_undone_complete_or_repeated(
    task: Task, is_edited: bool
) -> None:
    env = under_way(task, is_edited)
    action = actions(env, 1)[0]
    undone, begun = bits(env.step(action)), bits(env.reset())
    done = bits(env.step(action))
    expected = replayed(env)
    where = places(under_way(task, is_edited).reset)
    assert len(where) > 200
    outcomes = []
    for place in where:
        go_under_way(env)
        interrupted(env.reset, place)
        env.task._random = np.random.RandomState(9)
        outcomes.append(bits(env.step(action)))
        assert outcomes[-1] in (undone, done, begun), place
        assert replayed(env) == expected, place
    assert outcomes.count(begun) > 0.8 * len(outcomes)


@pytest.mark.parametrize(("task", "is_edited"), _CASES)
def test_a_step_interrupted_anywhere_is_undone_complete_or_ends_the_episode(
    task: Task, is_edited: bool
) -> None:
    env = under_way(task, is_edited)
    action = actions(env, 1)[0]
    undone, done, begun = bits(env.step(action)), bits(env.step(action)), bits(env.reset())
    expected = replayed(env)
    env = under_way(task, is_edited)
    where = places(lambda: env.step(action))
    assert len(where) > 150
    outcomes = []
    for place in where:
        go_under_way(env)
        interrupted(lambda: env.step(action), place)
        outcomes.append(bits(env.step(action)))
        assert outcomes[-1] in (undone, done, begun), place
        assert replayed(env) == expected, place
    assert begun in outcomes


@pytest.mark.parametrize(("number", "task"), list(enumerate(LAST_TASKS)), ids=str)
def test_a_load_interrupted_anywhere_can_be_repeated(number: int, task: Task) -> None:
    def load_and_begin() -> Any:
        return suite.load(*task, {"random": 0}).reset()

    expected = replayed(load(task))
    # The domains together meet every place of the code that they share.
    for place in places(load_and_begin)[number % _EVERY :: _EVERY]:
        interrupted(load_and_begin, place)
    assert replayed(load(task)) == expected


def test_a_first_load_interrupted_anywhere_can_be_repeated() -> None:
    def compile_and_begin() -> None:
        sharing._in_use.clear()
        sharing.drop_unused()
        suite.load("stacker", "stack_2", {"random": 0}).reset()

    expected = replayed(load(("stacker", "stack_2")))
    where = places(compile_and_begin)
    for place in where[:: len(where) // 12]:
        interrupted(compile_and_begin, place)
        assert replayed(suite.load("stacker", "stack_2")) == expected, place


def interrupted_soon(call: Callable[[], Any]) -> float:
    """Calls repeatedly, with Ctrl-C after 0.1 s; returns the seconds that it took to end."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    def go_on() -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        while True:
            call()

    before = signal.signal(signal.SIGALRM, interrupt)
    start = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            go_on()
    finally:
        signal.signal(signal.SIGALRM, before)
    return time.monotonic() - start


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there are no timers here")
@pytest.mark.parametrize("what", ["steps", "resets", "a start that cannot be"])
def test_ctrl_c_is_answered_within_a_second(what: str) -> None:
    env = load(("stacker", "stack_4"))
    margins = env.physics.model.geom_margin.copy()
    if what == "a start that cannot be":
        env.physics.model.geom_margin[:] = 10.0
    action = np.zeros(5)
    seconds = interrupted_soon(lambda: env.step(action) if what == "steps" else env.reset())
    assert seconds < 1.0
    env.physics.model.geom_margin[:] = margins
    assert replayed(env) == replayed(load(("stacker", "stack_4")))


@pytest.mark.parametrize("method", ["step", "reset", "restore"])
def test_many_tasks_are_whole_after_an_interrupt_anywhere(method: str) -> None:
    tasks = ["pendulum:swingup", "lqr:lqr_2_1"]
    many = suite.load_batch(tasks, rows=2, num_threads=1, seed=3)
    given = np.random.RandomState(0).uniform(-1, 1, (2, *many.action_mask.shape))
    seeds = range(3, 7)

    def played() -> list[Any]:
        many.reset(seeds=seeds)
        return [many.step(one) for one in given]

    expected = played()
    snapshot = many.snapshot()
    calls: dict[str, Callable[[], Any]] = {
        "step": lambda: many.step(given[0]),
        "reset": lambda: many.reset(seeds=seeds),
        "restore": lambda: many.restore(snapshot),
    }
    for place in places(calls[method])[:: _EVERY // 3]:
        many.reset(seeds=seeds)
        interrupted(calls[method], place)
        many.step(given[1])  # whatever rows do that were interrupted
        for found, one in zip(played(), expected, strict=True):
            np.testing.assert_array_equal(found.step_type, one.step_type)
            np.testing.assert_array_equal(found.reward, one.reward)
            for name, values in one.observation.items():
                np.testing.assert_array_equal(found.observation[name], values)
