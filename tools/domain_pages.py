"""Pages of the domains, made from the registry.

    domain_pages.fill(text, "humanoid")     # a page of docs/ with its tables in place
    domain_pages.skeleton("swing")          # the page of a domain that docs/ has none for

A page of docs/ marks the place of a table by a line `<!-- generated: observations -->`, below a
heading of its own. A domain without such a page gets one with all tables. So a new domain has its
page as soon as it is registered, and no table can differ from the model.
"""

import functools
import inspect
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import domain_facts
import learned_pictures
import solved_pictures
from domain_facts import Facts

from limberjack import suite

__all__ = ["SECTIONS", "alternative", "fill", "picture_name", "skeleton"]

_MARK = re.compile(r"^<!-- generated: ([\w ]+) -->$", re.MULTILINE)
_RESULTS = Path(__file__).parents[1] / "benchmarks" / "results" / "scores"
_FOLDER = "images/domains"
_PICTURES_BESIDE = 4  # in a row; they fit a page


@functools.cache
def _facts(domain: str) -> tuple[Facts, ...]:
    return tuple(domain_facts.read(domain, task) for task in suite.TASKS_BY_DOMAIN[domain])


def fill(text: str, domain: str = "") -> str:
    """A page with every marked table in place.

    Raises:
      ValueError: a mark names no table.
    """

    def table(mark: re.Match[str]) -> str:
        name = mark[1]
        if name == "all tasks":
            return _all_tasks()
        if name not in SECTIONS:
            raise ValueError(
                f"mark {mark[0]!r} names no table; expected: all tasks, {', '.join(SECTIONS)}"
            )
        return SECTIONS[name](_facts(domain))

    return _MARK.sub(table, text)


def skeleton(domain: str) -> str:
    """The page of a domain that has no hand-written one."""
    module = suite.module_of(domain)
    text = inspect.getdoc(module) or ""
    parts = [f"# {domain.replace('_', ' ').capitalize()}", text]
    for name, section in SECTIONS.items():
        found = section(_facts(domain))
        if found:
            parts += [f"## {name.capitalize()}", found]
    return "\n\n".join(parts) + "\n"


def picture_name(domain: str, task: str) -> str:
    """The path of a task's picture, below the folder of the pages."""
    return f"{_FOLDER}/{domain}-{task}.png"


