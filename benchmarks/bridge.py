"""Mean returns in dm_control on other versions of MuJoCo and here: same policies, same seeds.

    pip install dm_control mujoco safetensors             # in an environment with MuJoCo 3
    python benchmarks/bridge.py --python PATH/bin/python  # of that environment; may be repeated

plays the bundled policies, and zero actions on the tasks of the set dmc28, on 100 seeds that no
training has seen: in each of these environments with dm_control, and in this one with Limberjack.
`bridge_player.py` plays on all sides, one process after the other. Results are in
results/bridge.json, task by task, so that the same command continues where it was interrupted. The
file is of one list of environments and versions: a run with others begins again, and a policy file
that has changed is played again. At the end, and without an environment only this, it writes the
tables of docs/bridge.md and draws docs/images/bridge.svg.
"""

import dataclasses
import hashlib
import importlib
import json
import os
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import pages
import sources
import typer

from limberjack import policies
from limberjack.episodes.statistics import bootstrap_interval
from limberjack.registry import sets

__all__ = ["FILE", "SEEDS", "Shift", "draw", "main", "measure", "rows_of", "section"]

FILE = Path(__file__).parent / "results" / "bridge.json"
SEEDS = range(40_000, 40_100)  # on which nothing was trained, evaluated or tuned

_PLAYER = Path(__file__).with_name("bridge_player.py")
_DOCS = Path(__file__).parents[1] / "docs"
_PAGE = _DOCS / "bridge.md"
_PICTURE = _DOCS / "images" / "bridge.svg"
_SET = "dmc28"
_ZERO, _LEARNED = "zero", "pretrained"
_HERE, _THERE = "limberjack", "dm_control"
_NEGLIGIBLE = 1.0  # of a return, whose maximum is 1,000; published scores are given to a whole one
_WIDTH = 105  # characters of a line of the page
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

_TEXT = (
    "Mean returns of seeds {seeds}. *here*: {here}. *there*, in the column of its MuJoCo: "
    "{others}. *shift*: the mean difference, here minus there, with its 95 % interval by the "
    "bootstrap over seeds; in bold where the interval leaves out zero and reaches beyond 1 of "
    "1,000; equal where all returns are equal. *largest*: the largest difference of one seed."
)

# Any: what was read from JSON.
_Row = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Shift:
    """The difference between the returns here and elsewhere, on the same seeds.

    Attributes:
      mean: of the differences, here minus there.
      interval: the 95 % interval of that mean, by the bootstrap over seeds.
      largest: absolute difference of a single seed.
    """

    mean: float
    interval: tuple[float, float]
    largest: float

    @classmethod
    def of(cls, here: npt.ArrayLike, there: npt.ArrayLike) -> "Shift":
        """The shift of at least two pairs of returns."""
        differences = np.subtract(here, there)
        interval = bootstrap_interval(differences)
        assert interval is not None
        return cls(float(differences.mean()), interval, float(np.abs(differences).max()))

    @property
    def is_negligible(self) -> bool:
        """Whether the whole interval is closer to zero than published scores are rounded."""
        return max(map(abs, self.interval)) < _NEGLIGIBLE

    @property
    def is_noise(self) -> bool:
        """Whether the mean may be zero, or is negligible."""
        low, high = self.interval
        return low <= 0 <= high or self.is_negligible


def measure(
    pythons: Sequence[str], only: Sequence[str] = (), file: Path = FILE, seeds: range = SEEDS
) -> None:
    """Plays what the file lacks, and adds it to the file.

    Args:
      pythons: the interpreters of environments with dm_control.
      only: names DOMAIN:TASK; all by default.
      file: of the results.
      seeds: of the episodes.

    Raises:
      ValueError: a name in `only` is not one of a task that is compared.
      subprocess.CalledProcessError: a process failed; what was played before is in the file.
    """
    wanted = list(_wanted(seeds))
    unknown = set(only) - {f"{row['domain']}:{row['task']}" for row in wanted}
    if unknown:
        raise ValueError(
            f"{min(unknown)} is not compared; expected tasks of {_SET} or bundled ones"
        )
    sides = [(sys.executable, _HERE), *((python, _THERE) for python in pythons)]
    nothing = range(seeds.start, seeds.start)
    versions = [_play(*side, "pendulum", "swingup", nothing)["versions"] for side in sides]
    kept = {_key(row): row for row in rows_of(file) if row["versions"] == versions}
    kept = {key: row for key, row in kept.items() if key in map(_key, wanted)}
    for row in wanted:
        name = f"{row['domain']}:{row['task']}"
        if _key(row) in kept or (only and name not in only):
            continue
        path = None if row["policy"] == _ZERO else _path(row["domain"], row["task"])
        answers = [_play(*side, row["domain"], row["task"], seeds, path) for side in sides]
        kept[_key(row)] = {**row, "versions": versions, **_compared(answers)}
        rows = [kept[key] for key in map(_key, wanted) if key in kept]
        sources.write(file, {"rows": rows})
        typer.echo(f"{name} {row['policy']}")


