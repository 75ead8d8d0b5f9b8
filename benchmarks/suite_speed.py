"""Speed, memory and size of all tasks of the suite in one table, with the bars of its classes.

    python benchmarks/suite_speed.py [--quick] [--only SECTION]... [--size N]... [--peers DIR]
        [--json FILE]

Sections: one environment against dm_control; a batch against MuJoCo's own, and a vector environment
against EnvPool, each by number of rows; loads; the memory of all tasks loaded in one process; the
length of the domains' files. `classes.py` divides the tasks into heavy ones and toys. The exit
status is 1 if a bar is missed.
"""

import dataclasses
import enum
import statistics
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import batch_costs
import batch_peers
import fresh
import starting
import stepping
import typer
from batch_stepping import BARE, BATCHED, OURS, THEIRS, Cell, Times, beside_envpool
from classes import is_heavy
from report import (
    Bar,
    Json,
    Peers,
    Quick,
    Row,
    Threads,
    WithoutPeers,
    at_least,
    at_most,
    compared,
    figure,
    finish,
    mean_of,
    rates,
    write_json,
)

from limberjack import bench, suite

__all__ = ["Section", "main"]

# Over a bare `mujoco.batch.Batch`, by number of rows.
_HEAVY = {64: at_least(0.90), 256: at_least(0.94), 1024: at_least(0.95)}
_TOY = {64: at_least(0.65), 256: at_least(0.80), 1024: at_least(0.90)}
_FREE = "vector / EnvPool"
_WARM_UP_STEPS = 20  # beside EnvPool, not measured: the humanoid falls
_PEER_SIZES = (256, 1024)
_PEER = at_least(1.0)  # on each heavy task, with threads of both free to use all cores
_PEER_MEAN = at_least(1.25)  # the geometric mean of the heavy tasks
_PEER_TOY = at_least(0.85)  # of the ratio of the bare batch to EnvPool
_DOG = ("dog", "run")  # the largest model
_DOG_LOAD = at_most(150)  # milliseconds
_MEMORY = at_most(800)  # megabytes
_ESCAPE = ("quadruped", "escape")  # each row has a height field of its own
_ESCAPE_MEMORY = at_most(400)  # megabytes
_LINES = at_most(2_000)
_OLD_DOMAINS = ("humanoid", "manipulator", "stacker")  # which are not part of the bar on lines

_Task = tuple[str, str]


class Section(enum.StrEnum):
    """A part of the table."""

    SINGLE = "single"
    BATCH = "batch"
    PEER = "peer"
    LOAD = "load"
    MEMORY = "memory"
    SIZE = "size"


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    tasks: int = 51  # the first so many
    episodes: int = 4  # of each task, one environment
    steps: int = 1_000  # of each episode
    sizes: tuple[int, ...] = (64, 256, 1024)  # numbers of rows
    seconds: float = 1.5  # of each comparison
    rounds: int = 8  # of each comparison, at least
    loads: int = 7  # of each task, and of all in processes of their own
    memory_rows: int = 1024


_QUICK = Effort(1, 1, 10, (64,), 0.01, 2, 1, 2)


def _measure_batch(tasks: Sequence[_Task], effort: Effort, num_threads: int) -> Iterator[Row]:
    """A batch of each task beside a bare `mujoco.batch.Batch` that keeps its simulations."""
    for size in effort.sizes:
        for task in tasks:
            cell = *task, size
            _say(f"  {_subject(cell)}")
            bar = (_HEAVY if is_heavy(*task) else _TOY).get(size)
            taken = _taken(cell, num_threads, effort)
            row = _row("batch / bare Batch", cell, taken, BATCHED, BARE, bar)
            if row.is_met is False:
                again = _taken(cell, num_threads, effort)
                taken = {name: taken[name] + again[name] for name in taken}
                row = _row("batch / bare Batch", cell, taken, BATCHED, BARE, bar)
            yield row


def _taken(cell: Cell, num_threads: int, effort: Effort) -> Times:
    with bench.Contest(*cell, num_threads) as contest:
        players = {name: getattr(contest, name) for name in (BARE, BATCHED, OURS)}
        return bench.take_turns(players, contest.actions, effort.seconds, effort.rounds)


def _measure_peer(
    tasks: Sequence[_Task], effort: Effort, num_threads: int, folder: Path, versions: dict[str, str]
) -> Iterator[Row]:
    """A vector environment of each task beside EnvPool, and a bare batch beside both."""
    given = folder, (effort.seconds, effort.rounds, _WARM_UP_STEPS), versions
    for size in [size for size in _PEER_SIZES if size in effort.sizes] or effort.sizes:
        heavy = []
        for task in tasks:
            cell = *task, size
            _say(f"  EnvPool, {_subject(cell)}")
            bar = _PEER if is_heavy(*task) else None
            try:
                bound, free = beside_envpool(cell, num_threads, *given)
            except batch_peers.PeerEndedError as error:  # 1,024 dogs of EnvPool take over 20 GB
                _say(f"    {error}")
                details = {"EnvPool": str(error)}
                yield Row(_FREE, _subject(cell), None, None, "/s", None, bar=bar, details=details)
                continue
            row = _row(_FREE, cell, free, OURS, THEIRS, bar)
            yield row
            yield _row(f"{_FREE}, bound", cell, bound, OURS, THEIRS, None)
            if bar is None:
                yield _toy_row(row, _row("", cell, free, BARE, THEIRS, None))
            else:
                heavy.append(row)
        if heavy:
            subject = f"geometric mean of {len(heavy)} heavy tasks, N={size}"
            yield mean_of(heavy, subject, _PEER_MEAN)


