"""The cost of importing the suite, of loading a task and of starting an episode."""

import dataclasses
import gc
import importlib
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import fresh
import mujoco
import numpy as np
import peers
from report import Bar, Row, at_most, compared, figure, spread

__all__ = ["measure_imports", "measure_loads", "measure_resets", "seconds_of_first"]

_ADDED_BY_SUITE = at_most(50)  # milliseconds, beyond `import mujoco, dm_env, gymnasium`
_ADDED_BY_PACKAGE = at_most(15)  # milliseconds, beyond `import gymnasium`
_NO_OPENGL = at_most(0)  # modules
_LOAD = at_most(1.2)  # over the model's compilation
_SECOND_LOAD = at_most(10)  # milliseconds
_RESET = at_most(1.0)  # over dm_control's

_SEED = 0
# For any value of MUJOCO_GL, OpenGL must not be loaded before the first frame.
_BACKENDS = (None, "egl", "glfw", "osmesa", "nonsense")
# One task per domain, because processes are slow to start.
_TASK_OF_DOMAIN = (("humanoid", "walk"), ("manipulator", "bring_ball"), ("stacker", "stack_2"))


def measure_imports(num_processes: int) -> list[Row]:
    """Import times in addition to those of the dependencies, and the OpenGL modules loaded.

    Args:
      num_processes: number of processes for each package and import, in turns.
    """
    calls = [("imports", "seconds_to_import", package) for package in peers.installed()]
    only_ours = ("imports", "seconds_to_import_alone", peers.OURS)
    found = _in_fresh_processes([*calls, only_ours], num_processes)
    suites = {call[-1]: found[call] for call in calls}
    return [
        _import_row("import limberjack.suite", suites, _ADDED_BY_SUITE),
        _import_row("import limberjack", {peers.OURS: found[only_ours]}, _ADDED_BY_PACKAGE),
        _opengl_row(),
    ]


def _in_fresh_processes(
    calls: Sequence[tuple[str, ...]], count: int
) -> dict[tuple[str, ...], list[Any]]:
    """Results of calls of `fresh`, each in so many processes, in turns.

    They have a bytecode cache, as for an installed package, outside the source tree, which is not
    changed.
    """
    results: dict[tuple[str, ...], list[Any]] = {call: [] for call in calls}
    with tempfile.TemporaryDirectory() as cache:
        variables = {"PYTHONDONTWRITEBYTECODE": None, "PYTHONPYCACHEPREFIX": cache}
        for number in range(1 + count):
            for call in calls:
                found = fresh.call(*call, variables={**peers.WITHOUT_OPENGL, **variables})
                if number:  # the first one compiled bytecode
                    results[call].append(found)
    return results


def _import_row(subject: str, times: dict[str, list[dict[str, float]]], bar: Bar) -> Row:
    """The time that an import adds, by package, of its seconds in fresh processes."""
    added = {name: spread([1e3 * t["added"] for t in values]) for name, values in times.items()}
    base = spread([1e3 * t["base"] for t in times[peers.OURS]])
    ours = added[peers.OURS]["median"]
    return Row(
        measure="import adds",
        subject=subject,
        ours=ours,
        theirs=added.get(peers.THEIRS, {}).get("median"),
        unit="ms",
        value=ours,
        value_unit="ms",
        bar=bar,
        details={"base_ms": base, "added_ms": added},
    )


def _opengl_row() -> Row:
    """OpenGL modules after import, load, reset and step, for all values of MUJOCO_GL."""
    found = {
        backend or "unset": fresh.call(
            "imports", "opengl_modules", variables={"MUJOCO_GL": backend}
        )
        for backend in _BACKENDS
    }
    most = max(len(modules) for modules in found.values())
    subject = "import, load, reset, step"
    return figure("OpenGL modules", subject, most, "", _NO_OPENGL, {"by_MUJOCO_GL": found})


def measure_loads(
    tasks: Sequence[tuple[str, str]], num_loads: int, num_processes: int, num_domains: int
) -> list[Row]:
    """Loading a task, compared with compiling its model.

    Args:
      tasks: the tasks to load.
      num_loads: loads of each task, with no other environment alive.
      num_processes: number of processes to measure the first load, for each domain and package.
      num_domains: number of domains for which the first load is measured.
    """
    rows = [row for task in tasks for row in _load_rows(*task, num_loads)]
    return rows + [_first_load_row(*task, num_processes) for task in _TASK_OF_DOMAIN[:num_domains]]


def _load_rows(domain: str, task: str, num_loads: int) -> list[Row]:
    """Loads of a task in this process."""
    times = {name: [] for name in ("compile", "load", "again", "reset", *peers.installed()[1:])}
    for _ in range(num_loads):
        for name, seconds in _one_load(domain, task).items():
            times[name].append(1e3 * seconds)
    subject, reset = f"{domain}:{task}", {"first_reset_ms": spread(times["reset"])}
    first = _load_row("load / compile", subject, times["load"], times, reset)
    median, details = statistics.median(times["again"]), {"again_ms": spread(times["again"])}
    again = figure("second load", subject, median, "ms", _SECOND_LOAD, details)
    return [first, again]


