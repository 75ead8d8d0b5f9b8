"""Leaving the interpreter while threads simulate.

A daemon thread that is inside MuJoCo when the interpreter is taken down would crash it. So every
call into MuJoCo that runs without the interpreter's lock says that it is running; at exit the
calls that are under way are waited for, and no thread begins another.
"""

import atexit
import threading
import time
import weakref

__all__ = ["Busy", "begin", "watch"]

_LONGEST_WAIT = 2.0  # seconds; a call takes milliseconds

_is_leaving = False
_watched: "weakref.WeakSet[Busy]" = weakref.WeakSet()


class Busy:
    """Something that may be inside MuJoCo: `is_busy` is set by `begin` and cleared by its owner."""

    is_busy = False


def watch(busy: Busy) -> None:
    """Has the exit wait for `busy`."""
    _watched.add(busy)


def begin(busy: Busy) -> None:
    """Marks the beginning of a call; never returns to a thread that is left behind at exit."""
    busy.is_busy = True
    if _is_leaving and threading.current_thread() is not threading.main_thread():
        busy.is_busy = False
        threading.Event().wait()


@atexit.register
def _wait_for_calls() -> None:
    global _is_leaving
    _is_leaving = True
    end = time.monotonic() + _LONGEST_WAIT
    while any(busy.is_busy for busy in list(_watched)) and time.monotonic() < end:
        time.sleep(0.001)
