"""Memory growth over time, and memory per environment.

    python benchmarks/memory.py [--steps 1000000] [--loads 5000] [--cycles 1000]

Each figure comes from a separate process. `python benchmarks/overhead.py` shows the same rows.
"""

import ctypes
import importlib
import sys
from collections.abc import Callable
from typing import Annotated, Any

import footprint
import fresh
import peers
import typer
from report import Bar, Json, Row, at_most, figure, finish

__all__ = [
    "NUM_CYCLES",
    "NUM_LOADS",
    "NUM_STEPS",
    "measure",
    "megabytes_after_cycles",
    "megabytes_after_loads",
    "megabytes_after_steps",
    "megabytes_per_environment",
]

NUM_STEPS = 1_000_000
NUM_LOADS = 5_000
NUM_CYCLES = 1_000

# Megabytes by which the process may grow after warm-up. The allocator accounts for one or two; a
# leak of a kilobyte per load adds five, of an object per step fifty, and of a model twelve.
_FLAT = at_most(4)
# The same including the allocator's cache, as in the process of a user that creates one vector
# environment after the other. Leaves room for two models and their data.
_FLAT_AS_IT_IS = at_most(30)

_STEPS_PER_EPISODE = 1_000
_NUM_SAMPLES = 50
_WARM_UP_ROUNDS = 2  # of all tasks, before the first sample
_NUM_MORE_ENVIRONMENTS = 20
_ENVIRONMENTS_OF_A_VECTOR = 8
_TASK_OF_DOMAIN = (("humanoid", "walk"), ("manipulator", "bring_ball"), ("stacker", "stack_2"))


def measure(
    num_steps: int, num_loads: int, num_cycles: int, num_domains: int = len(_TASK_OF_DOMAIN)
) -> list[Row]:
    """All rows.

    Args:
      num_steps: total number of steps, alternating between all ten tasks.
      num_loads: total number of load-and-drop cycles, alternating between all ten tasks.
      num_cycles: total number of make-and-close cycles of vector environments of three tasks.
      num_domains: number of domains for which the memory of an environment is measured.
    """
    return [
        _growth_row(f"{num_steps:,} steps", "megabytes_after_steps", num_steps),
        _growth_row(f"{num_loads:,} loads and drops", "megabytes_after_loads", num_loads),
        _growth_row(
            f"{num_cycles:,} vector environments",
            "megabytes_after_cycles",
            num_cycles,
            series="resident",
            bar=_FLAT_AS_IT_IS,
        ),
        *(row for task in _TASK_OF_DOMAIN[:num_domains] for row in _environment_rows(*task)),
    ]


def _growth_row(
    subject: str, function: str, count: int, series: str = "in_use", bar: Bar = _FLAT
) -> Row:
    """Growth of a process after warm-up, from one of the series of `_sampled`."""
    found = fresh.call("memory", function, count, variables=peers.WITHOUT_OPENGL)
    first, last = found[series][0], found[series][-1]
    growth = None if first is None or last is None else last - first
    return figure("memory grows by", subject, growth, "MB", bar, {"megabytes": found})


def _environment_rows(domain: str, task: str) -> list[Row]:
    """Memory of the first environment of a task and of each further one, for information."""
    sizes = {}
    for package in peers.installed():
        call = "memory", "megabytes_per_environment", package, domain, task
        sizes[package] = fresh.call(*call, variables=peers.WITHOUT_OPENGL)
    rows = []
    for which in ("first", "one more"):
        ours, theirs = sizes[peers.OURS][which], sizes.get(peers.THEIRS, {}).get(which)
        ratio = ours / theirs if ours is not None and theirs else None
        subject, details = f"{domain}:{task}, {which}", {"megabytes": sizes}
        rows.append(Row("memory taken by", subject, ours, theirs, "MB", ratio, details=details))
    return rows


