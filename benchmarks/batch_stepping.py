"""Steps per second of batches: ours, MuJoCo alone, EnvPool, and Gymnasium's processes.

In one cell (a task and a number of rows), all packages do the same number of steps with the same
actions, alternating in blocks of steps; see `limberjack.bench`. Our batch and MuJoCo alone must
reach the same states; EnvPool draws other starts and only does the same number of steps.

The bars against EnvPool apply with as many cores as threads: EnvPool's calling thread works in
addition to its threads, so on a machine with idle cores it uses one core more than requested. That
comparison is measured too, and shown without a bar.

MuJoCo alone means a persistent `mujoco.batch.Batch` with nothing bound. Only a persistent batch can
provide the positions and velocities of its new state, as ours does, at no cost. One that is not
persistent is faster if memory is slow, since fewer `MjData` pass through the caches; the comparison
with it is shown too.
"""

import contextlib
import os
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import batch_peers
import numpy as np
from report import Bar, Row, at_least, compared, mean_of, rates, spread

from limberjack import bench

__all__ = [
    "BARE",
    "BATCHED",
    "OURS",
    "SIZES",
    "THEIRS",
    "Cell",
    "Cells",
    "Times",
    "beside_envpool",
    "measure_processes",
]

SIZES: tuple[int, ...] = (64, 256, 1024)

# Over MuJoCo's own `Batch.step`, by number of rows.
_BATCH = {64: at_least(0.90), 256: at_least(0.94), 1024: at_least(0.95)}
_VECTOR = {64: at_least(0.88), 256: at_least(0.92), 1024: at_least(0.94)}
_ENVPOOL = at_least(1.2)  # on each task
_ENVPOOL_ON_AVERAGE = at_least(1.35)  # the geometric mean of the tasks
_PROCESSES = at_least(4)

_NUM_ENVS_BESIDE_PROCESSES = 256
# Blocks of one simulation per process are lengthened to be measurable.
_BLOCKS_OF_PROCESSES = 16

_Task = tuple[str, str]
Cell = tuple[str, str, int]  # domain, task and number of rows
Times = dict[str, list[float]]  # seconds per step of each round, by name

# The players of `bench.Contest`, and the other package.
_PHYSICS, BARE, BATCHED, OURS = "physics", "persistent_physics", "batch", "vector"
THEIRS = "peer"
# Comparisons with EnvPool, on as many cores as threads and on all cores.
_OURS_BOUND, _THEIRS_BOUND = "vector_bound", "peer_bound"
_OURS_FREE, _THEIRS_FREE = "vector_free", "peer_free"


class Cells:
    """All tasks and sizes; repeated measurements are pooled."""

    def __init__(
        self, tasks: Sequence[_Task], sizes: Sequence[int], num_threads: int, peer: Path | None
    ) -> None:
        """Measures nothing yet.

        Args:
          tasks: domain and name of each task.
          sizes: numbers of rows, from `SIZES`.
          num_threads: number of threads of each package.
          peer: EnvPool's folder; None to omit it.
        """
        self.all: list[Cell] = [(*task, size) for size in sizes for task in tasks]
        self._num_threads = num_threads
        self._peer = peer
        self._taken: dict[Cell, Times] = {}
        self._loads: dict[Cell, list[float]] = {}
        self.versions: dict[str, str] = {}

    def measure(self, cell: Cell, seconds: float, min_rounds: int, warm_up_steps: int) -> None:
        """Measures a cell, and adds to earlier measurements."""
        effort = seconds, min_rounds, warm_up_steps
        with bench.Contest(*cell, self._num_threads) as contest:
            names = (_PHYSICS, BARE, BATCHED, OURS)
            players: dict[str, bench.Player] = {name: getattr(contest, name) for name in names}
            taken = bench.take_turns(players, contest.actions, *effort)
        if self._peer is not None:
            given = cell, self._num_threads, self._peer, effort, self.versions
            bound, free = beside_envpool(*given)
            taken |= {_OURS_BOUND: bound[OURS], _THEIRS_BOUND: bound[THEIRS]}
            taken |= {_OURS_FREE: free[OURS], _THEIRS_FREE: free[THEIRS]}
        pooled = self._taken.setdefault(cell, {})
        for name, times in taken.items():
            pooled.setdefault(name, []).extend(times)
        self._loads.setdefault(cell, []).append(os.getloadavg()[0])

    def doubtful(self) -> list[Cell]:
        """The cells in which a bar was missed, to be measured again under a different load."""
        missed = {row.subject for row in self.rows() if row.is_met is False}
        return [cell for cell in self._taken if _subject(cell) in missed]

    def rows(self) -> list[Row]:
        """Rows for all measurements so far."""
        rows = []
        for what, ours, bars in (("batch", BATCHED, _BATCH), ("vector", OURS, _VECTOR)):
            measure = f"{what} / MuJoCo alone"
            rows += [self._row(measure, cell, ours, BARE, bars) for cell in self._taken]
            rows += self._means(f"{what} / not persistent", ours, _PHYSICS, None)
        if self._peer is not None:
            bars = dict.fromkeys(SIZES, _ENVPOOL)
            measure, sides = "vector / EnvPool", (_OURS_BOUND, _THEIRS_BOUND)
            rows += [self._row(measure, cell, *sides, bars) for cell in self._taken]
            rows += self._means(measure, *sides, _ENVPOOL_ON_AVERAGE)
            rows += self._means(f"{measure} on all cores", _OURS_FREE, _THEIRS_FREE, None)
        return rows

    def _means(self, measure: str, ours: str, theirs: str, bar: Bar | None) -> list[Row]:
        """The geometric mean over the tasks for each number of rows."""
        means = []
        for size in dict.fromkeys(cell[2] for cell in self._taken):
            cells = [cell for cell in self._taken if cell[2] == size]
            of_size = [self._row(measure, cell, ours, theirs, {}) for cell in cells]
            means.append(mean_of(of_size, f"geometric mean, N={size}", bar))
        return means

    def _row(self, measure: str, cell: Cell, ours: str, theirs: str, bars: dict[int, Bar]) -> Row:
        taken, num_envs = self._taken[cell], cell[2]
        details: dict[str, Any] = {"load_average": self._loads[cell]}
        if theirs == BARE:
            details["ratio_to_not_persistent"] = spread(_ratios(taken[_PHYSICS], taken[ours]))
            added = [a - b for a, b in zip(taken[ours], taken[theirs], strict=True)]
            details["added_us"] = 1e6 * statistics.median(added)
        if theirs == _THEIRS_BOUND:
            details["ratio_on_all_cores"] = spread(_ratios(taken[_THEIRS_FREE], taken[_OURS_FREE]))
        sides = rates(taken[ours], num_envs), rates(taken[theirs], num_envs)
        return compared(measure, _subject(cell), *sides, "/s", bars.get(num_envs), details)


