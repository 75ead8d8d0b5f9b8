"""Two halves of a batch: a worker thread for each, and their results joined.

The threads belong to `concurrent.futures`, which the interpreter joins before it exits, so that
none is stopped in the middle of a step. They start with the first `send`, and step in turn: each
half uses all the threads of its batch.
"""

import collections
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar, cast

import numpy as np

__all__ = ["Workers", "joined"]

_T = TypeVar("_T")  # arrays, or dicts of them
_R = TypeVar("_R")  # the result of a job


class Workers(Generic[_R]):
    """A thread for each half; results are received in the order in which jobs are sent."""

    def __init__(self, count: int) -> None:
        """Make `count` workers, without starting their threads."""
        self._count = count
        self._forget()

    def _forget(self) -> None:
        self._process = os.getpid()
        self._threads: dict[int, ThreadPoolExecutor] = {}
        self._sent: collections.deque[tuple[int, Future[_R]]] = collections.deque()
        self._turn = threading.Lock()

    @property
    def busy(self) -> list[int]:
        """The halves that were sent and not yet received, in that order."""
        if self._process != os.getpid():  # forked: threads stay in the parent
            self._forget()
        return [half for half, _ in self._sent]

    def check_idle(self) -> None:
        """Raise RuntimeError if a half was sent and not yet received."""
        if self.busy:
            raise RuntimeError(f"halves {self.busy} were sent: receive them with recv() first")

    def send(self, half: int, job: Callable[..., _R], *given: object) -> None:
        """Have a half's thread call `job(*given)`."""
        if half in self.busy:
            raise RuntimeError(f"half {half} was sent already: receive it with recv() first")
        if half not in self._threads:
            self._threads[half] = ThreadPoolExecutor(1, f"limberjack-half-{half}")
        future = self._threads[half].submit(_in_turn, self._turn, job, given)
        self._sent.append((half, future))

    def receive(self) -> tuple[int, _R]:
        """The half that was sent first, and the result of its job, whose error it raises.

        Ctrl-C while it waits loses nothing: the next call waits for the same half.
        """
        if not self.busy:
            raise RuntimeError("nothing was sent in this process: call send() before recv()")
        half, future = self._sent[0]
        future.exception()  # waits
        self._sent.popleft()
        return half, future.result()

    def close(self) -> None:
        """Wait for running jobs and end the threads."""
        if self._process == os.getpid():
            for thread in self._threads.values():
                thread.shutdown()
        self._forget()

    def __getstate__(self) -> dict[str, int]:
        return {"count": self._count}

    def __setstate__(self, state: dict[str, int]) -> None:
        self.__init__(state["count"])


def _in_turn(turn: threading.Lock, job: Callable[..., _R], given: Iterable[object]) -> _R:
    with turn:
        return job(*given)


def joined(parts: Sequence[_T | None], sizes: Sequence[int]) -> _T:
    """Arrays, or equally named dicts of them, one after the other along the first axis.

    Args:
      parts: one for each half; None for a half without one, whose rows are zeros, or None in an
        array of objects.
      sizes: rows of each half.
    """
    given = next(part for part in parts if part is not None)
    if isinstance(given, dict):
        dicts = [part if isinstance(part, dict) else {} for part in parts]
        names = dict.fromkeys(name for part in dicts for name in part)
        named = {name: joined([part.get(name) for part in dicts], sizes) for name in names}
        return cast(_T, named)
    like = cast(np.ndarray, given)
    filled = [
        _nothing(like, size) if part is None else cast(np.ndarray, part)
        for part, size in zip(parts, sizes, strict=True)
    ]
    return cast(_T, np.concatenate(filled))


def _nothing(like: np.ndarray, size: int) -> np.ndarray:
    shape = (size, *like.shape[1:])
    return np.full(shape, None) if like.dtype == object else np.zeros(shape, like.dtype)
