"""Worker processes as tests find, count and kill them."""

import random
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from limberjack.workers import OnState, scale
from limberjack.workers.pool import Pool

__all__ = [
    "children",
    "is_alive",
    "kill_often",
    "kill_workers_of",
    "marked",
    "shared_memory",
    "wait_for",
]

_LIMIT = 300  # seconds; machines that run the tests may be busy


def is_alive(number: int) -> bool:
    """Whether a process with this number runs."""
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def children(number: int) -> list[int]:
    """Processes whose parent is this one."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has just ended
            continue
        if parent == number:
            found.append(int(path.parent.name))
    return found


def marked(variable: str) -> list[int]:
    """Processes that were started with this 'NAME=VALUE' in their environment."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            variables = path.read_bytes().split(b"\0")
        except OSError:  # it has just ended
            continue
        if variable.encode() in variables and is_alive(int(path.parent.name)):
            found.append(int(path.parent.name))
    return found


def shared_memory(number: int) -> list[str]:
    """Mappings of files in shared memory of a process."""
    maps = Path(f"/proc/{number}/maps").read_text()
    return [line for line in maps.splitlines() if "/dev/shm" in line]


def wait_for(condition: Callable[[], object]) -> None:
    """Waits until the condition holds; fails if it does not after five minutes."""
    end = time.monotonic() + _LIMIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def kill_often(pool: Pool, done: threading.Event, most: int, longest: float = 0.3) -> int:
    """Kills workers at random moments, also as they start; returns the number of kills.

    Args:
      pool: whose workers are killed.
      done: ends it.
      most: kills.
      longest: seconds between two kills.
    """
    chance, lost, kills = random.Random(1), dict[int, int](), 0
    while kills < most and not done.wait(chance.uniform(0.0, longest)):
        worker = chance.choice(pool._workers)
        with worker._guard:
            process, unit = worker._process, worker.unit
            # A unit may lose two workers, not three.
            if process is None or process.poll() is not None or lost.get(id(unit), 0) == 2:
                continue
            lost[id(unit)] = lost.get(id(unit), 0) + 1
            process.send_signal(signal.SIGKILL)
            process.wait()  # otherwise it might be killed twice, or be given the next unit
            kills += 1
    return kills


class _Killed(Pool):
    """A pool whose workers are killed while it is open."""

    def __init__(self, workers: int, on_state: OnState | None, most: int, kills: list[int]) -> None:
        super().__init__(workers, on_state)
        self._done = threading.Event()
        self._killer = threading.Thread(
            target=lambda: kills.append(kill_often(self, self._done, most, longest=1.0))
        )
        self._killer.start()

    def close(self) -> None:
        """Ends the killing too."""
        self._done.set()
        self._killer.join()
        super().close()


def kill_workers_of(monkeypatch: pytest.MonkeyPatch, most: int) -> list[int]:
    """Kills so many workers of each pool that is opened from now on; their number is appended."""
    kills: list[int] = []

    def opened(workers: int, on_state: OnState | None) -> Pool:
        return _Killed(workers, on_state, most, kills)

    monkeypatch.setattr(scale, "Pool", opened)
    return kills
