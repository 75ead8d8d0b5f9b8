"""The documentation is right: its code runs, its tables, links and commands agree with the project.

On every page all ```python blocks are one program; a comment behind a `print` is what it prints.
"""

import functools
import importlib
import math
import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from limberjack import suite
from limberjack.cli import app
from limberjack.suite import _entry_points as entry_points
from tests.programs import run

_REPOSITORY = Path(__file__).parents[2]
_DOCS = _REPOSITORY / "docs"
_PAGES = [*sorted(_DOCS.glob("*.md")), _REPOSITORY / "README.md", _REPOSITORY / "CONTRIBUTING.md"]

_FENCE = re.compile(r"^(```+)(\w*)\n(.*?)^\1$", re.MULTILINE | re.DOTALL)
_PRINTED = re.compile(r"^ *print\(.*\)  # (.*)$", re.MULTILINE)
_STARTS = 2000
# The tables were made of 20,000 starts, and the test makes 2,000: four standard errors of the
# difference, for a share of 0.8 of all starts and for one of 0.6 of those that are not uniform.
_SHARE_TOLERANCE = 0.038
_MOVING_TOLERANCE = 0.12

_Row = dict[str, str]


def _page_name(page: Path) -> str:
    return str(page.relative_to(_REPOSITORY))


every_page = pytest.mark.parametrize("page", _PAGES, ids=_page_name)
every_task = pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)


def _program(page: Path) -> str:
    """The page's Python blocks, each line where it stands on the page."""
    text = page.read_text(encoding="utf-8")
    lines = [""] * text.count("\n")
    for block in _FENCE.finditer(text):
        if block[2] == "python":
            start = text.count("\n", 0, block.start(3))
            code = block[3].splitlines()
            lines[start : start + len(code)] = code
    return "\n".join(lines)


@pytest.mark.parametrize(
    "page", [page for page in _PAGES if _program(page).strip()], ids=_page_name
)
def test_the_code_of_a_page_runs_and_prints_what_it_says(page: Path) -> None:
    program = _program(page)
    if ".render(" in program and os.environ.get("MUJOCO_GL") == "disable":
        pytest.skip("MUJOCO_GL turns rendering off")
    assert run(program).splitlines() == _PRINTED.findall(program)


# Tables.


def _cells(line: str) -> list[str]:
    return [cell.strip().replace("`", "") for cell in line.strip().strip("|").split("|")]


@functools.cache
def _tables(page: str) -> list[tuple[str, list[_Row]]]:
    """The tables of a page of docs/, each with the heading above it and its rows by column."""
    heading, lines = "", (_DOCS / page).read_text(encoding="utf-8").splitlines()
    found: list[tuple[str, list[_Row]]] = []
    for number, line in enumerate(lines):
        if line.startswith("#"):
            heading = line.lstrip("# ")
        elif line.startswith("|---"):
            columns, rows = _cells(lines[number - 1]), []
            for row in lines[number + 1 :]:
                if not row.startswith("|"):
                    break
                rows.append(dict(zip(columns, _cells(row), strict=True)))
            found.append((heading, rows))
    return found


def _table(page: str, *columns: str) -> list[_Row]:
    """The one table of a page that has these columns."""
    (rows,) = [rows for _, rows in _tables(page) if set(columns) <= set(rows[0])]
    return rows


def _observation_table(domain: str, task: str) -> list[_Row]:
    """The one table of a task's observation: of all tasks, or of those that its heading names."""
    (rows,) = [
        rows
        for heading, rows in _tables(f"{domain}.md")
        if {"key", "shape", "flat"} <= set(rows[0])
        and (":" not in heading or task in re.split(r"[:,] *", heading))
    ]
    return rows


def _layout(env: Any) -> list[tuple[str, str, str]]:
    """Key, shape and place in the flat observation, as the tables write them."""
    layout, start = [], 0
    for key, spec in env.observation_spec().items():
        assert spec.dtype == float
        end = start + math.prod(spec.shape)
        layout.append((key, str(tuple(spec.shape)), f"{start}:{end}"))
        start = end
    return layout


def _written_layout(rows: list[_Row]) -> list[tuple[str, str, str]]:
    return [(row["key"], row["shape"], row["flat"]) for row in rows]


@every_task
def test_the_table_of_the_observation_is_the_layout(domain: str, task: str) -> None:
    env = suite.load(domain, task)
    written = _written_layout(_observation_table(domain, task))
    assert written == _layout(env)
    flat = suite.load(domain, task, environment_kwargs={"flat_observation": True})
    (spec,) = flat.observation_spec().values()
    assert spec.shape == (int(written[-1][2].split(":")[1]),)


