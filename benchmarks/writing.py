"""The costs of a collection for the process that plans it, and the footers of files, in one table.

    python benchmarks/writing.py [--quick] [--json FILE]

README.md describes the figures. The exit status is 1 if a bar is missed.
"""

import contextlib
import dataclasses
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO
from unittest import mock

import pyarrow
import pyarrow.parquet as pq
import typer
from report import Json, Quick, Row, at_most, figure, finish, spread

from limberjack import data
from limberjack.episodes.episode import Kept
from limberjack.episodes.folder import Folder
from limberjack.episodes.manifest import PARTS, File, file_name
from limberjack.episodes.player import Player
from limberjack.episodes.recipe import Recipe, recipe_of
from limberjack.episodes.writing import ENDING
from limberjack.workers import pool, process

__all__ = ["Effort", "main"]

_UNIT_KB, _SECONDS, _FOOTER = at_most(2.0), at_most(10.0), at_most(5.0)
_TASK = ("pendulum", "swingup", 0.2)  # episodes of 10 steps: the footers of long ones are smaller
_DIGEST = "0" * 64


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    turns: int = 5
    units: int = 64  # of 64 seeds, that two workers play
    parts: int = 10_000  # of one episode each


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(turns=1, units=2, parts=50)


def _collect(folder: str, episodes: int, **how: Any) -> None:  # Any: of `data.collect`
    domain, task, seconds = _TASK
    data.collect(domain, task, "random", range(episodes), out=folder, time_limit=seconds, **how)


def _messages(effort: Effort) -> Row:
    """Bytes of a unit through the driver, there and back, once the worker knows the task."""
    sizes: list[int] = []
    write, read = process.write_message, process.read_message

    def writing(stream: BinaryIO, parts: list[bytes]) -> None:
        sizes.append(sum(map(len, parts)))
        write(stream, parts)

    def reading(stream: BinaryIO) -> bytes:
        message = read(stream)
        sizes[-1] += len(message)
        return message

    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.object(pool, "write_message", writing),
        mock.patch.object(pool, "read_message", reading),
    ):
        _collect(folder, 64 * effort.units, workers=1)
        files = sum(path.stat().st_size for path in (Path(folder) / "episodes").iterdir())
    units = sizes[1:]  # the first one brings the setup
    kilobytes, through = max(units) / 1e3, files / 1e3 / effort.units
    details = {"bytes": spread([float(size) for size in units])}
    return Row("a unit", "most", kilobytes, through, "kB", kilobytes, "kB", _UNIT_KB, details)


def _planning(effort: Effort) -> Iterator[Row]:
    """Seconds of the driver for parts of one episode: counted in as they come, and on a resume."""
    recipe = _recipe_of()
    counting, resuming = [], []
    for _ in range(effort.turns):
        with tempfile.TemporaryDirectory() as out:
            counting.append(_counted(Path(out), recipe, effort.parts))
            resuming.append(_resumed(Path(out), recipe, effort.parts))
    for name, seconds in (("as they come", counting), ("on a resume", resuming)):
        details = {"seconds": spread(seconds), "parts": effort.parts}
        yield figure("planning", name, statistics.median(seconds), "s", _SECONDS, details)


def _recipe_of() -> Recipe:
    """The recipe of the task, with large files."""
    domain, task, seconds = _TASK
    with contextlib.closing(Player(domain, task, "random", time_limit=seconds)) as player:
        versions = {**player.identity["versions"], "pyarrow": pyarrow.__version__}
        return recipe_of({**player.identity, "versions": versions}, player.environment, Kept())


def _counted(out: Path, recipe: Recipe, parts: int) -> float:
    """Seconds to plan, to count parts in that workers have written, and to order their joining."""
    seeds = range(parts)
    began = time.perf_counter()
    with Folder(out, recipe) as folder:
        missing = folder.plan(seeds)
        folder.log({"began": "now"})
        ready = []
        for seed in missing:
            one = range(seed, seed + 1)
            folder.order(one)
            ready += folder.took(one, None)
        for file, _ in ready:
            folder.took(file, File(file, 11 * len(file), 10**6, _DIGEST))
    assert sum(len(file) for file, _ in ready) == parts
    return time.perf_counter() - began


def _resumed(out: Path, recipe: Recipe, parts: int) -> float:
    """Seconds to find parts that are there: one is opened, the others are only listed."""
    (out / PARTS).mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as one:
        _collect(one, 1, num_threads=1)
        content = (Path(one) / "episodes" / file_name(range(1))).read_bytes()
    (out / PARTS / file_name(range(1), ENDING)).write_bytes(content)
    for seed in range(1, parts):
        (out / PARTS / file_name(range(seed, seed + 1), ENDING)).touch()
    began = time.perf_counter()
    with Folder(out, recipe) as folder:
        assert folder.plan(range(parts)) == []
        assert sum(len(file) for file, _ in folder.ready()) == parts
    return time.perf_counter() - began


def _footers(effort: Effort) -> Row:
    """The footer's share of a file of short episodes, in percent."""
    with tempfile.TemporaryDirectory() as folder:
        _collect(folder, 64 * effort.units)
        (path,) = (Path(folder) / "episodes").iterdir()
        footer, size = pq.read_metadata(path).serialized_size, path.stat().st_size
    share = 100 * footer / size
    return Row("footer", "10 steps", footer / 1e3, size / 1e3, "kB", share, "%", _FOOTER)


def main(
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Measure the driver's bytes and seconds, and footers, and print whether the bars are met."""
    effort = _QUICK if quick else Effort()
    rows = [_messages(effort), *_planning(effort), _footers(effort)]
    finish(rows, "the files", quick, json, dataclasses.asdict(effort))


if __name__ == "__main__":
    typer.run(main)
