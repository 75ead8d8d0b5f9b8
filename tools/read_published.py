"""Compute the scores in src/limberjack/evaluation/published.json from the files of their sources.

    python tools/read_published.py FOLDER            # writes them
    python tools/read_published.py FOLDER --check    # exits with 1 if they would change

FOLDER holds a clone of each repository under its name, such as FOLDER/tdmpc2. The file's table of
sources, which is written by hand, has the commits and the files to read. Only means and spreads are
kept. Rows of sources without a commit are written by hand too, and stay as they are.

A mean is that over all runs of the return at one evaluation: of those at which every run reports,
the one nearest to 1, 4 or 14 million control steps, and at most 5 % away. It is never the maximum
over evaluations. A source without such an evaluation has no row for that number of steps. Tables
give their own means.
"""

import collections
import csv
import functools
import io
import json
import re
import statistics
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from limberjack import suite
from limberjack.evaluation import published
from limberjack.utils.files import write_whole

__all__ = ["FILE", "READERS", "Row", "computed", "main", "text_of"]

FILE = Path(published.__file__).with_name("published.json")

_STEPS = 1_000_000, 4_000_000, 14_000_000  # control steps; papers report after these
_WINDOW = 0.05  # of the steps; an evaluation within it counts

_TASKS = {f"{domain}_{task}": (domain, task) for domain, task in suite.ALL_TASKS}
_OTHER_NAMES = {"cup_catch": "ball_in_cup_catch"}  # TD-MPC2's

_File = dict[str, Any]  # Any: values of JSON
# Takes a path in a repository; returns the file's text, or the names in a folder.
_Read = Callable[[str], str]
# Returns of the runs at each control step, by task.
_Curves = dict[tuple[str, str], dict[int, list[float]]]


class Row(NamedTuple):
    """A score, as a line of the file has it after the name of its source."""

    domain: str
    task: str
    steps: int | None
    seeds: int | None
    mean: float
    spread: float | None


def _task_of(name: str) -> tuple[str, str] | None:
    """The (domain, task) pair of a name in a source; None if the suite has no such task."""
    flat = name.replace("-", "_")
    return _TASKS.get(_OTHER_NAMES.get(flat, flat))


def _rounded(number: float) -> float:
    return round(number, 1)


def _rows_of(curves: _Curves) -> Iterator[Row]:
    """A row for each task and number of steps at which all runs were evaluated."""
    for task, curve in curves.items():
        runs = max(map(len, curve.values()))
        complete = [steps for steps, returns in curve.items() if len(returns) == runs]
        for steps in _STEPS:
            nearest = min(complete, key=lambda one, to=steps: abs(one - to))
            if abs(nearest - steps) <= _WINDOW * steps:
                yield _row_of_runs(task, nearest, curve[nearest])


def _row_of_runs(task: tuple[str, str], steps: int, returns: Sequence[float]) -> Row:
    spread = _rounded(statistics.stdev(returns)) if len(returns) > 1 else None
    return Row(*task, steps, len(returns), _rounded(statistics.mean(returns)), spread)


def _files_of_tasks(folder: str, read: _Read) -> Iterator[Row]:
    """TD-MPC2's files, one for each task: columns step, reward and seed."""
    curves: _Curves = {}
    for name in read(folder).split():
        task = _task_of(Path(name).stem)
        if task is not None:
            curve = curves.setdefault(task, {})
            for line in csv.DictReader(io.StringIO(read(f"{folder}{name}"))):
                curve.setdefault(int(line["step"]), []).append(float(line["reward"]))
    return _rows_of(curves)


def _lines(path: str, read: _Read) -> Iterator[Row]:
    """SimbaV2's and FlashSAC's files: a line for each task, run, metric and evaluation."""
    curves: _Curves = collections.defaultdict(dict)
    for line in csv.DictReader(io.StringIO(read(path))):
        task = _task_of(line["env_name"])
        if task is not None and line["metric"] == "avg_return":
            steps = round(float(line["env_step"]))
            curves[task].setdefault(steps, []).append(float(line["value"]))
    return _rows_of(curves)


def _blocks(path: str, read: _Read) -> Iterator[Row]:
    """MR.Q's file: for each task a head, and the returns of all runs after a count of actions."""
    curves: _Curves = collections.defaultdict(dict)
    task = None
    for line in read(path).splitlines():
        if head := re.match(r"Env: Dmc-(.*)", line):
            task = _task_of(head[1].strip())
        elif task is not None and re.match(r"\d", line):
            actions, *returns = line.split()
            curves[task][2 * int(actions)] = list(map(float, returns))  # two control steps each
    return _rows_of(curves)