def rows_of(file: Path = FILE) -> list[_Row]:
    """The results of all tasks and policies; none if there is no file."""
    return json.loads(file.read_text(encoding="utf-8"))["rows"] if file.exists() else []


def _wanted(seeds: range) -> Iterator[_Row]:
    """The rows to measure, without their results."""
    named = f"{seeds.start}:{seeds.stop}"
    for one in policies.bundled():
        row = {"domain": one.domain, "task": one.task, "policy": _LEARNED, "sha256": one.sha256}
        yield {**row, "action_repeat": one.card.action_repeat, "seeds": named}
    for domain, task in sets.tasks_of(_SET):
        row = {"domain": domain, "task": task, "policy": _ZERO, "sha256": None}
        yield {**row, "action_repeat": 1, "seeds": named}


def _key(row: _Row) -> tuple[str, ...]:
    return tuple(str(row[name]) for name in ("domain", "task", "policy", "sha256", "seeds"))


def _path(domain: str, task: str) -> Path:
    (path,) = (one.path for one in policies.bundled() if (one.domain, one.task) == (domain, task))
    return path


def _play(
    python: str, package: str, domain: str, task: str, seeds: range, policy: Path | None = None
) -> Any:
    """The answer of `bridge_player.py` in an interpreter."""
    given = [package, domain, task, str(seeds.start), str(seeds.stop)]
    command = [python, str(_PLAYER), *given, *([] if policy is None else [str(policy)])]
    environment = {**os.environ, **_ONE_THREAD}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def _compared(answers: Sequence[Any]) -> _Row:
    """The returns on all sides, and how the starts of the others differ from those here."""
    here, *others = (answer["episodes"] for answer in answers)
    starts = []
    for there in others:
        pairs = list(zip(here, there, strict=True))
        first = [np.subtract(a["observation"], b["observation"]) for a, b in pairs]
        states = [np.subtract(a["state"], b["state"]) for a, b in pairs]
        largest = {"state": float(np.abs(states).max()), "observation": float(np.abs(first).max())}
        starts.append({"equal": sum(not state.any() for state in states), **largest})
    returns = [[episode["return"] for episode in side] for side in (here, *others)]
    return {"returns": returns, "starts": starts}


def section(rows: Sequence[_Row]) -> str:
    """The text between the marks of the page; empty without results."""
    if not rows:
        return ""
    here, *others = rows[0]["versions"]
    text = _TEXT.format(
        here=_named(here, _HERE),
        others=" and ".join(_named(other, _THERE) for other in others),
        seeds=rows[0]["seeds"],
    )
    lines = ["", _wrapped(text), ""]
    for side, other in enumerate(others):
        found = f"{_verdict(rows, side)} {_starts(rows, side)}"
        lines += [_wrapped(f"**{_named(other, _THERE)}.** {found}"), ""]
    for policy, title in ((_LEARNED, "Bundled policies"), (_ZERO, "Zero actions")):
        listed = [row for row in rows if row["policy"] == policy]
        lines += [f"### {title}", "", *_table(listed, others), ""] if listed else []
    played = {(row["domain"], row["task"]) for row in rows if row["policy"] == _ZERO}
    missing = [" ".join(task) for task in sets.tasks_of(_SET) if task not in played]
    if missing:
        lines += [_wrapped(f"Not measured with zero actions yet: {', '.join(missing)}."), ""]
    return "\n".join(lines)


def _wrapped(text: str) -> str:
    return textwrap.fill(text, _WIDTH, break_on_hyphens=False)


def _named(versions: dict[str, str], package: str) -> str:
    title = {_HERE: "Limberjack"}.get(package, package)
    return f"{title} {versions[package]} on MuJoCo {versions['mujoco']}"


def _task(row: _Row) -> str:
    return f"{row['domain']} {row['task']}"


def _shift(row: _Row, side: int) -> Shift:
    """The shift beside the other side of that number, counted from 0."""
    here, *others = row["returns"]
    return Shift.of(here, others[side])


def _verdict(rows: Sequence[_Row], side: int) -> str:
    """The number of tasks whose mean does not differ, and the others with their shifts."""
    sentences = []
    for policy, title in ((_LEARNED, "The bundled policies"), (_ZERO, "Zero actions")):
        shifts = {_task(row): _shift(row, side) for row in rows if row["policy"] == policy}
        if not shifts:
            continue
        equal = sum(shift.is_noise for shift in shifts.values())
        found = [f"{name} {_signed(shift)}" for name, shift in shifts.items() if not shift.is_noise]
        rest = f"; shifted: {', '.join(found)}" if found else ""
        share = f"all {len(shifts)}" if equal == len(shifts) else f"{equal} of {len(shifts)}"
        widest = max(shifts, key=lambda name: np.ptp(shifts[name].interval))
        low, high = shifts[widest].interval
        sentences.append(
            f"{title}: no difference beyond noise on {share} tasks{rest}. The widest interval is "
            f"that of {widest}, {_number(low)} to {_number(high)}."
        )
    return " ".join(sentences)