def _one_load(domain: str, task: str) -> dict[str, float]:
    """Seconds of each kind of load; nothing is alive before or after."""
    load = _loader(peers.OURS, domain, task)
    seconds = {"compile": _timed(_compiler(domain, task))[0]}
    gc.collect()
    if importlib.import_module("limberjack.mujoco.wrapper.sharing").drop_unused():
        raise RuntimeError(f"a model is still in use before {domain}:{task} is loaded")
    seconds["load"], environment = _timed(load)
    seconds["reset"], _ = _timed(environment.reset)
    del environment
    gc.collect()
    seconds["again"], environment = _timed(load)  # after the first environment is freed
    del environment
    for package in peers.installed()[1:]:
        gc.collect()
        seconds[package] = _timed(_loader(package, domain, task))[0]
    gc.collect()
    return seconds


def _first_load_row(domain: str, task: str, num_processes: int) -> Row:
    """The first load of a process."""
    names = ["compile", *peers.installed()]
    calls = {name: ("starting", "seconds_of_first", name, domain, task) for name in names}
    found = _in_fresh_processes(list(calls.values()), num_processes)
    times = {name: [1e3 * seconds for seconds in found[call]] for name, call in calls.items()}
    return _load_row("first load / compile", f"{domain}:{task}", times[peers.OURS], times, {})


def _load_row(
    measure: str,
    subject: str,
    ours: Sequence[float],
    times: Mapping[str, Sequence[float]],
    details: Mapping[str, Any],
) -> Row:
    """Loads beside those of dm_control, and their ratio to the model's compilation."""
    row = compared(measure, subject, ours, times["compile"], "ms", _LOAD, details)
    theirs = times.get(peers.THEIRS)
    details = {**row.details, "compile_ms": spread(times["compile"])}
    median = statistics.median(theirs) if theirs else None
    return dataclasses.replace(row, theirs=median, details=details)


def seconds_of_first(what: str, domain: str, task: str) -> float:
    """Seconds of this process's first load by a package, or of its first compilation.

    Too few processes can be started to average out other load. Therefore this is the minimum of
    wall time, which includes that load, and processor time, which includes the spinning of idle
    threads of a linear algebra library.
    """
    function = _compiler(domain, task) if what == "compile" else _loader(what, domain, task)
    clock, processor = time.perf_counter(), time.process_time()
    function()
    return min(time.perf_counter() - clock, time.process_time() - processor)


def measure_resets(tasks: Sequence[tuple[str, str]], num_resets: int) -> list[Row]:
    """Starts of episodes with equal draws, and so equal rejected attempts.

    Args:
      tasks: the tasks to reset.
      num_resets: resets of each task and package.
    """
    return [_reset_row(domain, task, num_resets) for domain, task in tasks]


def _reset_row(domain: str, task: str, num_resets: int) -> Row:
    """Starts of a task's episodes."""
    packages = peers.installed()
    environments = {package: _loader(package, domain, task)() for package in packages}
    times: dict[str, list[float]] = {package: [] for package in packages}
    for environment in environments.values():  # the first one prepares what later ones use
        environment.reset()
    for _ in range(num_resets):
        for package in packages:
            times[package].append(1e6 * _timed(environments[package].reset)[0])
        packages.reverse()
        _check_same_start(f"{domain}:{task}", list(environments.values()))
    ours, theirs = times[peers.OURS], times.get(peers.THEIRS, [])
    return compared("reset", f"{domain}:{task}", ours, theirs, "us", _RESET)


def _check_same_start(subject: str, environments: list[Any]) -> None:
    """Raises unless all drew the same numbers, and so rejected equally many attempts."""
    first, *others = environments
    for other in others:
        same_stream = first.task.random.get_state()[2] == other.task.random.get_state()[2]
        if not same_stream or not np.array_equal(first.physics.data.qpos, other.physics.data.qpos):
            raise RuntimeError(f"{subject}: the packages did not draw the same start")


def _compiler(domain: str, task: str) -> Callable[[], Any]:
    """A function that only compiles a task's model."""
    xml, assets = peers.source(domain, task)
    compile_model: Any = mujoco.MjModel.from_xml_string
    return lambda: compile_model(xml, assets)


def _loader(package: str, domain: str, task: str) -> Callable[[], Any]:
    """A function that loads a task with a package."""
    load = peers.suite(package).load
    return lambda: load(domain, task, {"random": _SEED})


def _timed(function: Callable[[], Any]) -> tuple[float, Any]:
    """Duration of a call, seconds, and its result."""
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result
