"""`RowThreads`: threads that each step the same rows of a batch every time.

    threads = RowThreads(num_rows=64, num_threads=2)
    errors = threads.each(step_row)         # step_row(row) for all rows; returns when all are done

Each row keeps its thread, so what a row's environment keeps per thread stays valid. A thread runs
in the caller's context, for `np.errstate`. With one thread the caller steps the rows, in order. The
threads are those of `concurrent.futures`, which the interpreter joins before it exits. They
start with the first use, and again after a fork or in a copy.
"""

import concurrent.futures
import contextvars
import itertools
import os
from collections.abc import Callable, Sequence

import numpy as np

__all__ = ["RowThreads"]


class RowThreads:
    """See the module's docstring."""

    def __init__(self, num_rows: int, num_threads: int) -> None:
        self.num_threads = num_threads
        self._num_rows = num_rows
        bounds = np.linspace(0, num_rows, num_threads + 1).round().astype(int).tolist()
        self._shares = list(itertools.pairwise(bounds))
        self._forget()

    def _forget(self) -> None:
        self._process = os.getpid()
        self._threads: list[concurrent.futures.ThreadPoolExecutor] = []

    def each(
        self, job: Callable[[int], object], rows: Sequence[int] | None = None
    ) -> list[tuple[int, BaseException]]:
        """Calls `job(row)` for rows, all by default; returns the errors, by row.

        Every row is tried. An interrupt of the caller is raised once all threads have returned.
        """
        if self.num_threads == 1:
            return _run(job, range(self._num_rows) if rows is None else rows)
        if self._process != os.getpid():  # forked: threads stay in the parent
            self._forget()
        if not self._threads:
            threads = [
                concurrent.futures.ThreadPoolExecutor(1, f"limberjack-rows-{number}")
                for number in range(self.num_threads)
            ]
            for thread in threads:  # starts it; one interrupted as it starts would get a second one
                thread.submit(int).result()
            self._threads = threads
        try:
            started = []
            for thread, (first, end) in zip(self._threads, self._shares, strict=True):
                if rows is None:
                    share: Sequence[int] = range(first, end)
                else:
                    share = [row for row in rows if first <= row < end]
                if share:
                    context = contextvars.copy_context()
                    started.append(thread.submit(context.run, _run, job, share))
            return [error for future in started for error in future.result()]
        except BaseException:  # an interrupt of the caller: the threads go on
            self._wait()
            raise

    def _wait(self) -> None:
        """Waits until the threads have done all they were given, through interrupts too."""
        for thread in self._threads:
            while True:
                try:
                    # An interrupted `submit` returns nothing, but what comes next is done last.
                    thread.submit(int).result()
                    break
                except KeyboardInterrupt:
                    continue

    def close(self) -> None:
        """Ends the threads."""
        if self._process == os.getpid():
            for thread in self._threads:
                thread.shutdown()
        self._forget()

    def __reduce__(self) -> tuple[type["RowThreads"], tuple[int, int]]:
        return type(self), (self._num_rows, self.num_threads)


def _run(job: Callable[[int], object], rows: Sequence[int]) -> list[tuple[int, BaseException]]:
    errors: list[tuple[int, BaseException]] = []
    for row in rows:
        try:
            job(row)
        except BaseException as error:  # of any class: it is the user's code
            errors.append((row, error))
            if not isinstance(error, Exception):  # an interrupt, or the user's exit
                break
    return errors
