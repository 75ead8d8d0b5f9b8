"""Time per plan, by number of threads, and the share spent outside MuJoCo.

    python benchmarks/planner.py [--quick] [--json FILE]

One planner per number of threads plans in the same states of one environment, in turns; all must
choose the same actions. Timings include the whole of `Planner.act`. The exit status is 1 if a bar
is missed.
"""

import dataclasses
import statistics
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

import mujoco
import mujoco.batch
import numpy as np
import peers
import typer
from report import Json, Quick, Row, at_most, finish, spread

from limberjack import suite
from limberjack.planner import Planner
from limberjack.utils.cores import usable_cores

__all__ = ["main", "measure"]

_Task = tuple[str, str]

_CONTROL_STEPS = 2  # maximum wall time of a plan
_THREADS_OF_THE_BAR = 4
_IN_TIME = at_most(1)
_NUMPY = at_most(5)  # per cent of a plan

_SEED = 1_000  # not one of the seeds used for scores
_WARM_UP = 3  # plans that are not timed
# MuJoCo's functions: those of batches, and of the single simulation that some costs step.
_CALLS = [(mujoco.batch.Batch, name) for name in ("step", "rollout", "forward", "reset")]
_CALLS += [(mujoco, name) for name in ("mj_step", "mj_step1", "mj_step2", "mj_forward")]


@dataclasses.dataclass(frozen=True)
class _Timing:
    """Timing of one plan, seconds."""

    whole: float
    in_mujoco: float


class _Stopwatch:
    """Time spent in MuJoCo."""

    seconds = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        """Context in which each MuJoCo call is timed."""
        with ExitStack() as patches:
            for place, name in _CALLS:
                timed = self._timed(getattr(place, name))
                patches.enter_context(mock.patch.object(place, name, timed))
            yield

    def _timed(self, original: Any) -> Any:
        def call(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            try:
                return original(*args, **kwargs)
            finally:
                self.seconds += time.perf_counter() - start

        return call


def measure(task: _Task, threads: list[int], plans: int) -> list[Row]:
    """The rows of a task: plan times for each number of threads, and NumPy's share."""
    env = suite.load(*task, task_kwargs={"random": _SEED})
    taken = _play(env, {count: Planner(env, count, _SEED) for count in threads}, plans)
    limit = _CONTROL_STEPS * env.control_timestep()
    subject = ":".join(task)
    rows = [_row_of_threads(subject, count, taken, limit) for count in threads]
    alone = taken[threads[0]]
    parts = [100 * (1 - timing.in_mujoco / timing.whole) for timing in alone]
    rows.append(
        Row(
            measure="not MuJoCo's, of a plan",
            subject=f"{subject}, {threads[0]} thread",
            ours=1e3 * statistics.median(t.whole - t.in_mujoco for t in alone),
            theirs=1e3 * statistics.median(t.in_mujoco for t in alone),
            unit="ms",
            value=statistics.median(parts),
            value_unit="%",
            bar=_NUMPY,
            details={"per_cent": spread(parts)},
        )
    )
    return rows


def _row_of_threads(
    subject: str, threads: int, taken: Mapping[int, list[_Timing]], limit: float
) -> Row:
    seconds = [timing.whole for timing in taken[threads]]
    of_one = [timing.whole for timing in taken[min(taken)]]
    speedups = [slow / fast for slow, fast in zip(of_one, seconds, strict=True)]
    return Row(
        measure="plan / two control steps",
        subject=f"{subject}, {threads} thread{'s' if threads > 1 else ''}",
        ours=1e3 * statistics.median(seconds),
        theirs=1e3 * limit,
        unit="ms",
        value=statistics.median(seconds) / limit,
        bar=_IN_TIME if threads == _THREADS_OF_THE_BAR else None,
        details={
            "ms": spread([1e3 * s for s in seconds]),
            "times_one_thread": statistics.median(speedups),
        },
    )


def _play(env: Any, planners: dict[int, Planner], plans: int) -> dict[int, list[_Timing]]:
    """Times `plans` plans of each planner during one episode.

    Raises:
      RuntimeError: the planners chose different actions.
    """
    stopwatch = _Stopwatch()
    taken: dict[int, list[_Timing]] = {count: [] for count in planners}
    interval = next(iter(planners.values())).settings.interval
    order = list(planners)
    env.reset()
    with stopwatch.running():
        for step in range(-_WARM_UP * interval, plans * interval):
            actions = {}
            for count in order:
                start, before = time.perf_counter(), stopwatch.seconds
                actions[count] = planners[count].act()
                whole, in_mujoco = time.perf_counter() - start, stopwatch.seconds - before
                if step >= 0 and step % interval == 0:
                    taken[count].append(_Timing(whole, in_mujoco))
            chosen = actions[order[0]]
            if not all(np.array_equal(chosen, action) for action in actions.values()):
                raise RuntimeError(f"step {step}: the number of threads changed the action")
            env.step(chosen)
            order.append(order.pop(0))
    return taken


def main(
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Measure plans for ten tasks, or one in a quick run, and print each bar."""
    most = usable_cores()
    threads = sorted({1, most, *(n for n in (2, _THREADS_OF_THE_BAR) if n <= most)})
    plans = 2 if quick else 40
    rows: list[Row] = []
    for task in peers.first_tasks()[: 1 if quick else None]:
        typer.echo(f"measuring: {':'.join(task)}", err=True)
        rows += measure(task, threads, plans)
    rows.sort(key=lambda row: row.measure)
    finish(rows, "limit, MuJoCo", quick, json, {"threads": threads, "plans": plans})


if __name__ == "__main__":
    typer.run(main)
