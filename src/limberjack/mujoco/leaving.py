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
    """Something that may be inside MuJoCo.

    `busy_in` is the number of the thread that is inside, set by `begin`; its owner sets it back to
    None. A call that Ctrl-C cuts short leaves it set, which does no harm: see `_wait_for_calls`.
    """

    busy_in: int | None = None


def watch(busy: Busy) -> None:
    """Has the exit wait for `busy`."""
    _watched.add(busy)


def begin(busy: Busy) -> None:
    """Marks the beginning of a call; never returns to a thread that is left behind at exit."""
    busy.busy_in = threading.get_ident()
    if _is_leaving and threading.current_thread() is not threading.main_thread():
        busy.busy_in = None
        threading.Event().wait()


@atexit.register
def _wait_for_calls() -> None:
    global _is_leaving
    _is_leaving = True
    end = time.monotonic() + _LONGEST_WAIT
    # Threads that live; this one is in no call, whatever an interrupted one says.
    others = {thread.ident for thread in threading.enumerate()} - {threading.get_ident()}
    while any(busy.busy_in in others for busy in list(_watched)) and time.monotonic() < end:
        time.sleep(0.001)
