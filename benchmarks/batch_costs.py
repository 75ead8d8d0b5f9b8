"""Costs and gains of batches besides stepping: resets, threads, memory and pipelining."""

import os
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import fresh
import numpy as np
import peers
from report import Row, at_least, at_most, compared, figure, rates, spread

from limberjack import bench
from limberjack.gym.loading import load_vector

__all__ = [
    "free_cores",
    "measure_memory",
    "measure_pipelining",
    "measure_resets",
    "measure_threads",
]

_RESETS = at_most(2)  # per cent of an episode
_OF_EACH_THREAD = 0.9  # of the speed of one thread
_MEMORY = at_most(0.3)  # megabytes for one more row of the humanoid
_PIPELINING = at_least(1.6)  # times the plain loop

_STEPS_PER_EPISODE = 1_000
_NUM_ENVS = 256
_SEED = 0
_MEASURED_TASK = ("humanoid", "walk")
_STEPS_BEFORE_WEIGHING = 30  # the humanoid falls, and contacts take memory

_Task = tuple[str, str]


def free_cores(seconds: float = 1.0) -> int:
    """Idle cores, at least 1; all cores on systems other than Linux."""
    before = _idle_seconds()
    if before is None:
        return os.cpu_count() or 1
    time.sleep(seconds)
    after = _idle_seconds()
    assert after is not None
    return max(1, round((after - before) / seconds))


def _idle_seconds() -> float | None:
    """Total idle time of all cores, seconds."""
    try:
        with open("/proc/stat", encoding="ascii") as file:
            return int(file.readline().split()[4]) / os.sysconf("SC_CLK_TCK")
    except OSError:
        return None


def measure_resets(
    tasks: Sequence[_Task], num_threads: int, num_resets: int, seconds: float
) -> list[Row]:
    """Simultaneous starts of all rows, relative to the steps of an episode.

    Args:
      tasks: domain and name of each task.
      num_threads: number of stepping threads; starts are drawn one after the other.
      num_resets: number of resets of all rows.
      seconds: time for the steps of each task.
    """
    rows = []
    for domain, task in tasks:
        with bench.Contest(domain, task, _NUM_ENVS, num_threads) as contest:
            players = {"batch": contest.batch, "vector": contest.vector}
            taken = bench.take_turns(players, contest.actions, seconds)
            resets = [_seconds_of(contest.environment.reset) for _ in range(num_resets)]
            for _ in range(num_resets):  # so that both are in the same state at the end
                contest.vector_env.reset()
        episode = _STEPS_PER_EPISODE * statistics.median(taken["batch"])
        rows.append(
            Row(
                measure="reset of all / episode",
                subject=f"{domain}:{task}, N={_NUM_ENVS}",
                ours=1e3 * statistics.median(resets),
                theirs=1e3 * episode,
                unit="ms",
                value=100 * statistics.median(resets) / episode,
                value_unit="%",
                bar=_RESETS,
                details={"num_threads": num_threads},
            )
        )
    return rows


def measure_threads(tasks: Sequence[_Task], most: int, seconds: float) -> list[Row]:
    """Speedup by threads, relative to that of MuJoCo alone.

    Args:
      tasks: domain and name of each task.
      most: maximum number of threads, that of idle cores.
      seconds: time for each task and number of threads.
    """
    counts = sorted({*(2**i for i in range(most.bit_length())), most} - {1})
    return [_threads_row(*task, count, seconds) for task in tasks for count in counts]


def _threads_row(domain: str, task: str, count: int, seconds: float) -> Row:
    with (
        bench.Contest(domain, task, _NUM_ENVS, 1) as one,
        bench.Contest(domain, task, _NUM_ENVS, count) as more,
    ):
        players = {
            "alone, 1": one.physics,
            "alone": more.physics,
            "batch, 1": one.batch,
            "batch": more.batch,
            "vector, 1": one.vector,
            "vector": more.vector,
        }
        taken = bench.take_turns(players, one.actions, seconds)
    gains = {
        name: spread([a / b for a, b in zip(taken[f"{name}, 1"], taken[name], strict=True)])
        for name in ("alone", "batch", "vector")
    }
    ours, theirs = (rates(taken[name], _NUM_ENVS) for name in ("vector", "vector, 1"))
    subject, bar = f"{domain}:{task}, N={_NUM_ENVS}", at_least(_OF_EACH_THREAD * count)
    return compared(f"{count} threads / 1", subject, ours, theirs, "/s", bar, gains)


