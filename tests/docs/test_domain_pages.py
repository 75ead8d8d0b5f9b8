"""The tables of the domains' pages, as the site shows them, agree with the environments.

The expected values are read from the environments here again, not by the code that makes the pages.
"""

import functools
import importlib
import inspect
import json
import math
import re
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import domain_pages
import mujoco
import numpy as np
import pytest

from limberjack import suite
from tests import plain_domain, tutorial

_DOCS = Path(__file__).parents[2] / "docs"
_RESULTS = Path(__file__).parents[2] / "benchmarks" / "results" / "scores"
_STARTS = 2000
# The tables were made of 20,000 starts, and the test makes 2,000: four standard errors of the
# difference, for a share of 0.8 of all starts and for one of 0.6 of those that are not uniform.
_SHARE_TOLERANCE = 0.038
_MOVING_TOLERANCE = 0.12

_Row = dict[str, str]

every_task = pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
every_domain = pytest.mark.parametrize("domain", suite.TASKS_BY_DOMAIN)


def _cells(line: str) -> list[str]:
    return [cell.strip().replace("`", "") for cell in line.strip().strip("|").split("|")]


@functools.cache
def _page(name: str) -> str:
    """The text of a page with its tables in place."""
    written = _DOCS / f"{name}.md"
    if not written.exists():
        return domain_pages.skeleton(name)
    return domain_pages.fill(written.read_text(encoding="utf-8"), name)


@functools.cache
def _tables(name: str) -> list[tuple[str, list[_Row]]]:
    """The tables of a page, each with the tasks in bold above it, and its rows by column."""
    tasks, found, lines = "", [], _page(name).splitlines()
    for number, line in enumerate(lines):
        if line.startswith("#"):
            tasks = ""
        elif line.startswith("**") and line.endswith("**"):
            tasks = line.strip("*")
        elif re.match(r"\| ?---", line):
            columns, rows = _cells(lines[number - 1]), []
            for row in lines[number + 1 :]:
                if not row.startswith("|"):
                    break
                rows.append(dict(zip(columns, _cells(row), strict=True)))
            found.append((tasks, rows))
    return found