def _row(measure: str, cell: Cell, taken: Times, ours: str, theirs: str, bar: Bar | None) -> Row:
    added = [a - b for a, b in zip(taken[ours], taken[BARE], strict=True)]
    kind = "heavy" if is_heavy(*cell[:2]) else "toy"
    details = {"added_us": 1e6 * statistics.median(added), "class": kind}
    sides = rates(taken[ours], cell[2]), rates(taken[theirs], cell[2])
    return compared(measure, _subject(cell), *sides, "/s", bar, details)


def _toy_row(ours: Row, physics: Row) -> Row:
    """The share of what the physics alone would reach against EnvPool."""
    share = (ours.value or 0.0) / (physics.value or 1.0)
    measure = "of bare Batch / EnvPool"
    return Row(measure, ours.subject, ours.value, physics.value, "", share, bar=_PEER_TOY)


def _subject(cell: Cell) -> str:
    return f"{cell[0]}:{cell[1]}, N={cell[2]}"


def _dog_row(rows: Sequence[Row]) -> Row:
    (load,) = [r for r in rows if r.measure == "load / compile" and r.subject == ":".join(_DOG)]
    return Row("load", load.subject, load.ours, load.theirs, "ms", load.ours, "ms", _DOG_LOAD)


def _memory_rows(num_rows: int, num_processes: int) -> list[Row]:
    # Several, as the allocator leaves more or less unused between models of 12 MB.
    found = [fresh.call("footprint", "megabytes_of_all") for _ in range(num_processes)]
    known = [each for each in found if each is not None]
    of_all = statistics.median(known) if known else None
    one, many = (
        fresh.call("footprint", "megabytes_of_batch", *_ESCAPE, count, 1) for count in (1, num_rows)
    )
    more = None if one is None or many is None else many - one
    subject = f"{_subject((*_ESCAPE, num_rows))}, beyond N=1"
    return [
        figure("memory", "all tasks loaded", of_all, "MB", _MEMORY, {"megabytes": found}),
        figure("memory", subject, more, "MB", _ESCAPE_MEMORY),
    ]


def _size_rows() -> list[Row]:
    folder = Path(suite.__file__).parent
    names = [name for name in suite.TASKS_BY_DOMAIN if name not in _OLD_DOMAINS]
    rows = []
    for ending, more in ((".py", ["lqr_solver"]), (".xml", [])):
        files = [folder / f"{name}{ending}" for name in [*names, *more]]
        lines = sum(file.read_text(encoding="utf-8").count("\n") for file in files if file.exists())
        rows.append(figure("lines", f"*{ending}", lines, "", _LINES))
    return rows


def _say(line: str) -> None:
    typer.echo(line, err=True)


def _measure(
    section: Section,
    effort: Effort,
    num_threads: int,
    folder: Path | None,
    versions: dict[str, str],
) -> Iterable[Row]:
    tasks = suite.ALL_TASKS[: effort.tasks]
    match section:
        case Section.SINGLE:
            rows = stepping.measure(tasks, effort.episodes, effort.steps)
            return [row for row in rows if row.measure == "steps per second"]
        case Section.BATCH:
            return _measure_batch(tasks, effort, num_threads)
        case Section.PEER:
            envpool = batch_peers.install(batch_peers.ENVPOOL, folder)
            if envpool is None:
                return []
            return _measure_peer(tasks, effort, num_threads, envpool, versions)
        case Section.LOAD:
            rows = starting.measure_loads(tasks, effort.loads, 0, 0)
            rows += [_dog_row(rows)] if _DOG in tasks else []
            return sorted(rows, key=lambda row: row.measure)
        case Section.MEMORY:
            return _memory_rows(effort.memory_rows, effort.loads)
        case Section.SIZE:
            return _size_rows()


def _by_measure(rows: Sequence[Row]) -> list[Row]:
    """The rows in the order in which their measures appear first."""
    measures = list(dict.fromkeys(row.measure for row in rows))
    return sorted(rows, key=lambda row: measures.index(row.measure))


def main(
    only: Annotated[
        list[Section] | None, typer.Option(help="Measure this section; may be given repeatedly.")
    ] = None,
    size: Annotated[
        list[int] | None, typer.Option(help="Rows of batches; may be given repeatedly.")
    ] = None,
    quick: Quick = False,
    peers: Peers = None,
    without_peers: WithoutPeers = False,
    threads: Threads = None,
    json: Json = None,
) -> None:
    """Measure the whole suite and print each bar and whether it is met."""
    effort = _QUICK if quick else Effort()
    effort = dataclasses.replace(effort, sizes=tuple(size or effort.sizes))
    num_threads = threads or batch_costs.free_cores()
    rows: list[Row] = []
    versions: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = None if without_peers else peers or Path(temporary)
        for section in only or list(Section):
            _say(f"measuring: {section}, {num_threads} threads")
            for row in _measure(section, effort, num_threads, folder, versions):
                rows = _by_measure([*rows, row])
                if json is not None:  # after each row, as all of them take hours
                    settings: dict[str, Any] = {"quick": quick, "threads": num_threads}
                    settings |= {**dataclasses.asdict(effort), "peers": versions}
                    write_json(json, rows, settings)
    finish(rows, "compared", quick)  # the file is written


if __name__ == "__main__":
    typer.run(main)
