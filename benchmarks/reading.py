"""The speed of the readers of a dataset, beside each other, in one table.

    python benchmarks/reading.py [--quick] [--json FILE]

README.md describes the comparisons. The exit status is 1 if a bar is missed.
"""

import collections
import contextlib
import dataclasses
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator

import numpy as np
import typer
from report import Bar, Json, Quick, Row, at_least, compared, finish, rates, spread

from limberjack import data

__all__ = ["Effort", "main"]

_TASKS = (("humanoid", "walk"), ("cartpole", "swingup"))
_SIZE = 256  # transitions of a batch, and of a batch of windows in steps
_LENGTH = 16  # steps of a window

# A web server that gives parts of files: aiohttp's, a program of its own as on another machine.
_SERVER = """
import sys
from aiohttp import web
app = web.Application()
app.router.add_static("/", sys.argv[1])
web.run_app(app, host="127.0.0.1", port=int(sys.argv[2]), print=None)
"""
_PATIENCE = 60.0  # seconds until the server answers


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    turns: int = 15  # of each reader
    episodes: int = 32
    file_mb: float = 6.0
    seconds: float | None = None  # of an episode; None for the task's own


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(turns=1, episodes=3, file_mb=6.0, seconds=0.4)


def _batches(dataset: data.Dataset) -> int:
    return sum(len(batch) for batch in dataset.batches(_SIZE, seed=0))


def _windows(stride: int) -> Callable[[data.Dataset], int]:
    def read(dataset: data.Dataset) -> int:
        size = _SIZE // _LENGTH
        found = dataset.windows(_LENGTH, stride, size=size, seed=0)
        return sum(windows.mask.size for windows in found)

    return read


def _padded(dataset: data.Dataset) -> int:
    pad = (_LENGTH - 1, _LENGTH - 1)
    found = dataset.windows(_LENGTH, _LENGTH, pad, size=_SIZE // _LENGTH, seed=0)
    return sum(int(windows.mask.sum()) for windows in found)


def _buffered(dataset: data.Dataset) -> int:
    return sum(len(batch) for batch in dataset.batches(_SIZE, seed=0, buffer=dataset.steps // 4))


def _by_number(dataset: data.Dataset) -> int:
    """All transitions in a random order; the episodes are in memory from the first turn on."""
    order = np.random.default_rng(0).permutation(dataset.steps)
    parts = np.split(order, range(_SIZE, len(order), _SIZE))
    return sum(len(dataset.transitions(part)) for part in parts)


# By name: what reads all steps and returns their number, and the bar on its speed.
_READERS: dict[str, tuple[Callable[[data.Dataset], int], Bar | None]] = {
    "windows of 16": (_windows(_LENGTH), at_least(0.5)),
    "windows of 16, padded": (_padded, at_least(0.5)),
    "windows of 16, stride 1": (_windows(1), at_least(0.5)),
    "float32, 5 steps, returns": (
        lambda dataset: _batches(dataset.select(float32=True, discount=0.99, n_step=5)),
        at_least(0.5),
    ),
    "buffer of a quarter": (_buffered, at_least(0.4)),
    "transitions by number": (_by_number, None),
    "episodes": (lambda dataset: sum(episode.length for episode in dataset), None),
}


def _rate(read: Callable[[data.Dataset], int], dataset: data.Dataset) -> float:
    """Steps per second of the processor's time."""
    began = time.process_time()
    steps = read(dataset)
    return steps / (time.process_time() - began)


def _seconds(dataset: data.Dataset) -> float:
    """The time in which `batches` reads everything, by the clock, waiting included."""
    began = time.perf_counter()
    _batches(dataset)
    return time.perf_counter() - began


@contextlib.contextmanager
def _served(folder: str) -> Iterator[str]:
    """The URL of a folder on this machine."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    with subprocess.Popen([sys.executable, "-c", _SERVER, folder, str(port)]) as server:
        try:
            end = time.monotonic() + _PATIENCE
            while True:
                with contextlib.suppress(ConnectionRefusedError):
                    socket.create_connection(("127.0.0.1", port)).close()
                    break
                if server.poll() is not None or time.monotonic() > end:
                    raise RuntimeError("the web server does not answer")
                time.sleep(0.05)
            yield f"http://127.0.0.1:{port}"
        finally:
            server.terminate()


def _over_loopback(folder: str, subject: str, turns: int) -> Row:
    """Reading from a web server on this machine against reading from its disk, in turns."""
    with _served(folder) as url:
        local, remote = data.load(folder), data.load(url)
        _batches(local), _batches(remote)
        pairs = [(_seconds(remote), _seconds(local)) for _ in range(turns)]
    ours, theirs = (rates(side, local.steps) for side in zip(*pairs, strict=True))
    measure, details = "batches over loopback / batches", {"steps_per_second": spread(ours)}
    return compared(measure, subject, ours, theirs, "steps/s", at_least(0.7), details)


def _measure(domain: str, task: str, effort: Effort) -> Iterator[Row]:
    """The rows of a task: each turn of a reader is compared with one of `batches` beside it."""
    ours: dict[str, list[float]] = collections.defaultdict(list)
    theirs: dict[str, list[float]] = collections.defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        how = {"time_limit": effort.seconds, "file_mb": effort.file_mb}
        data.collect(domain, task, "random", range(effort.episodes), out=folder, **how)
        dataset = data.load(folder)
        for read, _ in _READERS.values():
            read(dataset)
        for _ in range(effort.turns):
            for name, (read, _) in _READERS.items():
                ours[name].append(_rate(read, dataset))
                theirs[name].append(_rate(_batches, dataset))
        yield _over_loopback(folder, f"{domain}:{task}", effort.turns)
    for name, (_, bar) in _READERS.items():
        measure, details = f"{name} / batches", {"steps_per_second": spread(ours[name])}
        sides = ours[name], theirs[name]
        yield compared(measure, f"{domain}:{task}", *sides, "steps/s", bar, details)


def main(
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Measure each reader against `batches`, and print whether the bars are met."""
    effort = _QUICK if quick else Effort()
    rows = []
    for domain, task in _TASKS:
        typer.echo(f"measuring: {domain} {task}", err=True)
        rows += _measure(domain, task, effort)
    rows.sort(key=lambda row: row.measure)
    finish(rows, "batches", quick, json, dataclasses.asdict(effort))


if __name__ == "__main__":
    typer.run(main)