def _table(name: str, *columns: str, task: str = "") -> list[_Row]:
    """The one table of a page that has these columns, for a task if they differ."""
    (rows,) = [
        rows
        for tasks, rows in _tables(name)
        if set(columns) <= set(rows[0]) and (not tasks or not task or task in tasks.split(", "))
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


@every_task
def test_the_table_of_the_observation_is_the_layout(domain: str, task: str) -> None:
    rows = _table(domain, "key", "shape", "flat", task=task)
    written = [(row["key"], row["shape"], row["flat"]) for row in rows]
    assert written == _layout(suite.load(domain, task))
    flat = suite.load(domain, task, environment_kwargs={"flat_observation": True})
    (spec,) = flat.observation_spec().values()
    assert spec.shape == (int(written[-1][2].split(":")[1]),)


@every_task
def test_every_observation_has_a_meaning(domain: str, task: str) -> None:
    known = getattr(suite.module_of(domain), "OBSERVATIONS", {})
    for key in suite.load(domain, task).observation_spec():
        assert key in known, (
            f"{domain}: OBSERVATIONS lacks {key!r}; add base.Observed(meaning, unit)"
        )
        assert known[key].meaning


@every_domain
def test_every_meaning_is_of_an_observation(domain: str) -> None:
    observed = {
        key
        for task in suite.TASKS_BY_DOMAIN[domain]
        for key in suite.load(domain, task).observation_spec()
    }
    assert set(suite.module_of(domain).OBSERVATIONS) == observed


def _is_partly_observable(domain: str, task: str) -> bool:
    factory = suite.module_of(domain).SUITE[task]
    return "fully_observable" in inspect.signature(factory).parameters


@pytest.mark.parametrize(
    ("domain", "task"), [task for task in suite.ALL_TASKS if _is_partly_observable(*task)]
)
def test_the_partly_observable_layout_is_written(domain: str, task: str) -> None:
    env = suite.load(domain, task, task_kwargs={"fully_observable": False})
    keys = ", ".join(f"`{key}`" for key, _, _ in _layout(env))
    assert f"the observation is {keys}: {_size(env)} numbers." in _page(domain)


def _size(env: Any) -> str:
    return str(sum(math.prod(spec.shape) for spec in env.observation_spec().values()))


def _facts(domain: str, task: str) -> list[str]:
    """A task's row of the table of all tasks."""
    env = suite.load(domain, task)
    tags = [tag for tag in ("benchmarking", "easy", "hard", "extra")
            if (domain, task) in getattr(suite, tag.upper())]  # fmt: skip
    partly = "-"
    if _is_partly_observable(domain, task):
        partly = _size(suite.load(domain, task, task_kwargs={"fully_observable": False}))
    seconds = env._step_limit * env.control_timestep()
    limit = f"{seconds:g} s" if math.isfinite(seconds) else "none"
    return [
        *(f"[{domain}]({domain}.md)", task, ", ".join(tags)),
        *(str(env.action_spec().shape[0]), _size(env), partly),
        *(limit, f"{env.control_timestep():g} s"),
        f"{env._n_sub_steps} of {env.physics.timestep():g} s",
    ]


def test_the_table_of_all_tasks_is_the_suite() -> None:
    rows = _table("domains", "domain", "task", "tags")
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


@every_task
def test_the_table_of_the_action_is_the_actuators(domain: str, task: str) -> None:
    rows = _table(domain, "action", "actuator", "gear", "joint", task=task)
    written = [[row["action"], row["actuator"], row["gear"], row["joint"]] for row in rows]
    env = suite.load(domain, task)
    assert written == _actuators(env)
    spec = env.action_spec()
    limits = [np.where(abs(b) < mujoco.mjMAXVAL, b, np.sign(b) * np.inf)
              for b in (spec.minimum, spec.maximum)]  # fmt: skip
    assert [row["range"] for row in rows] == [
        f"{low:g} to {high:g}" for low, high in zip(*limits, strict=True)
    ]
    for row, number in zip(rows, range(env.physics.model.nu), strict=True):
        if row["kind"] == "motor" and env.physics.model.actuator_trntype[number] == 0:  # a joint
            is_slide = env.physics.named.model.jnt_type[row["joint"]] == 2
            assert row["unit"] == ("N" if is_slide else "N m")


def test_the_arms_of_both_domains_are_one() -> None:
    arms = [suite.load("manipulator", "bring_peg"), suite.load("stacker", "stack_4")]
    assert _actuators(arms[0]) == _actuators(arms[1])


def _limits(env: Any, joint: str) -> str:
    """The joint's range in degrees, as the tables write it."""
    is_limited = env.physics.named.model.jnt_limited[joint]
    low, high = (math.degrees(limit) for limit in env.physics.named.model.jnt_range[joint])
    return f"{low:.0f} to {high:.0f}" if is_limited else "none"


@every_task
def test_the_table_of_the_joints_is_the_model(domain: str, task: str) -> None:
    env = suite.load(domain, task)
    named, model = env.physics.named, env.physics.model.ptr
    rows = _table(domain, "joint", "kind", "qpos", "qvel", task=task)
    assert [row["joint"] for row in rows] == [model.joint(i).name for i in range(model.njnt)]
    for row in rows:
        for column, array in (("qpos", named.data.qpos), ("qvel", named.data.qvel)):
            first, _, end = row[column].partition(":")
            array[:] = 0
            array[row["joint"]] = 1
            places = range(int(first), int(end or int(first) + 1))
            assert list(array[:].nonzero()[0]) == list(places), row
        if row["kind"] == "hinge":
            assert row["range"].removesuffix(" degrees") == _limits(env, row["joint"])


def test_the_table_of_the_arms_joints_is_the_order_of_the_observation() -> None:
    written = _table("manipulator", "row", "joint", "range, degrees")
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
    (row,) = [row for row in _table("manipulator", "task", "in_hand") if row["task"] == task]
    for kind in ("in_hand", "in_target", "uniform"):
        assert _share(row[kind]) == pytest.approx(kinds[kind] / _STARTS, abs=_SHARE_TOLERANCE)
    kept = (moving["in_hand"] + moving["in_target"]) / (kinds["in_hand"] + kinds["in_target"])
    assert _share(row["moving"]) == pytest.approx(kept, abs=_MOVING_TOLERANCE)


def _share(percentage: str) -> float:
    return float(percentage.removesuffix(" %")) / 100


@every_task
def test_the_terms_of_the_reward_are_listed_with_those_of_the_goal(domain: str, task: str) -> None:
    env = suite.load(domain, task)
    env.reset()
    if not env.task.GOAL:  # a reward without terms
        assert "part of the goal" not in _page(domain)
        return
    rows = _table(domain, "term", "part of the goal", task=task)
    terms = {row["term"]: row["part of the goal"] == "yes" for row in rows}
    assert terms == {name: name in env.task.GOAL for name in env.task.reward_terms(env.physics)}


@every_task
def test_the_kinds_of_starts_are_listed(domain: str, task: str) -> None:
    starts = suite.load(domain, task).task.STARTS
    if not starts:
        return
    kinds = ", ".join(f"`{kind}`" for kind in starts)
    assert f"Kinds of starts: {kinds}." in _page(domain)


@pytest.mark.parametrize("path", sorted(_RESULTS.glob("*.json")), ids=lambda path: path.stem)
def test_the_scores_of_a_task_are_those_of_the_committed_results(path: Path) -> None:
    result = json.loads(path.read_text(encoding="utf-8"))
    policy = result["policy"]
    (row,) = [
        row
        for row in _table(result["domain"], "policy", "mean return")
        if (row["task"], row["policy"]) == (result["task"], policy)
    ]
    summary = result["summary"][policy]
    assert row["episodes"] == str(summary["episodes"])
    assert row["mean return"] == f"{summary['mean']:.1f}"


@every_task
def test_every_task_has_a_picture_with_words_in_its_place(domain: str, task: str) -> None:
    text, path = re.findall(rf"!\[([^\]]+)\]\(([^)]*{domain}-{task}\.png)\)", _page(domain))[0]
    assert path == domain_pages.picture_name(domain, task)
    assert task in text
    assert len(text.split()) > 8


_WRITTEN = [domain for domain in suite.TASKS_BY_DOMAIN if (_DOCS / f"{domain}.md").exists()]


@pytest.mark.parametrize("domain", _WRITTEN)
def test_a_written_page_has_every_section(domain: str) -> None:
    text = (_DOCS / f"{domain}.md").read_text(encoding="utf-8")
    for name in domain_pages.SECTIONS:
        assert f"<!-- generated: {name} -->" in text


def test_a_mark_without_a_table_is_refused() -> None:
    with pytest.raises(ValueError, match=r"observation.*names no table.*observations"):
        domain_pages.fill("<!-- generated: observation -->", "humanoid")


def test_a_registered_domain_gets_a_page_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tutorial.install(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module(tutorial.MODULE)
    try:
        page = domain_pages.skeleton(tutorial.DOMAIN)
    finally:
        suite.unregister(tutorial.DOMAIN)
        for name in [name for name in sys.modules if name.partition(".")[0] == "my_package"]:
            del sys.modules[name]
    assert page.startswith("# Swing\n\nSwing a pole up with a motor")
    assert "| 0 | `torque` | motor | -1 to 1 | 1 | N m | hinge |" in page
    assert "| `orientation` | (2,) | 0:2 |  | cosine and sine of the angle from upright |" in page
    assert "Kinds of starts: `above`, `below`." in page
    assert "| `tip_height()` | Height of the tip above the hinge, (...), metres. |" in page


def test_a_domain_of_plain_tasks_gets_a_page_without_terms_and_starts() -> None:
    suite.register("plain", plain_domain)
    try:
        page = domain_pages.skeleton("plain")
    finally:
        suite.unregister("plain")
    assert "| `slide` | slide | none | 0 | 0 |" in page
    assert "Kinds of starts" not in page
    assert "part of the goal" not in page