@pytest.mark.parametrize(
    ("domain", "task"), [task for task in suite.ALL_TASKS if task[0] != "humanoid"]
)
def test_the_partly_observable_layout_is_the_first_three_rows(domain: str, task: str) -> None:
    env = suite.load(domain, task, task_kwargs={"fully_observable": False})
    assert _written_layout(_observation_table(domain, task)[:3]) == _layout(env)


def _size(env: Any) -> str:
    return str(sum(math.prod(spec.shape) for spec in env.observation_spec().values()))


def _facts(domain: str, task: str) -> list[str]:
    """A task's row of the table of all tasks."""
    env = suite.load(domain, task)
    tags = [tag for tag in ("benchmarking", "easy", "hard", "extra")
            if (domain, task) in getattr(suite, tag.upper())]  # fmt: skip
    partly = "-"
    if domain != "humanoid":
        partly = _size(suite.load(domain, task, task_kwargs={"fully_observable": False}))
    seconds = env._step_limit * env.control_timestep()
    return [
        *(f"[{domain}]({domain}.md)", task, ", ".join(tags)),
        *(str(env.action_spec().shape[0]), _size(env), partly),
        *(f"{seconds:g} s", f"{env.control_timestep():g} s"),
        f"{env._n_sub_steps} of {env.physics.timestep():g} s",
    ]


def test_the_table_of_all_tasks_is_the_suite() -> None:
    rows = _table("domains.md", "domain", "task", "tags")
    assert [list(row.values()) for row in rows] == [_facts(*task) for task in suite.ALL_TASKS]


def _actuators(env: Any) -> list[list[str]]:
    """Number, name, gear and the joints that each actuator drives."""
    model = env.physics.model.ptr
    found = []
    for number in range(model.nu):
        actuator, target = model.actuator(number), int(model.actuator_trnid[number, 0])
        joints = [model.joint(target).name]
        if actuator.trntype[0] == 3:  # a tendon
            start, count = model.tendon_adr[target], model.tendon_num[target]
            joints = [model.joint(i).name for i in model.wrap_objid[start : start + count]]
        found.append([str(number), actuator.name, f"{actuator.gear[0]:g}", ", ".join(joints)])
    return found


@pytest.mark.parametrize(
    ("page", "task"),
    [("humanoid.md", "walk"), ("manipulator.md", "bring_ball"), ("manipulator.md", "insert_peg")],
)
def test_the_table_of_the_action_is_the_actuators(page: str, task: str) -> None:
    rows = _table(page, "action", "actuator", "gear", "joint")
    written = [[row["action"], row["actuator"], row["gear"], row["joint"]] for row in rows]
    assert written == _actuators(suite.load(page.removesuffix(".md"), task))


def test_the_arms_of_both_domains_are_one() -> None:
    arms = [suite.load("manipulator", "bring_peg"), suite.load("stacker", "stack_4")]
    assert _actuators(arms[0]) == _actuators(arms[1])


def _limits(env: Any, joint: str) -> str:
    """The joint's range in degrees, as the tables write it."""
    is_limited = env.physics.named.model.jnt_limited[joint]
    low, high = (math.degrees(limit) for limit in env.physics.named.model.jnt_range[joint])
    return f"{low:.0f} to {high:.0f}" if is_limited else "none"


def test_the_table_of_the_humanoids_joints_is_the_model() -> None:
    env = suite.load("humanoid", "walk")
    model = env.physics.model.ptr
    written = _table("humanoid.md", "joint_angles", "joint", "range, degrees")
    expected = [
        [str(number), str(number + 6), model.joint(number + 1).name]
        for number in range(model.njnt - 1)
    ]
    assert [[row["joint_angles"], row["velocity"], row["joint"]] for row in written] == expected
    assert all(row["range, degrees"] == _limits(env, row["joint"]) for row in written)
    assert model.jnt_qposadr[1] == 7
    assert model.jnt_dofadr[1] == 6


def test_the_table_of_the_arms_joints_is_the_order_of_the_observation() -> None:
    written = _table("manipulator.md", "row", "joint", "range, degrees")
    for where in (("manipulator", "bring_ball"), ("stacker", "stack_2")):
        env = suite.load(*where)
        joints = [row["joint"] for row in written]
        observation = env.reset().observation
        assert [row["row"] for row in written] == [str(row) for row in range(8)]
        assert (observation["arm_pos"] == env.physics.bounded_joint_pos(joints)).all()
        assert all(row["range, degrees"] == _limits(env, row["joint"]) for row in written)