def alternative(facts: Facts) -> str:
    """Words in the place of a task's picture."""
    return (
        f"The {facts.domain} a moment after the start of an episode of {facts.task}. "
        f"The task: {facts.wants}"
    )


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table without the columns that are empty in every row."""
    kept = [i for i in range(len(columns)) if any(row[i] for row in rows)]
    lines = [[columns[i] for i in kept], ["---"] * len(kept)]
    lines += [[row[i].replace("|", "\\|") for i in kept] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _records(rows: Sequence[NamedTuple], code: str) -> str:
    """A table of records with a column for each field, one of which is code; empty without any."""
    if not rows:
        return ""
    names = rows[0]._fields
    place = names.index(code)
    return _table(names, [[*row[:place], _code(row[place]), *row[place + 1 :]] for row in rows])


def _code(text: str) -> str:
    return f"`{text}`" if text else ""


def _by_task(
    facts: Sequence[Facts], key: Callable[[Facts], object], show: Callable[[Facts], str]
) -> str:
    """The text of `show`, once for all tasks with the same `key`; with their names if needed."""
    groups: dict[object, list[Facts]] = {}
    for each in facts:
        groups.setdefault(key(each), []).append(each)
    parts = []
    for group in groups.values():
        shown = show(group[0])
        if shown and len(groups) > 1:
            names = ", ".join(each.task for each in group)
            shown = f"**{names}**\n\n{shown}"
        parts += [shown] if shown else []
    return "\n\n".join(parts)


def _all_tasks() -> str:
    """The tasks of all domains."""
    rows = [
        [
            *(f"[{f.domain}]({f.domain}.md)", f.task, ", ".join(f.tags)),
            *(str(len(f.actions)), f.observations[-1].flat.split(":")[1], _partly_size(f) or "-"),
            *(f.time_limit, f.control_timestep, f.physics_steps),
        ]
        for domain in suite.TASKS_BY_DOMAIN
        for f in _facts(domain)
    ]
    columns = ["domain", "task", "tags", "actions", "observation", "partly"]
    return _table([*columns, "time limit", "control step", "physics steps"], rows)


def _partly_size(facts: Facts) -> str:
    """The size of observations with `fully_observable=False`; empty without that option."""
    ends = [o.flat.split(":")[1] for o in facts.observations if o.key in facts.partly]
    return ends[-1] if ends else ""


def _tasks(facts: Sequence[Facts]) -> str:
    """Pictures of the tasks, and their names, tags and times."""
    pictures = []
    for first in range(0, len(facts), _PICTURES_BESIDE):
        row = facts[first : first + _PICTURES_BESIDE]
        pictures.append(_table([f.task for f in row], [[_picture(f) for f in row]]))
    rows = [
        [
            *(_code(f.task), f.wants, ", ".join(f.tags), f.steps),
            *(f.time_limit, f.control_timestep, f.physics_steps),
        ]
        for f in facts
    ]
    columns = ["task", "goal", "tags", "steps", "time limit", "control step", "physics steps"]
    ids = f"Gymnasium's ids are `limberjack/{facts[0].domain}-TASK-v0`."
    return "\n\n".join([*pictures, _table(columns, rows), ids])


def _picture(facts: Facts) -> str:
    path = picture_name(facts.domain, facts.task)
    return f'![{alternative(facts)}]({path}){{ width="160" loading="lazy" }}'


def _solved(facts: Sequence[Facts]) -> str:
    """Pictures of episodes of the bundled policies and of the planner; empty without either."""
    return "\n\n".join(filter(None, (_learned(facts), _planned(facts))))


def _learned(facts: Sequence[Facts]) -> str:
    """A picture of the bundled policies, a row for each task."""
    played = learned_pictures.episodes()
    found = sorted(
        (f.task, played[name]) for f in facts if (name := f"{f.domain}-{f.task}") in played
    )
    if not found:
        return ""
    domain, names = facts[0].domain, ", ".join(task for task, _ in found)
    rows = "a row of four pictures" if len(found) == 1 else "a row of four pictures for each task"
    words = f"The {domain} under the bundled policies: {rows}, {names}"
    times = ", ".join(f"{second:g}" for second in found[0][1].seconds)
    means = ", ".join(f"{task} {episode.mean:.1f}" for task, episode in found)
    return (
        f'![{words}](images/learned/{domain}.png){{ loading="lazy" }}\n\n*From top to bottom: '
        f"{names}. The [bundled policies](policies.md#bundled-policies), seed {found[0][1].seed}, "
        f"after {times} s. Mean returns over 100 seeds: {means}.*"
    )


def _planned(facts: Sequence[Facts]) -> str:
    """Pictures of the planner's episodes; empty for tasks that it does not play."""
    played = solved_pictures.episodes()
    parts = []
    for each in facts:
        episode = played.get(f"{each.domain}-{each.task}")
        if episode is None:
            continue
        path = f"images/solved/{each.domain}-{each.task}.png"
        words = (
            f"The {each.domain} in four pictures of the first {episode.seconds[-1]:g} s of an "
            f"episode of {each.task} that the planner plays. The task: {each.wants}"
        )
        times = ", ".join(f"{second:g}" for second in episode.seconds)
        parts.append(
            f'![{words}]({path}){{ loading="lazy" }}\n\n*{each.task}: the planner, seed '
            f"{episode.seed}, after {times} s. Mean reward of the last 50 steps: "
            f"{episode.reward:.2f}.*"
        )
    return "\n\n".join(parts)


def _observations(facts: Sequence[Facts]) -> str:
    """The observations, by name, place and unit."""
    return _by_task(facts, lambda f: (f.observations, f.partly), _observations_of)


def _observations_of(facts: Facts) -> str:
    table = _records(facts.observations, "key")
    if not facts.partly:
        return table
    keys = ", ".join(map(_code, facts.partly))
    return (
        f'{table}\n\nWith `task_kwargs={{"fully_observable": False}}` the observation is {keys}: '
        f"{_partly_size(facts)} numbers."
    )


def _actions(facts: Sequence[Facts]) -> str:
    """The actuators, in the order of the action."""
    return _by_task(facts, lambda f: f.actions, lambda f: _records(f.actions, "actuator"))


