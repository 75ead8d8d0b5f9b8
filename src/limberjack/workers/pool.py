"""Processes of this machine that play units; one that dies is replaced, and its unit played again.

    with Pool(4) as pool:
        for unit, result in pool.results(function, units):
            ...

Results that are given up half-way leave no trace in later ones; what is being played ends first.

Workers are new Python processes, never forks: `mujoco.batch` cannot be used after a fork. They
import from the same folders as this process, but not its main program. They hold no shared memory,
and end with this process, however that ends.
"""

import contextlib
import hashlib
import json
import pickle
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from typing import BinaryIO, Literal, TypeVar

from limberjack.workers.attempt import Answer, Failed, Function, WorkError, described, value_of
from limberjack.workers.process import OUT_OF_MEMORY, read_message, write_message
from limberjack.workers.state import OnState, State
from limberjack.workers.units import Unit, queue_of

__all__ = ["Pool"]

_ATTEMPTS = 3  # workers that a unit may lose before it ends the run

_ENDING = 2.0  # seconds for a process that has closed its output to end by itself
_LOOK = 1.0  # seconds between two reports of the state

# Ctrl-C is the driver's business, while a worker imports too.
_PROGRAM = (
    "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    "import json, sys; sys.path[:] = json.loads(sys.argv.pop()); "
    "from limberjack.workers.process import main; main()"
)

_Result = TypeVar("_Result")


class _Lost:
    """The end of a worker that was playing."""

    def __init__(self, returncode: int) -> None:
        if returncode < 0:
            self.how = f"signal {_name_of(-returncode)}"
        elif returncode == OUT_OF_MEMORY:
            self.how = "out of memory"
        else:
            self.how = f"exit status {returncode}"


_Answer = Answer | Failed | _Lost


def _name_of(number: int) -> str:
    """The name of a signal; its number where it has none, as most real-time signals."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return str(number)


class _Worker(threading.Thread):
    """Starts a process when there is a unit for it, and replaces one that has ended."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.state: Literal["idle", "starting", "playing"] = "idle"
        self.unit: Unit | None = None  # that is played, or was last
        self._given: queue.SimpleQueue[tuple[object, Unit, _Answers] | None] = queue.SimpleQueue()
        self._process: subprocess.Popen[bytes] | None = None
        self._sent: set[str] = set()  # keys of functions and setups that the process knows
        self._guard = threading.Lock()
        self._closing = False
        self.start()

    def give(self, function: object, unit: Unit, answers: "_Answers") -> None:
        """Plays a unit after those given before; the answer goes to the queue."""
        self._given.put((function, unit, answers))

    def stop(self) -> None:
        """Ends the process and the thread, in the middle of a unit too."""
        with self._guard:
            self._closing = True
            if self._process is not None:
                self._process.kill()
        self._given.put(None)

    def run(self) -> None:
        """The thread's loop."""
        while (given := self._given.get()) is not None:
            function, self.unit, answers = given
            try:
                answer = self._played(function, self.unit)
            # Such as a function without a name, a result of an unknown class, or too many open
            # files. Without an answer, the driver would wait forever.
            except Exception as error:
                answer = Failed(described(error))
            self.state = "idle"
            answers.put((self, self.unit, answer))
        if self._process is not None:
            _ended(self._process)

    def _played(self, function: object, unit: Unit) -> "_Answer":
        process = self._living()
        if process is None:
            return _Lost(0)  # closing: nobody reads the answer
        streams: tuple[BinaryIO, BinaryIO] = process.stdin, process.stdout  # pyright: ignore
        try:
            key = hashlib.sha256(pickle.dumps(function)).hexdigest()
            once = {key: function, unit.setup.key: unit.setup}
            new = {name: value for name, value in once.items() if name not in self._sent}
            message = pickle.dumps((new, key, unit.setup.key, unit.seeds, unit.more))
            write_message(streams[0], [message])
            self._sent.update(once)
            self.state = "playing"
            answer = pickle.loads(read_message(streams[1]))
            if isinstance(answer, Failed):  # perhaps to read the message
                self._sent.clear()
            return answer
        except (EOFError, OSError):
            with contextlib.suppress(subprocess.TimeoutExpired):  # its own end, rather than a kill
                process.wait(_ENDING)
            return _Lost(_ended(process))

    def _living(self) -> "subprocess.Popen[bytes] | None":
        """The process, which is started if there is none; None while closing."""
        with self._guard:
            if self._closing:
                return None
            if self._process is None or self._process.poll() is not None:
                self.state = "starting"
                self._sent.clear()
                if self._process is not None:
                    _ended(self._process)
                places = [place for place in sys.path if isinstance(place, str)]
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-c", _PROGRAM, json.dumps(places)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                )
            return self._process


# One for each call of `results`: units of a call that was given up are still played.
_Answers = queue.SimpleQueue[tuple[_Worker, Unit, _Answer]]


class Pool:
    """See the module's docstring."""

    def __init__(self, workers: int, on_state: OnState | None = None) -> None:
        """Takes the number of processes, which are started when there are units for them."""
        self._workers = [_Worker() for _ in range(workers)]
        self._lost = 0
        self._on_state = on_state

    def results(
        self, function: Function[_Result], units: Iterable[Unit]
    ) -> Iterator[tuple[Unit, _Result]]:
        """The units with their results, in the order in which they end.

        Raises:
          WorkError: a unit failed, or lost its worker three times.
        """
        waiting, attempts = queue_of(units), dict[Unit, int]()
        idle, playing = deque(self._workers), 0
        answers = _Answers()
        while waiting or playing:
            while idle and waiting:
                idle.popleft().give(function, waiting.popleft(), answers)
                playing += 1
            worker, unit, answer = self._next_answer(answers)
            playing -= 1
            idle.append(worker)
            if isinstance(answer, _Lost):
                self._lost += 1
                attempts[unit] = attempts.get(unit, 0) + 1
                if attempts[unit] == _ATTEMPTS:
                    raise WorkError(_too_often(unit, answer))
                waiting.appendleft(unit)
                continue
            value = value_of(answer)
            if waiting:  # now, so that the worker plays while the caller writes
                idle.pop().give(function, waiting.popleft(), answers)
                playing += 1
            yield unit, value

    def close(self) -> None:
        """Ends all processes at once; may be called twice."""
        for worker in self._workers:
            worker.stop()
        for worker in self._workers:
            worker.join()

    def __enter__(self) -> "Pool":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _next_answer(self, answers: _Answers) -> tuple[_Worker, Unit, _Answer]:
        """Waits for an answer, and reports the workers' state meanwhile."""
        while True:
            if self._on_state is not None:
                states = [worker.state for worker in self._workers]
                counts = states.count("playing"), states.count("starting")
                self._on_state(State(len(states), *counts, self._lost))
            try:
                return answers.get(timeout=_LOOK)
            except queue.Empty:
                pass


def _too_often(unit: Unit, lost: _Lost) -> str:
    return (
        f"{unit} lost {_ATTEMPTS} workers on node {socket.gethostname()}, the last one by "
        f"{lost.how}"
    )


def _ended(process: "subprocess.Popen[bytes]") -> int:
    """The return code of a process, which is killed unless it has ended."""
    process.kill()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):  # what was buffered for a process that has ended
                stream.close()
    return process.wait()
