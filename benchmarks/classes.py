"""The classes of the suite's tasks: heavy and toy, by MuJoCo's own time per step.

    python benchmarks/classes.py        # writes results/classes.json

Heavy tasks take 15 us or more per step of one row on one thread. What Python adds to a step of a
batch hardly shows there, while for toys it is a good part: the bars of `suite_speed.py` differ. The
list is made once and committed, so that a task does not change its class from run to run.
"""

import json
import statistics
import time
from typing import Any

import mujoco.batch
import numpy as np
import sources
import typer

from limberjack import suite

__all__ = ["is_heavy", "main"]

_FILE = sources.RESULTS / "classes.json"
_HEAVY = 15  # microseconds per control step of one row
_ROWS = 64
_STEPS = 20  # of a round, after as many that are not timed
_ROUNDS = 9


def is_heavy(domain: str, task: str) -> bool:
    """Whether a task is heavy according to the committed list."""
    return json.loads(_FILE.read_text(encoding="utf-8"))[f"{domain}:{task}"] >= _HEAVY


def _microseconds(domain: str, task: str) -> float:
    """MuJoCo's time per control step of one row, the median of several rounds."""
    env: Any = suite.load(domain, task, {"random": 0})
    env.reset()
    physics = env.physics
    batch = mujoco.batch.Batch(physics.model._official, _ROWS, 1)
    batch.state[...] = physics.get_state(mujoco.mjtState.mjSTATE_INTEGRATION.value)
    random = np.random.RandomState(0)
    rounds = []
    for _ in range(_ROUNDS):
        batch.ctrl = random.uniform(-1, 1, (_ROWS, physics.model.nu))
        batch.step(nstep=_STEPS * env._n_sub_steps)
        start = time.perf_counter()
        batch.step(nstep=_STEPS * env._n_sub_steps)
        rounds.append((time.perf_counter() - start) / _STEPS / _ROWS)
    return 1e6 * statistics.median(rounds)


def main() -> None:
    """Measure all tasks and write the list."""
    found = {}
    for domain, task in suite.ALL_TASKS:
        found[f"{domain}:{task}"] = round(_microseconds(domain, task), 1)
        typer.echo(f"{domain}:{task} {found[f'{domain}:{task}']} us")
    sources.write(_FILE, found)


if __name__ == "__main__":
    typer.run(main)