def _joints(facts: Sequence[Facts]) -> str:
    """The joints, and where each stands in the generalised positions and velocities."""
    return _by_task(facts, lambda f: f.joints, lambda f: _records(f.joints, "joint"))


def _reward(facts: Sequence[Facts]) -> str:
    """The terms of the reward and how they are put together, in the task's own words."""

    def text(each: Facts) -> str:
        rows = [[_code(t.term), t.goal] for t in each.terms]
        parts = [_table(["term", "part of the goal"], rows)] if rows else []
        methods = ("reward_terms", "reward_of") if rows else ("get_reward",)
        described = [_document(each.kind, name) for name in methods]
        return "\n\n".join([*parts, *filter(None, described), _source(each.kind, methods)])

    return _by_task(facts, lambda f: (f.terms, f.kind), text)


def _starts(facts: Sequence[Facts]) -> str:
    """The starts of episodes, and the kinds of starts that scores are reported for."""

    def text(each: Facts) -> str:
        parts = [_document(each.kind, "initialize_episode")]
        if each.starts:
            parts.append("Kinds of starts: " + ", ".join(map(_code, each.starts)) + ".")
        methods = ("initialize_episode", "_draw_start", "start")
        return "\n\n".join([*filter(None, parts), _source(each.kind, methods)])

    return _by_task(facts, lambda f: (f.starts, f.kind), text)


def _measurements(facts: Sequence[Facts]) -> str:
    """The methods of the domain's physics."""

    def table(each: Facts) -> str:
        rows = [[_code(m.method), m.gives] for m in each.measurements]
        return _table(["method of `env.physics`", "gives"], rows) if rows else ""

    return _by_task(facts, lambda f: f.measurements, table)


def _cameras(facts: Sequence[Facts]) -> str:
    """The cameras of the model, by name and number."""
    return _by_task(
        facts,
        lambda f: f.cameras,
        lambda f: ", ".join(f"`{name}` ({i})" for i, name in enumerate(f.cameras)) + ".",
    )


def _scores(facts: Sequence[Facts]) -> str:
    """Mean returns and successes from the committed results; empty without any."""
    rows = []
    for each in facts:
        best = {}
        for path in sorted(_RESULTS.glob(f"{each.domain}-{each.task}-*.json")):
            for policy, summary in json.loads(path.read_text(encoding="utf-8"))["summary"].items():
                if summary["episodes"] > best.get(policy, {"episodes": 0})["episodes"]:
                    best[policy] = summary
        rows += [
            [
                *(_code(each.task), policy, str(summary["episodes"]), f"{summary['mean']:.1f}"),
                f"{100 * summary['success_rate']:.1f} %",
            ]
            for policy, summary in best.items()
        ]
    if not rows:
        return ""
    table = _table(["task", "policy", "episodes", "mean return", "success"], rows)
    return f"{table}\n\n[Scores](scores.md) has the intervals, the seeds and the versions."


def _document(kind: type, name: str) -> str:
    """The docstring of a task's own method, as a sentence about it; empty if it is inherited."""
    method = _own_method(kind, name)
    text = inspect.getdoc(method) if method is not None else None
    return f"`{name}`: {' '.join(text.split())}" if text else ""


def _own_method(kind: type, name: str) -> Callable[..., object] | None:
    """A method that the task's class defines, or a base class outside of the common one."""
    for base in kind.__mro__:
        if base.__module__ in ("limberjack.suite.base", "limberjack.rl.control"):
            return None
        if name in vars(base):
            return vars(base)[name]
    return None


def _source(kind: type, methods: Sequence[str]) -> str:
    """The source of a task's own methods, folded."""
    found = [method for method in (_own_method(kind, name) for name in methods) if method]
    if not found:
        return ""
    code = "\n".join(inspect.getsource(method).rstrip() + "\n" for method in found)
    lines = ["```python", *inspect.cleandoc("\n" + code).splitlines(), "```"]
    indented = "\n".join(f"    {line}".rstrip() for line in lines)
    return f'??? note "Source"\n\n{indented}'


SECTIONS: dict[str, Callable[[Sequence[Facts]], str]] = {
    "tasks": _tasks,
    "solved episodes": _solved,
    "starts": _starts,
    "observations": _observations,
    "actions": _actions,
    "joints": _joints,
    "reward": _reward,
    "measurements": _measurements,
    "cameras": _cameras,
    "scores": _scores,
}
