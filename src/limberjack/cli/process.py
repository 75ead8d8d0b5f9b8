"""The process of a command: its command line, and its end, whatever a policy leaves behind.

    with own_process():
        app()

Ctrl-C and SIGTERM raise KeyboardInterrupt, except during imports before anything is written: an
extension module that is interrupted there may report anything, so the process ends at once. Threads
and processes that a policy has started do not keep the process alive.
"""

import contextlib
import logging
import os
import shlex
import signal
import sys
import threading
import time
from collections.abc import Iterator
from types import FrameType

import typer

from limberjack.utils import files
from limberjack.utils.texts import encodable

__all__ = ["INTERRUPTED", "TERMINATED", "command_line", "own_process"]

# Exit statuses, as shells report what Ctrl-C or SIGTERM ended.
INTERRUPTED, TERMINATED = 130, 143

_PATIENCE = 3.0  # seconds that threads and exit handlers of a policy may take after the command
_SHOW_CURSOR = "\x1b[?25h"  # a progress bar hides it
_IMPORTING = "<frozen importlib"  # beginning of the file names of Python's import system


@contextlib.contextmanager
def own_process() -> Iterator[None]:
    """Handles signals in the body, and lets nothing outlive it for more than three seconds.

    The exit status after SIGTERM is 143 where it would be that of Ctrl-C.
    """
    terminated = False

    def terminate(number: int, frame: FrameType | None) -> None:
        nonlocal terminated
        terminated = True
        _interrupt(TERMINATED, frame)

    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as in the background of a script
        signal.signal(signal.SIGINT, lambda number, frame: _interrupt(INTERRUPTED, frame))
    signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except SystemExit as end:
        if terminated and end.code == INTERRUPTED:
            end.code = TERMINATED
        _end_in_time(end.code if isinstance(end.code, int) else 0)
        raise
    except KeyboardInterrupt:  # outside of a command
        status = TERMINATED if terminated else INTERRUPTED
        _end_in_time(status)
        sys.exit(status)
    except BaseException:
        _end_in_time(1)
        raise
    _end_in_time(0)


def _interrupt(status: int, frame: FrameType | None) -> None:
    """Raises KeyboardInterrupt, or ends the process if it is still importing what it needs."""
    if _is_importing(frame) and not files.is_any_unfinished():
        if sys.stderr is not None and sys.stderr.isatty():
            os.write(sys.stderr.fileno(), _SHOW_CURSOR.encode())
        os._exit(status)
    raise KeyboardInterrupt


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith(_IMPORTING):
            return True
        frame = frame.f_back
    return False


def _end_in_time(status: int) -> None:
    """Ends the process with this status if Python's own exit takes too long."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command is over
    others = [
        thread.name
        for thread in threading.enumerate()
        if not thread.daemon and thread is not threading.main_thread()
    ]
    threading.Thread(target=_end, args=(status, others), daemon=True).start()


def _end(status: int, threads: list[str]) -> None:
    time.sleep(_PATIENCE)
    left = f"thread {threads[0]!r}" if threads else "exit handler or process"
    with contextlib.suppress(Exception):
        typer.echo(
            f"limberjack: a policy's {left} was still running after the command, and is ended",
            err=True,
        )
    with contextlib.suppress(Exception):
        if "multiprocessing" in sys.modules:
            import multiprocessing

            for process in multiprocessing.active_children():
                process.kill()
    for flush in (logging.shutdown, sys.stdout.flush, sys.stderr.flush):
        with contextlib.suppress(Exception):
            flush()
    os._exit(status)


def command_line() -> str:
    """The command of this process, quoted for a shell; bytes that are no text are escaped."""
    return encodable(shlex.join(["limberjack", *sys.argv[1:]]))