def beside_envpool(
    cell: Cell,
    num_threads: int,
    folder: Path,
    effort: tuple[float, int, int],
    versions: dict[str, str],
) -> tuple[Times, Times]:
    """Seconds per step beside EnvPool, on as many cores as threads and on all cores.

    Args:
      cell: domain, task and number of rows.
      num_threads: of each package.
      folder: in which EnvPool is installed.
      effort: seconds, the fewest rounds, and the number of steps before them.
      versions: receives those of EnvPool and of its MuJoCo.
    """

    def measured() -> Times:
        with (
            bench.Contest(*cell, num_threads) as contest,
            batch_peers.Peer(batch_peers.ENVPOOL, folder, *cell, num_threads=num_threads) as peer,
        ):
            versions[peer.name] = f"MuJoCo {peer.mujoco}"
            # The batch only for the check that what is timed does the same steps.
            players = {name: getattr(contest, name) for name in (BARE, BATCHED, OURS)}
            return bench.take_turns({**players, THEIRS: peer.play}, contest.actions, *effort)

    with _kept_to(num_threads):
        bound = measured()
    return bound, measured()


@contextlib.contextmanager
def _kept_to(num_cores: int) -> Iterator[None]:
    """Restricts processes and threads started in the context to some cores, if supported."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:num_cores])
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def measure_processes(
    tasks: Sequence[_Task],
    num_threads: int,
    folder: Path,
    seconds: float,
    min_rounds: int,
    versions: dict[str, str],
) -> list[Row]:
    """Our vector environment against one process per core with a dm_control simulation each.

    Args:
      tasks: domain and name of each task.
      num_threads: number of our threads, and of processes.
      folder: the folder in which the peer is installed.
      seconds: time for each task.
      min_rounds: minimum number of rounds for each task.
      versions: receives the versions of the packages.
    """
    rows = []
    for domain, task in tasks:
        num_envs = _NUM_ENVS_BESIDE_PROCESSES
        with (
            bench.Contest(domain, task, num_envs, num_threads) as contest,
            batch_peers.Peer(
                batch_peers.ASYNC, folder, domain, task, num_threads, num_threads
            ) as peer,
        ):
            versions[peer.name] = f"MuJoCo {peer.mujoco}"

            def play(actions: np.ndarray, peer: batch_peers.Peer = peer) -> float:
                longer = np.concatenate([actions] * _BLOCKS_OF_PROCESSES)
                return peer.play(longer) / _BLOCKS_OF_PROCESSES

            # The batch only for the check that what is timed does the same steps.
            players = {BATCHED: contest.batch, OURS: contest.vector, THEIRS: play}
            taken = bench.take_turns(players, contest.actions, seconds, min_rounds)
        ours, theirs = rates(taken[OURS], num_envs), rates(taken[THEIRS], num_threads)
        subject, details = f"{domain}:{task}, {num_threads} processes", {"our_num_envs": num_envs}
        measure = "vector / AsyncVectorEnv"
        rows.append(compared(measure, subject, ours, theirs, "/s", _PROCESSES, details))
    return [*rows, mean_of(rows, "geometric mean")]


def _ratios(theirs: Sequence[float], ours: Sequence[float]) -> list[float]:
    """Our speedup in each round."""
    return [b / a for a, b in zip(ours, theirs, strict=True)]


def _subject(cell: Cell) -> str:
    return f"{cell[0]}:{cell[1]}, N={cell[2]}"