def _printed(
    path: str, read: _Read, *, heading: str, column: int, steps: int, seeds: int
) -> Iterator[Row]:
    """A column of a table on a page of CleanRL, with cells such as `27.84 ± 9.25`.

    Args:
      path: of the page.
      read: reads it.
      heading: the beginning of the column's heading.
      column: its number, from 1 on.
      steps: of training.
      seeds: number of runs.
    """
    is_in_table = False
    for line in read(path).splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) <= column:
            is_in_table = False
            continue
        is_in_table |= cells[column].startswith(heading)
        task = _task_of(cells[0].removeprefix("dm_control/").removesuffix("-v0"))
        if is_in_table and task is not None:
            mean, spread = (_rounded(float(part)) for part in cells[column].split("±"))
            yield Row(*task, steps, seeds, mean, spread)


def _policies(path: str, read: _Read) -> Iterator[Row]:
    """Deep OPE's list of policies: the one with the highest mean of each task."""
    found: dict[tuple[str, str], Row] = {}
    for policy in json.loads(read(path)):
        task = _task_of(policy["task.task_name"])
        assert task is not None, policy
        mean, spread = (_rounded(policy[f"return_{name}"]) for name in ("mean", "std"))
        if task not in found or mean > found[task].mean:
            found[task] = Row(*task, None, 1, mean, spread)
    yield from found.values()


# How to read each source that has a commit. CleanRL's pages do not say how often PPO ran for 1
# million steps: benchmark/ppo.sh of the commit that the table names, cbd83f6, does.
READERS: dict[str, Callable[[str, _Read], Iterator[Row]]] = {
    "tdmpc2": _files_of_tasks,
    "tdmpc2-tdmpc": _files_of_tasks,
    "tdmpc2-sac": _files_of_tasks,
    "tdmpc2-dreamerv3": _files_of_tasks,
    "simbav2": _lines,
    "simbav2-sac": _lines,
    "mrq": _blocks,
    "bro": _lines,
    "flashsac": _lines,
    "flashsac-ppo": _lines,
    "xqc": _lines,
    "cleanrl-ppo-1m": functools.partial(
        _printed, heading="ppo_continuous_action ({", column=1, steps=1_000_000, seeds=3
    ),
    "cleanrl-ppo-8m": functools.partial(
        _printed, heading="ppo_continuous_action_8M ({", column=1, steps=8_000_000, seeds=10
    ),
    "cleanrl-rpo-8m": functools.partial(
        _printed, heading="rpo_continuous_action ({", column=2, steps=8_000_000, seeds=10
    ),
    "deep-ope": _policies,
}


def computed(content: _File, read: Callable[[published.Source, str], str]) -> _File:
    """The content of the file with the scores of all sources that have a commit.

    Args:
      content: of the file; rows of sources without a commit stay.
      read: takes a source and a path in its repository, and returns the text.
    """
    rows = [tuple(row) for row in content["scores"] if row[2] not in READERS]
    for name, facts in content["sources"].items():
        source = published.Source(name, **facts)
        if name in READERS:
            found = READERS[name](source.file, functools.partial(read, source))
            rows += [(row.domain, row.task, name, *row[2:]) for row in found]
    names = list(content["sources"])
    order = {task: place for place, task in enumerate(suite.ALL_TASKS)}
    rows.sort(key=lambda row: (order[row[:2]], names.index(row[2]), row[3] or 0))
    have = {row[:2] for row in rows}
    none = [task for task in suite.ALL_TASKS if task not in have]
    return {**content, "scores": rows, "none_found": none}


def text_of(content: _File) -> str:
    """The file's text, with one line per score."""
    parts = {
        "sources": json.dumps(content["sources"], indent=1, ensure_ascii=False),
        "columns": json.dumps(content["columns"]),
        "scores": _one_per_line(content["scores"]),
        "none_found": _one_per_line(content["none_found"]),
    }
    lines = [f'"{name}": {text}'.replace("\n", "\n ") for name, text in parts.items()]
    return "{\n " + ",\n ".join(lines) + "\n}\n"


def _one_per_line(rows: Iterable[Sequence[object]]) -> str:
    lines = [f" {json.dumps(row)}" for row in rows]
    return "[\n" + ",\n".join(lines) + "\n]"


def main(
    folder: Annotated[Path, typer.Argument(help="With a clone of each repository.")],
    check: Annotated[bool, typer.Option(help="Write nothing; fail if the file differs.")] = False,
) -> None:
    """Compute the published scores from the files of their sources."""

    def read(source: published.Source, path: str) -> str:
        clone = folder / source.address.rpartition("/")[2]
        command = ["git", "-C", str(clone), "show", f"{source.revision}:{path}"]
        shown = subprocess.run(command, capture_output=True, encoding="utf-8", check=True).stdout
        # Git shows a folder as a line with its name, an empty line, and its entries.
        return shown.partition("\n\n")[2] if path.endswith("/") else shown

    before = FILE.read_text(encoding="utf-8")
    after = text_of(computed(json.loads(before), read))
    if not check:
        write_whole(FILE, after)
    elif after != before:
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
