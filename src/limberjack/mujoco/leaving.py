"""Safe interpreter exit while threads are simulating.

A daemon thread inside MuJoCo during interpreter shutdown would crash the process. Therefore every
call into MuJoCo that releases the GIL marks itself as running; at exit, calls in progress are
awaited and no thread starts another.
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
    """An object that may be inside a MuJoCo call.

    `busy_in` is the id of the thread inside the call, set by `begin`; the owner resets it to None.
    A call interrupted by Ctrl-C leaves it set, which is harmless: see `_wait_for_calls`.
    """

    busy_in: int | None = None


def watch(busy: Busy) -> None:
    """Registers `busy`, so that interpreter exit waits for its calls."""
    _watched.add(busy)


def begin(busy: Busy) -> None:
    """Marks the start of a call; during exit, blocks every thread but the main one forever."""
    busy.busy_in = threading.get_ident()
    if _is_leaving and threading.current_thread() is not threading.main_thread():
        busy.busy_in = None
        threading.Event().wait()


@atexit.register
def _wait_for_calls() -> None:
    global _is_leaving
    _is_leaving = True
    end = time.monotonic() + _LONGEST_WAIT
    # Living threads except this one, which is in no call, although an interrupted one may say so.
    others = {thread.ident for thread in threading.enumerate()} - {threading.get_ident()}
    while any(busy.busy_in in others for busy in list(_watched)) and time.monotonic() < end:
        time.sleep(0.001)
