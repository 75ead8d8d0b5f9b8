"""Setup for all tests (an off-screen renderer, selected before OpenGL is imported; Ctrl-C), the
order of the tests, and fixtures used in more than one folder.
"""

import contextlib
import ctypes.util
import importlib
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from .memory import (
    MemoryReport,
    exclude_from_searches_for_garbage,
    free_if_grown,
    keep_little,
)
from .small_sky import small_sky, small_terrain

# dm_control reads this when it is imported, and fails where its first choice, a window, cannot be
# opened. Without EGL it still simulates, and the tests that draw skip.
if sys.platform == "linux" and "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = "egl" if ctypes.util.find_library("EGL") else "disable"

# A shell that runs the tests in the background lets them, and what they start, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The files that take longest, which run first: a process that began one of them last would keep the
# others waiting. Renew the list with `pytest --durations 0`.
LONGEST = (
    "oracle/test_frames.py",
    "oracle/test_batches.py",
    # For memory: dm_control's dog takes 400 MB, which these find while the process is small.
    "oracle/test_models.py",
    "oracle/test_domains.py",
    "oracle/test_episodes.py",
    "cli/test_run.py",
    "episodes/test_collecting.py",
    "evaluation/test_experiment_workers.py",
    "laws/test_batches.py",
    "mujoco/rendering/test_thread.py",
    "oracle/test_variants.py",
    "docs/test_pages.py",
    "clients/test_clients.py",
    "contract/test_promises_process.py",
    "oracle/test_task_files.py",
    "mujoco/rendering/test_uploads.py",
    "evaluation/test_experiment.py",
    "test_tutorial_package.py",
    "mujoco/rendering/test_canvases.py",
    "rl/test_rows.py",
    "mujoco/rendering/test_backends.py",
    "rl/test_pixels.py",
    "gym/test_vector.py",
    "cli/test_solve.py",
    "laws/test_snapshots.py",
)
_TESTS = Path(__file__).parent
_FIRST = {_TESTS / name: number for number, name in enumerate(LONGEST)}

# The folders in which all tests of a task run one after the other.
_BY_TASK = {
    _TESTS / folder for folder in ("contract", "docs", "gym", "laws", "mujoco", "oracle", "rl")
}