def megabytes_after_steps(num_steps: int) -> dict[str, list[float | None]]:
    """Memory over steps: one environment per task, alternating by episodes."""
    suite = peers.suite(peers.OURS)
    environments = [suite.load(*task, {"random": 0}) for task in suite.ALL_TASKS]
    actions = [environment.action_spec().generate_value() for environment in environments]
    length = max(1, min(_STEPS_PER_EPISODE, num_steps // len(environments)))

    def play(number: int) -> None:
        environment = environments[number % len(environments)]
        environment.reset()
        for _ in range(length):
            environment.step(actions[number % len(environments)])

    return _sampled(play, num_steps // length, _WARM_UP_ROUNDS * len(environments))


def megabytes_after_loads(num_loads: int) -> dict[str, list[float | None]]:
    """Memory over cycles of loading, resetting, stepping and dropping an environment."""
    suite = peers.suite(peers.OURS)

    def load(number: int) -> None:
        environment = suite.load(*suite.ALL_TASKS[number % len(suite.ALL_TASKS)], {"random": 0})
        environment.reset()
        environment.step(environment.action_spec().generate_value())

    return _sampled(load, num_loads, _WARM_UP_ROUNDS * len(suite.ALL_TASKS))


def megabytes_after_cycles(num_cycles: int) -> dict[str, list[float | None]]:
    """Memory over cycles of making, resetting, stepping and closing a vector environment.

    No memory is returned in between: `in_use` is the same as `resident`.
    """
    peers.suite(peers.OURS)
    gym = importlib.import_module("limberjack.gym")

    def cycle(number: int) -> None:
        task = _TASK_OF_DOMAIN[number % len(_TASK_OF_DOMAIN)]
        environments = gym.load_vector(*task, num_envs=_ENVIRONMENTS_OF_A_VECTOR)
        environments.reset(seed=0)
        environments.step(environments.action_space.sample())
        environments.close()

    return _sampled(cycle, num_cycles, _WARM_UP_ROUNDS * len(_TASK_OF_DOMAIN), gives_back=False)


def megabytes_per_environment(package: str, domain: str, task: str) -> dict[str, float | None]:
    """Memory of the first environment of a task and of each further one, reset and stepped."""
    suite = peers.suite(package)

    def used() -> Any:
        environment = suite.load(domain, task, {"random": 0})
        environment.reset()
        environment.step(environment.action_spec().generate_value())
        return environment

    sizes, kept = [footprint.megabytes()], []
    for count in (1, _NUM_MORE_ENVIRONMENTS):
        kept += [used() for _ in range(count)]
        sizes.append(footprint.megabytes())
    empty, first, more = sizes
    if empty is None or first is None or more is None:
        return dict.fromkeys(("first", "one more"))
    return {"first": first - empty, "one more": (more - first) / _NUM_MORE_ENVIRONMENTS}


def _sampled(
    work: Callable[[int], None], count: int, num_warm_up: int, gives_back: bool = True
) -> dict[str, list[float | None]]:
    """Memory during the work, after a warm-up.

    `resident` is the memory of the process. When models are created and freed, the allocator keeps
    a varying amount of up to some tens of megabytes; `in_use` excludes that.
    """
    for number in range(num_warm_up):
        work(number)
    every = max(1, count // _NUM_SAMPLES)
    series: dict[str, list[float | None]] = {"resident": [], "in_use": []}
    for number in range(count + 1):
        if number % every == 0 or number == count:
            series["resident"].append(footprint.megabytes())
            if gives_back:
                _return_unused_memory()
            series["in_use"].append(footprint.megabytes())
        if number < count:
            work(number)
    return series


def _return_unused_memory() -> None:
    """Returns the allocator's unused memory to the system, if supported."""
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # not in every C library
        if trim is not None:
            trim(0)


def main(
    steps: Annotated[int, typer.Option(min=100, help="Steps in all.")] = NUM_STEPS,
    loads: Annotated[int, typer.Option(min=10, help="Load-and-drop cycles in all.")] = NUM_LOADS,
    cycles: Annotated[int, typer.Option(min=3, help="Vector environments in all.")] = NUM_CYCLES,
    json: Json = None,
) -> None:
    """Print whether memory stays flat; the exit status is 1 if it does not."""
    rows = measure(steps, loads, cycles)
    settings = {"steps": steps, "loads": loads, "cycles": cycles}
    finish(rows, "dm_control", json=json, settings=settings)


if __name__ == "__main__":
    typer.run(main)
