"""A worker process: plays the units that arrive on its standard input until that is closed.

    python -P -c 'from limberjack.workers.process import main; main()'

Each message is its length in 8 bytes and then a pickle. What a policy prints goes to standard
error, so that it does not mix with the answers on standard output. The process ends at once when
the driver does, also in the middle of a unit: a thread waits for the end of the input.
"""

import contextlib
import os
import pickle
import queue
import struct
import sys
import threading
from collections.abc import Iterable
from typing import BinaryIO

from limberjack.workers.attempt import Failed, attempt, described
from limberjack.workers.setup import Setup
from limberjack.workers.units import Unit

__all__ = ["LENGTH", "OUT_OF_MEMORY", "main", "read_message", "write_message"]

LENGTH = struct.Struct("<Q")  # of the message that follows, in bytes
OUT_OF_MEMORY = 71  # exit status

# If memory runs out, Linux ends a worker, whose unit is played again, instead of the driver.
_OOM_SCORE = "500"


def main() -> None:
    """Plays units until the input ends."""
    answers, units = _private_streams()
    _offer_to_be_killed_first()
    messages: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(units, messages), daemon=True).start()
    known: dict[str, object] = {}  # functions and setups, by their keys
    while True:
        try:
            answer = _answer(messages.get(), known)
        except MemoryError:
            os._exit(OUT_OF_MEMORY)
        write_message(answers, [answer])


def _answer(message: bytes, known: dict[str, object]) -> bytes:
    """The answer to a message, which may bring a function and a setup for later ones too."""
    try:
        new, function_key, setup_key, seeds, more = pickle.loads(message)
        known.update(new)
        function, setup = known[function_key], known[setup_key]
        assert callable(function)
        assert isinstance(setup, Setup)
        try:
            return pickle.dumps(attempt(function, setup, seeds, *more))
        except KeyboardInterrupt as error:  # raised by the user's code: no signal reaches a worker
            error.add_note(str(Unit(setup, seeds)))
            return pickle.dumps(Failed(described(error)))
    except MemoryError:
        raise
    except Exception as error:  # a module that is missing here, or a result that has no pickle
        return pickle.dumps(Failed(described(error)))


def read_message(stream: BinaryIO) -> bytes:
    """The next message.

    Raises:
      EOFError: the stream ended.
    """
    (length,) = LENGTH.unpack(_read(stream, LENGTH.size))
    return _read(stream, length)


def write_message(stream: BinaryIO, parts: Iterable[bytes]) -> None:
    """Writes messages, and flushes the stream."""
    for part in parts:
        stream.write(LENGTH.pack(len(part)))
        stream.write(part)
    stream.flush()


def _read(stream: BinaryIO, count: int) -> bytes:
    content = stream.read(count)
    if len(content) < count:
        raise EOFError
    return content


def _private_streams() -> tuple[BinaryIO, BinaryIO]:
    """Output and input with file numbers of their own; prints go to standard error."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    units = os.fdopen(os.dup(sys.stdin.fileno()), "rb")
    # A process that a policy forks must not keep the pipe open: the driver would wait for its end.
    os.register_at_fork(after_in_child=answers.close)
    if sys.stderr is None:  # closed before the program began
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 (for as long as the process lasts)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), sys.stdin.fileno())
    return answers, units


def _offer_to_be_killed_first() -> None:
    with contextlib.suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
        file.write(_OOM_SCORE)


def _receive(units: BinaryIO, messages: "queue.SimpleQueue[bytes]") -> None:
    """Passes messages on, and ends the process with the input."""
    while True:
        try:
            messages.put(read_message(units))
        except (EOFError, OSError):
            os._exit(0)
        except MemoryError:  # else the main thread would wait for the message for ever
            os._exit(OUT_OF_MEMORY)
