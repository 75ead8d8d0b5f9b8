"""The exit guard: a safe exit of the interpreter while threads are simulating.

MuJoCo's functions release the GIL. If one returns in a daemon thread during interpreter shutdown,
Python ends the thread inside MuJoCo's bindings, which crashes the process. Therefore the exit waits
until no other thread is simulating, and a thread that begins to simulate after that waits forever.
"""

import atexit
import sys
import threading
import time
from types import FrameType

__all__ = ["pass_exit_guard", "wait_forever"]

# Prefixes of the modules whose functions call MuJoCo or, as a step does, functions that may.
_SIMULATING = (
    "limberjack.mujoco.",
    "limberjack.rl.",
    "limberjack.suite.",
    "limberjack.utils.inverse_kinematics",
)
_LONGEST_WAIT = 2.0  # seconds; a step takes milliseconds

_is_exiting = False
_waiting: set[int] = set()  # ids of threads that wait for the end of the process


def pass_exit_guard() -> None:
    """To be called before MuJoCo is; during exit, blocks every thread but the main one forever."""
    if _is_exiting and threading.current_thread() is not threading.main_thread():
        wait_forever()


def wait_forever() -> None:
    """Blocks this thread, a daemon, until the process ends; the exit does not wait for it."""
    _waiting.add(threading.get_ident())
    threading.Event().wait()


@atexit.register
def _wait_for_others() -> None:
    global _is_exiting
    _is_exiting = True
    end = time.monotonic() + _LONGEST_WAIT
    while _others_simulate() and time.monotonic() < end:
        time.sleep(0.001)


def _others_simulate() -> bool:
    elsewhere = _waiting | {threading.get_ident()}
    frames = sys._current_frames().items()
    return any(_simulates(frame) for thread, frame in frames if thread not in elsewhere)


def _simulates(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_globals.get("__name__", "").startswith(_SIMULATING):
            return True
        frame = frame.f_back
    return False