def measure_memory(num_envs: int) -> list[Row]:
    """Memory per row, from the difference between processes with `num_envs` and half as many."""
    sizes = {
        count: fresh.call(
            "footprint",
            "megabytes_of_batch",
            *_MEASURED_TASK,
            count,
            _STEPS_BEFORE_WEIGHING,
            variables=peers.WITHOUT_OPENGL,
        )
        for count in (num_envs // 2, num_envs)
    }
    few, many = sizes.values()
    value = None if few is None or many is None else (many - few) / (num_envs - num_envs // 2)
    subject = f"{':'.join(_MEASURED_TASK)}, N={num_envs}"
    details = {"megabytes": {str(count): size for count, size in sizes.items()}}
    return [figure("memory of one more row", subject, value, "MB", _MEMORY, details)]


def measure_pipelining(
    tasks: Sequence[_Task], num_threads: int, num_steps: int, num_rounds: int
) -> list[Row]:
    """Two alternating halves against a plain loop, with a policy that waits as for a GPU.

    Args:
      tasks: domain and name of each task.
      num_threads: number of stepping threads.
      num_steps: steps of each loop.
      num_rounds: rounds of both loops.
    """
    return [_pipelining_row(*task, num_threads, num_steps, num_rounds) for task in tasks]


def _pipelining_row(
    domain: str, task: str, num_threads: int, num_steps: int, num_rounds: int
) -> Row:
    plain, halves = (
        load_vector(
            domain,
            task,
            _NUM_ENVS,
            num_threads=num_threads,
            flat=True,
            dtype="float32",
            pipelined=pipelined,
        )
        for pipelined in (False, True)
    )
    shape = _NUM_ENVS, *plain.batches[0].action_spec().shape[1:]
    actions = np.random.RandomState(_SEED).uniform(-1, 1, (num_steps, *shape))
    seconds: dict[str, list[float]] = {"plain": [], "halves": []}
    waits = []
    for number in range(num_rounds):
        plain.reset(seed=number)
        # The policy waits as long as the steps of all rows take under the machine's current load.
        wait = _seconds_of(_plain_loop, plain, actions, 0.0) / num_steps
        for name, loop, env in (("plain", _plain_loop, plain), ("halves", _two_halves, halves)):
            env.reset(seed=number)
            seconds[name].append(_seconds_of(loop, env, actions, wait))
        waits.append(wait)
    plain.close()
    halves.close()
    ours, theirs = (rates(seconds[n], num_steps * _NUM_ENVS) for n in ("halves", "plain"))
    subject = f"{domain}:{task}, N={_NUM_ENVS}"
    details = {"policy_waits_ms": 1e3 * statistics.median(waits)}
    return compared("two halves / plain loop", subject, ours, theirs, "/s", _PIPELINING, details)


def _plain_loop(env: Any, actions: np.ndarray, wait: float) -> None:
    for action in actions:
        if wait:
            time.sleep(wait)
        env.step(action)


def _two_halves(env: Any, actions: np.ndarray, wait: float) -> None:
    """The same number of steps, rows and policy waits as `_plain_loop`, in two halves."""
    for half, rows in enumerate(env.halves):
        time.sleep(wait / 2)
        env.send(actions[0][rows], half)
    for action in actions[1:]:
        for half, rows in enumerate(env.halves):
            env.recv()
            time.sleep(wait / 2)
            env.send(action[rows], half)
    for _ in env.halves:
        env.recv()


def _seconds_of(function: Callable[..., Any], *arguments: Any) -> float:
    start = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - start