@pytest.mark.parametrize("task", suite.TASKS_BY_DOMAIN["manipulator"])
def test_the_table_of_starts_has_the_frequencies_that_come(task: str) -> None:
    env = suite.load("manipulator", task, task_kwargs={"random": 0})
    kinds: Counter[str] = Counter()
    moving: Counter[str] = Counter()
    for _ in range(_STARTS):
        env.reset()
        kind = env.task.start(env.physics)
        kinds[kind] += 1
        moving[kind] += bool(env.physics.data.qvel.any())
    (row,) = [row for row in _table("manipulator.md", "task", "in_hand") if row["task"] == task]
    for kind in ("in_hand", "in_target", "uniform"):
        assert _share(row[kind]) == pytest.approx(kinds[kind] / _STARTS, abs=_SHARE_TOLERANCE)
    kept = (moving["in_hand"] + moving["in_target"]) / (kinds["in_hand"] + kinds["in_target"])
    assert _share(row["moving"]) == pytest.approx(kept, abs=_MOVING_TOLERANCE)


def _share(percentage: str) -> float:
    return float(percentage.removesuffix(" %")) / 100


# Links, names and commands.


def _prose(page: Path) -> str:
    """The page without its fenced blocks."""
    return _FENCE.sub("", page.read_text(encoding="utf-8"))


def _anchors(page: Path) -> set[str]:
    """What GitHub makes of the page's headings."""
    headings = re.findall(r"^#+ +(.*)$", _prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@every_page
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    for link in re.findall(r"\[[^\]]*\]\(([^)\s]+)\)", _prose(page)):
        if re.match(r"\w+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{_page_name(page)}: {link}"
        assert not anchor or anchor in _anchors(target), f"{_page_name(page)}: {link}"


def test_every_page_is_in_the_index() -> None:
    index = (_DOCS / "README.md").read_text(encoding="utf-8")
    for page in _DOCS.glob("*.md"):
        assert page.name == "README.md" or f"({page.name}" in index, page.name


def _code(page: Path) -> Iterator[str]:
    """Spans and lines of code that are not Python."""
    yield from re.findall(r"`([^`\n]+)`", _prose(page))
    yield from re.findall(r"^ {4}(.*)$", _prose(page), re.MULTILINE)
    for block in _FENCE.finditer(page.read_text(encoding="utf-8")):
        if block[2] != "python":
            yield from block[3].splitlines()


@every_page
def test_every_name_and_path_of_the_project_exists(page: Path) -> None:
    for code in _code(page):
        if re.fullmatch(r"(src|tests|docs|examples)/[\w./-]*", code):
            assert (_REPOSITORY / code).exists(), f"{_page_name(page)}: {code}"
        elif re.fullmatch(r"limberjack(\.\w+)+", code) and code != entry_points.GROUP:
            assert _found(code), f"{_page_name(page)}: {code}"


def _found(name: str) -> bool:
    """Whether a dotted name is a module or an attribute of one."""
    parent, _, last = name.rpartition(".")
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        return bool(parent) and _found(parent) and hasattr(importlib.import_module(parent), last)
    return True


@every_page
def test_every_command_exists(page: Path) -> None:
    targets = re.findall(r"^([\w-]+):", (_REPOSITORY / "Makefile").read_text(), re.MULTILINE)
    for code in _code(page):
        program, *arguments = code.split("#")[0].removeprefix("python -m ").split() or [""]
        if program == "make":
            for argument in arguments:
                assert "=" in argument or argument in targets, f"{_page_name(page)}: {code}"
        elif program == "limberjack" and arguments:
            _check_call(arguments, f"{_page_name(page)}: {code}")


def _check_call(arguments: list[str], where: str) -> None:
    """Fails unless the command line has that command, those options and that task."""
    # Any: typer's own classes of commands.
    commands: Any = typer.main.get_command(app)
    name, *rest = arguments[2:] if arguments[0] == "--import" else arguments
    if name.startswith("-"):
        return
    assert name in commands.commands, where
    known = {option for parameter in commands.commands[name].params for option in parameter.opts}
    for option in re.findall(r"--[\w-]+", " ".join(rest)):
        assert option in known, where
    if name == "run" and len(rest) > 1 and rest[0].islower() and name == arguments[0]:
        assert (rest[0], rest[1]) in suite.ALL_TASKS, where
