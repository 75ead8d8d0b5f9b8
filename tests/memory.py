"""The peak memory of the processes that run tests, and the tests that raised it.

    pytest --memory --numprocesses 2 tests

prints for each process its peak, its time, and the tests that raised the peak the most.
"""

import contextlib
import ctypes
import gc
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

try:
    import resource
except ImportError:  # Windows has none
    resource = None

__all__ = [
    "MemoryReport",
    "exclude_from_searches_for_garbage",
    "free_if_grown",
    "free_what_nobody_uses",
    "keep_little",
    "resident",
]

_RESIDENT = Path("/proc/self/statm")  # Linux's; its second number is that of resident pages
_PAGE = os.sysconf("SC_PAGE_SIZE") / 1e6 if hasattr(os, "sysconf") else 0.0  # megabytes
_GROWN = 50.0  # megabytes, after which it is worth a twentieth of a second to look for garbage
_GROWN_MUCH = 300.0  # megabytes, after which no time is too much
_PART = 0.05  # of the tests' time that looking for garbage may take
_after_the_last_look = 0.0
_not_before = 0.0  # seconds of `time.monotonic`
_spent = 0.0  # seconds, looking for garbage

_SHOWN = 8  # tests of each process
_LEAST = 20.0  # megabytes by which a test that is shown raised the peak


def _peak() -> float:
    """Peak memory of this process so far, megabytes."""
    if resource is None:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)  # bytes there, kilobytes elsewhere


def exclude_from_searches_for_garbage() -> None:
    """Python's collector no longer looks at the objects that exist now.

    A search through those of all modules and tests takes about 0.3 s, and tests that draw or
    simulate make Python search twice a second.
    """
    gc.collect()
    gc.freeze()


def free_if_grown() -> None:
    """Frees what nobody uses if the process has grown much.

    A model takes 12 MB that Python does not account for, so it would collect the cycles of
    environments and wrappers late. A search takes longer the more a process holds.
    """
    global _after_the_last_look, _not_before, _spent
    if not _RESIDENT.exists():
        return
    grown, now = resident() - _after_the_last_look, time.monotonic()
    if grown < _GROWN or (now < _not_before and grown < _GROWN_MUCH):
        return
    free_what_nobody_uses()
    _after_the_last_look, ended = resident(), time.monotonic()
    _not_before = ended + (ended - now) / _PART
    _spent += ended - now


def free_what_nobody_uses() -> None:
    """Collects garbage and returns the memory to the system."""
    _drop_the_last_source()
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):  # not GNU's C library
        ctypes.CDLL("libc.so.6").malloc_trim(0)


def _drop_the_last_source() -> None:
    """MuJoCo and dm_control no longer keep the model that was compiled last.

    MuJoCo keeps its source, with all meshes, and dm_control the model, to write them as XML. Of
    dm_control's dog these take 120 and 70 MB.
    """
    if mujoco := sys.modules.get("mujoco"):
        mujoco.MjModel.from_xml_string("<mujoco/>")
    if core := sys.modules.get("dm_control.mujoco.wrapper.core"):
        vars(core)["_LAST_PARSED_MODEL_PTR"] = None


def keep_little() -> None:
    """The renderer keeps the OpenGL resources of two models, not of eight, and MuJoCo no meshes.

    With Mesa, those of a model take 95 MB. The meshes of dm_control's dog take 130 MB.
    """
    import mujoco  # after the renderer is chosen

    from limberjack.mujoco.rendering import canvases

    canvases._MOST_SHARED = 2
    mujoco.mj_setCacheCapacity(mujoco.mj_getCache(), 0)


def resident() -> float:
    """Current memory of this process, megabytes."""
    return int(_RESIDENT.read_text().split()[1]) * _PAGE


class MemoryReport:
    """A plugin that measures memory in each process and reports the results."""

    def __init__(self, config: pytest.Config) -> None:
        self._output: dict[str, Any] | None = getattr(config, "workeroutput", None)
        self._raised: list[tuple[float, str]] = []
        self._lines: list[str] = []
        self._began = time.monotonic()
        self._in_tests = 0.0  # seconds
        self._in_phases = 0.0  # seconds, of set-up, call and tear-down
        self._first = self._last = 0.0  # seconds from the beginning, of the tests

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Measures a test with its fixtures."""
        before, began = _peak(), time.monotonic() - self._began
        result = yield
        self._raised.append((_peak() - before, item.nodeid))
        self._first, self._last = self._first or began, time.monotonic() - self._began
        self._in_tests += self._last - began
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Counts the time of a phase of a test."""
        self._in_phases += report.duration

    def pytest_sessionfinish(self) -> None:
        """Stores this process's measurements for the reporting process."""
        if self._output is not None:
            self._output["memory"] = self._described()
        elif self._raised:
            self._lines += self._described()

    @pytest.hookimpl(optionalhook=True)  # pytest-xdist's
    def pytest_testnodedown(self, node: Any) -> None:
        """Receives the measurements of a pytest-xdist worker."""
        first, *rest = node.workeroutput.get("memory", ["no report"])
        self._lines += [f"{node.gateway.id}: {first}", *rest]

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Prints all measurements."""
        terminalreporter.section("memory")
        for line in self._lines:
            terminalreporter.write_line(line)

    def _described(self) -> list[str]:
        most = sorted(self._raised, reverse=True)[:_SHOWN]
        shown = [f"  {raised:+5.0f} MB  {test}" for raised, test in most if raised >= _LEAST]
        times = (
            f"{self._in_phases:.0f} of {self._in_tests:.0f} s in fixtures and tests, between "
            f"{self._first:.0f} and {self._last:.0f} s; {_spent:.0f} s looking for garbage"
        )
        return [f"peak {_peak():.0f} MB; {times}", *shown]