# The folders and modules whose models have a small sky, and the modules in them that look at
# pictures or memory. Models in processes of their own have the whole sky, and another fingerprint.
_UNDER_A_SMALL_SKY = {
    *(_TESTS / folder for folder in ("contract", "docs", "gym", "laws", "oracle", "planner")),
    *(_TESTS / folder for folder in ("registry", "rl")),
    _TESTS / "episodes" / "test_starts.py",
    _TESTS / "see" / "report" / "test_labels.py",
    _TESTS / "suite" / "test_suite.py",
    _TESTS / "tools" / "test_solved_pictures.py",
}
# What they show holds for any number of points. The other files of tests/oracle compare the whole
# terrain.
_ON_A_SMALL_TERRAIN = {
    *(_TESTS / folder for folder in ("contract", "gym", "laws", "rl")),
    *(_TESTS / "oracle" / f"test_{name}.py" for name in ("batches", "variants")),
}
_UNDER_THE_WHOLE_SKY = {
    _TESTS / "contract" / "test_promises_models.py",
    *(_TESTS / "oracle" / f"test_{name}.py" for name in ("frames", "memory", "model_and_data")),
    *(_TESTS / "oracle" / f"test_{name}.py" for name in ("models", "task_files", "wrappers")),
    _TESTS / "rl" / "test_row_trial.py",
}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds `--memory`."""
    parser.addoption("--memory", action="store_true", help="report each process' peak memory")


@pytest.hookimpl(optionalhook=True)  # pytest-xdist's
def pytest_xdist_auto_num_workers() -> int:
    """One process more than usable cores: many tests wait for processes, signals and threads."""
    from limberjack.utils.cores import usable_cores  # after the renderer is chosen

    return usable_cores() + 1


def pytest_configure(config: pytest.Config) -> None:
    """Measures memory if requested."""
    if config.getoption("--memory"):
        config.pluginmanager.register(MemoryReport(config))


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Says how many results of benchmarks are older than their sources, in `make test`."""
    if not config.getoption("--memory"):
        return
    sources = importlib.import_module("benchmarks.sources")
    old, names = sources.outdated(), sources.names()
    terminalreporter.write_line(
        f"{len(old)} of {len(names)} results of benchmarks are older than their sources: "
        "python benchmarks/sources.py lists them"
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the longest files first, and sorts the tests in each file by task, in some folders.

    The package keeps the models of a few tasks compiled. In this order they are those in use.
    """
    places: dict[object, int] = {}

    def place(item: pytest.Item) -> tuple[int, int, int]:
        call = getattr(item, "callspec", None)  # None without parameters
        task = None
        if call and not _BY_TASK.isdisjoint(item.path.parents):
            task = str((call.params.get("domain"), call.params.get("task")))
        file = places.setdefault(item.path, len(places))
        return (
            _FIRST.get(item.path, len(_FIRST)),
            file,
            places.setdefault((item.path, task), len(places)),
        )

    items.sort(key=place)


def pytest_collection_finish() -> None:
    """Keeps searches for garbage short (modules and tests stay until the end), and memory small."""
    exclude_from_searches_for_garbage()
    keep_little()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Keeps processes that run many tests small, and searches for garbage short."""
    result = yield
    free_if_grown()
    if nextitem is not None and nextitem.path != item.path:  # what is left of a file stays
        exclude_from_searches_for_garbage()
    return result


@pytest.fixture(scope="module", autouse=True)
def _sky(request: pytest.FixtureRequest) -> Iterator[None]:
    """Makes the models of most modules quick to compile."""
    places = {request.path, *request.path.parents}
    is_small = _UNDER_THE_WHOLE_SKY.isdisjoint(places)
    with contextlib.ExitStack() as stack:
        if is_small and not _UNDER_A_SMALL_SKY.isdisjoint(places):
            if _TESTS / "oracle" in places:
                importlib.import_module("dm_control.suite.common")
            stack.enter_context(small_sky())
        if is_small and not _ON_A_SMALL_TERRAIN.isdisjoint(places):
            stack.enter_context(small_terrain())
        yield


@pytest.fixture(autouse=True)
def _no_batch_goes_on() -> Iterator[None]:
    """Fails a test after which vectors would still be squared as the rows of a batch."""
    from limberjack.utils import arrays  # after the renderer is chosen

    yield
    assert arrays._batch() is None, "the context of a batch was left behind"


@pytest.fixture(params=["own", "shared"])
def share(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes rows share an `MjData`, as in a large batch, or not, as in a small one."""
    from limberjack.mujoco import batch_simulation  # after the renderer is chosen

    monkeypatch.setattr(batch_simulation, "_A_FEW", {"own": 1_000, "shared": 0}[request.param])


@pytest.fixture(scope="session")
def drawing() -> bool:
    """Whether pictures can be drawn here."""
    from limberjack.mujoco import Physics  # after the renderer is chosen
    from limberjack.mujoco.camera import RenderingError

    try:
        Physics.from_xml_string("<mujoco/>").render(8, 8)
    except RenderingError:
        return False
    return True


@pytest.fixture(scope="session")
def pictures(drawing: bool) -> None:
    """Skips where no pictures can be drawn."""
    if not drawing:
        pytest.skip("no OpenGL here; `limberjack doctor` says why")


@pytest.fixture(scope="session")
def theirs() -> Callable[[str], ModuleType]:
    """`theirs("mujoco")` is dm_control's module; skips where dm_control is not installed."""
    # Any: the module is found on pytest's path alone.
    oracle: Any = pytest.importorskip("tests.oracle.oracle")
    return oracle.theirs