def _starts(rows: Sequence[_Row], side: int) -> str:
    """The number of tasks whose starts are equal, and the largest difference of the others."""
    tasks = {_task(row): (row["starts"][side], len(row["returns"][0])) for row in rows}
    other = {name: one for name, (one, count) in tasks.items() if one["equal"] < count}
    first = max(one["observation"] for one, _ in tasks.values())
    equal = f"{len(tasks) - len(other)} of {len(tasks)} tasks" if other else "all tasks"
    text = f"The starts, positions and velocities, are equal bit for bit on {equal}"
    if other:
        named = (
            f"{name} ({one['equal']} of {tasks[name][1]}, differences up to {one['state']:.0e})"
            for name, one in other.items()
        )
        text += f"; not on {', '.join(named)}"
    return f"{text}. The first observations differ by at most {first:.0e}." if first else f"{text}."


def _signed(shift: Shift) -> str:
    if not shift.largest:
        return "equal"
    mean, low, high = (_number(value) for value in (shift.mean, *shift.interval))
    return f"{mean} ({low} to {high})"


def _number(value: float) -> str:
    return f"{round(value, 2) + 0.0:+.2f}"  # without a negative zero


def _table(rows: Sequence[_Row], others: Sequence[dict[str, str]]) -> list[str]:
    head = ["task", "repeat", "here"]
    for other in others:
        head += [f"MuJoCo {other['mujoco']}", "shift", "largest"]
    lines = []
    for row in rows:
        means = [f"{np.mean(side):.1f}" for side in row["returns"]]
        cells = [_task(row), str(row["action_repeat"]), means[0]]
        for side, mean in enumerate(means[1:]):
            shift = _shift(row, side)
            text = _signed(shift)
            cells += [mean, text if shift.is_noise else f"**{text}**", f"{shift.largest:.2f}"]
        lines.append(cells)
    return pages.table(head, lines)


def draw(rows: Sequence[_Row], picture: Path = _PICTURE) -> None:
    """Draws the shifts with their intervals: a panel for policies, and one for zero actions.

    The band behind them is what is negligible.
    """
    pyplot: Any = importlib.import_module("matplotlib.pyplot")
    pyplot.rcParams.update({"svg.hashsalt": "limberjack", "font.size": 9})
    titles = {_LEARNED: "bundled policies", _ZERO: "zero actions"}
    panels = {name: [row for row in rows if row["policy"] == name] for name in titles}
    heights = [len(listed) + 1 for listed in panels.values()]
    figure, axes = pyplot.subplots(
        2, 1, figsize=(7, 1 + 0.2 * sum(heights)), sharex=True, height_ratios=heights
    )
    for axis, (name, listed) in zip(axes, panels.items(), strict=True):
        places = np.arange(len(listed))
        _, *others = rows[0]["versions"]
        for side, other in enumerate(others):
            shifts = [_shift(row, side) for row in listed]
            means = np.array([shift.mean for shift in shifts])
            bounds = np.array([shift.interval for shift in shifts]).reshape(-1, 2).T
            spread = np.abs(bounds - means)
            axis.errorbar(
                means,
                places + (side - (len(others) - 1) / 2) * 0.3,
                xerr=spread,
                fmt="o",
                markersize=3,
                linewidth=1,
                label=f"MuJoCo {other['mujoco']}",
            )
        axis.axvspan(-_NEGLIGIBLE, _NEGLIGIBLE, color="black", alpha=0.06, linewidth=0)
        axis.axvline(0, color="black", linewidth=0.5)
        axis.set_yticks(places, [_task(row) for row in listed])
        axis.set(title=titles[name], ylim=(len(listed) - 0.4, -0.6))
        axis.grid(alpha=0.3)
    axes[1].set_xscale("symlog", linthresh=_NEGLIGIBLE)
    axes[1].xaxis.set_major_formatter("{x:g}")
    low, high = axes[1].get_xlim()
    axes[1].set_xlim(min(low, -1.5 * _NEGLIGIBLE), max(high, 1.5 * _NEGLIGIBLE))
    axes[1].set_xlabel("mean return here minus mean return there, with its 95 % interval")
    axes[0].legend(frameon=False)
    figure.tight_layout()
    drawn = [[row["domain"], row["task"], row["policy"], row["returns"]] for row in rows]
    digest = hashlib.sha256(json.dumps(drawn).encode()).hexdigest()
    figure.savefig(picture, metadata={"Date": None, "Description": f"of results {digest}"})
    pyplot.close(figure)


def main(
    python: Annotated[
        list[str] | None, typer.Option(help="Interpreter of an environment with dm_control.")
    ] = None,
    only: Annotated[list[str] | None, typer.Option(help="Play this DOMAIN:TASK only.")] = None,
) -> None:
    """Plays what the results lack, if an environment is given, and writes page and figure."""
    if python:
        measure(python, only or ())
    rows = rows_of()
    pages.write_section(_PAGE, "the bridge", "bridge.py", section(rows))
    draw(rows)


if __name__ == "__main__":
    typer.run(main)
