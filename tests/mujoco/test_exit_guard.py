"""Interpreter exit while threads simulate."""

import concurrent.futures
from collections.abc import Callable
from typing import Any, NoReturn

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import exit_guard, wrapper
from tests.programs import run

_PROGRAM = """
    import threading, time
    import numpy as np
    from limberjack import suite

    env, entered = suite.load("humanoid", "walk"), threading.Event()
    env.reset()

    def in_a_step(physics):
        entered.set()
        time.sleep({seconds})
        print("the step has ended", flush=True)

    def simulate():
        env.step(np.zeros(21))
        while True:
            env.step(np.zeros(21))

    env.task.after_step = in_a_step
    threading.Thread(target=simulate, daemon=True).start()
    entered.wait()
    print("the program ends", flush=True)
"""


def test_the_exit_waits_for_a_daemons_step_and_lets_it_begin_no_other() -> None:
    lines = run(_PROGRAM.format(seconds=0.3)).splitlines()
    assert lines == ["the program ends", "the step has ended"]


def test_the_exit_waits_no_longer_than_two_seconds() -> None:
    assert run(_PROGRAM.format(seconds=60)).splitlines() == ["the program ends"]


def test_threads_that_do_not_simulate_are_not_waited_for() -> None:
    program = """
        import threading, time
        from limberjack.mujoco import exit_guard

        def idle():
            threading.Event().wait()

        for target in (idle, exit_guard.wait_forever):
            threading.Thread(target=target, daemon=True).start()
        time.sleep(0.1)
        began = time.monotonic()
        exit_guard._wait_for_others()
        print(time.monotonic() - began < exit_guard._LONGEST_WAIT / 2)
    """
    assert run(program) == "True\n"


def test_at_exit_the_main_thread_may_still_simulate() -> None:
    program = """
        import atexit

        def last():
            from limberjack import suite
            print(suite.load("pendulum", "swingup").reset().first())

        atexit.register(last)
        import limberjack.mujoco  # whose own part of the exit comes before
    """
    assert run(program) == "True\n"


class _StayError(Exception):
    """Instead of staying for ever."""


def _stay() -> NoReturn:
    raise _StayError


@pytest.fixture
def calls_at_exit(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The functions of MuJoCo that are called while the process seems to exit."""
    calls: list[str] = []
    places = [(mujoco, name) for name in dir(mujoco) if name.startswith(("mj_", "mju_"))]
    places += [(mujoco.batch.Batch, name) for name in ("forward", "reset", "set_const", "step")]
    for owner, name in places:
        monkeypatch.setattr(owner, name, lambda *_, name=name, **__: calls.append(name))
    monkeypatch.setattr(exit_guard, "_is_exiting", True)
    monkeypatch.setattr(exit_guard, "wait_forever", _stay)
    return calls


_STATE = mujoco.mjtState.mjSTATE_QPOS.value
_CALLS: dict[str, Callable[[Any], object]] = {
    "step": lambda physics: physics.simulation.step(1),
    "whole steps": lambda physics: physics.simulation.step_whole(1),
    "forward": lambda physics: physics.simulation.forward(),
    "start": lambda physics: physics.simulation.forward_without_actuation(),
    "reset": lambda physics: physics.simulation.reset(),
    "get state": lambda physics: physics.simulation.get_state(_STATE),
    "set state": lambda physics: physics.simulation.set_state(np.zeros((1, 30)), _STATE),
    "velocity": lambda physics: physics.data.object_velocity("torso", "body"),
    "name": lambda physics: physics.model.name2id("torso", "body"),
    "compile": lambda physics: wrapper.MjModel.from_xml_string("<mujoco/>"),
}


@pytest.mark.parametrize("kind", ["single", "batch"])
@pytest.mark.parametrize("call", _CALLS.values(), ids=_CALLS)
def test_a_daemon_stays_before_it_calls_mujoco(
    call: Callable[[Any], object], kind: str, request: pytest.FixtureRequest
) -> None:
    environment: Any = suite.load("quadruped", "fetch")
    if kind == "batch":
        environment = suite.load_batch("quadruped", "fetch", 2, 1, 0)
    calls = request.getfixturevalue("calls_at_exit")  # after the loads
    with concurrent.futures.ThreadPoolExecutor(1) as executor, pytest.raises(_StayError):
        executor.submit(call, environment.physics).result()
    assert calls == []
