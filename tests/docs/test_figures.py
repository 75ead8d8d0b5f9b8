"""Figures, messages, versions and pictures of the pages agree with their sources."""

import ast
import contextlib
import csv
import importlib.metadata
import json
import re
import statistics
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import limberjack
from limberjack import suite
from limberjack.training import settings_for
from limberjack.worlds.faults import CHALLENGES
from limberjack.worlds.faults.settings import PRESETS

_REPOSITORY = Path(__file__).parents[2]
_DOCS = _REPOSITORY / "docs"
_SOURCE = Path(limberjack.__file__).parent
_RESULTS = _REPOSITORY / "benchmarks" / "results"
_BATCHES = _DOCS / "batches.md"
_PAGES = [_REPOSITORY / "README.md", *sorted(_DOCS.glob("*.md"))]
_FEWEST_WORDS = 5  # in the place of a picture


def _text(page: Path) -> str:
    """The page with its line breaks as blanks."""
    return " ".join(page.read_text(encoding="utf-8").split())


def _rows(name: str, measure: str = "", subject: str = "") -> list[dict[str, Any]]:
    """The rows of a benchmark's committed run, or those of a measure whose subjects end so."""
    rows = json.loads((_RESULTS / f"{name}.json").read_text(encoding="utf-8"))["rows"]
    of_measure = [row for row in rows if measure in ("", row["measure"])]
    return [row for row in of_measure if row["subject"].endswith(subject)]


def _values(name: str, measure: str = "", subject: str = "") -> list[float]:
    return [row["value"] for row in _rows(name, measure, subject)]


def _assert_told(page: str, *words: str) -> None:
    """The page says all of it, wherever its lines break."""
    text = _text(_DOCS / page)
    assert [each for each in words if each not in text] == []


def _range(values: Sequence[float], digits: int = 2) -> str:
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


def _ratio(measure: str, num_envs: int) -> float:
    """A geometric mean over all tasks from the committed results."""
    (value,) = _values("steps_per_second", measure, f"geometric mean, N={num_envs}")
    return value


def test_the_speed_beside_envpool_is_the_one_that_was_measured() -> None:
    ratio = f"{_ratio('vector / EnvPool', 1024):.2f}"
    _assert_told("../README.md", f"runs {ratio} times as many steps per second as EnvPool")
    _assert_told("comparison.md", f"over EnvPool 1.2.5 | {ratio} times")


def _spread(measure: str, last: str) -> str:
    """The smallest and the largest ratio of a task, as they are written."""
    return _range(_values("steps_per_second", measure, f", {last}"))


def test_the_speeds_beside_envpool_are_those_that_were_measured() -> None:
    (cells,) = re.findall(r"\| EnvPool 1\.2\.5 ((?:\| [\d.]+ \([^)]*\) ){3})", _text(_BATCHES))
    expected = [
        (f"{_ratio('vector / EnvPool', n):.2f}", _spread("vector / EnvPool", f"N={n}"))
        for n in (64, 256, 1024)
    ]
    assert re.findall(r"\| ([\d.]+) \(([^)]*)\)", cells) == expected


def test_the_speeds_beside_a_bare_batch_are_those_that_were_measured() -> None:
    cells = re.findall(r"Batch\.step`, persistent ((?:\| [^|]+){3})\|", _text(_BATCHES))[0]
    written = re.findall(r"\(([^)]*)\)", cells)
    assert written == [_spread("vector / MuJoCo alone", f"N={n}") for n in (64, 256, 1024)]
    cells = re.findall(r"with nothing bound ((?:\| [\d.]+ ){3})", _text(_BATCHES))[0]
    expected = [f"{_ratio('vector / not persistent', n):.2f}" for n in (64, 256, 1024)]
    assert re.findall(r"[\d.]+", cells) == expected


def test_the_speeds_beside_processes_are_those_that_were_measured() -> None:
    (lowest, highest) = re.findall(r"is ([\d.]+) to ([\d.]+) times as fast", _text(_BATCHES))[0]
    measured = _spread("vector / AsyncVectorEnv", "2 processes").split(" to ")
    assert [lowest, highest] == [f"{float(value):.1f}" for value in measured]


@pytest.mark.parametrize(
    ("told", "measure"),
    [("`mujoco.batch.Batch`, persistent", "batch / bare Batch"), ("EnvPool", "vector / EnvPool")],
)
@pytest.mark.parametrize("kind", ["heavy", "toy"])
def test_the_speeds_over_the_whole_suite_are_those_that_were_measured(
    told: str, measure: str, kind: str
) -> None:
    expected = []
    for num_envs in (64, 256, 1024):
        rows = _rows("suite_speed", measure, f", N={num_envs}")
        values = [row["value"] for row in rows if row["details"].get("class") == kind]
        mean = f"{statistics.geometric_mean(values):.2f}" if values else "-"
        expected.append(f"{mean} ({_range(values)})" if values else mean)
    _assert_told("batches.md", f"| {told} | {kind} | {' | '.join(expected)} |")


@pytest.mark.parametrize(
    ("told", "measure"),
    [("a vectorised batch", "rows / vectorised"), ("`AsyncVectorEnv`", "rows / AsyncVectorEnv")],
)
def test_the_times_of_rows_are_those_that_were_measured(told: str, measure: str) -> None:
    cells = [f"{value:.2f}" for value in _values("rows", measure)]
    assert len(cells) == 4
    _assert_told("batches.md", f"| {told} | {' | '.join(cells)} |")


def test_the_figures_of_many_tasks_are_those_that_were_measured() -> None:
    making, megabytes, _, _, speed = _rows("many")
    _assert_told(
        "batches.md",
        f"take {speed['ours']:.1f} ms a step on two cores",
        f"takes {speed['theirs']:.1f} ms.",
        f"made in {making['value']:.1f} s of processor time and {megabytes['value']:.0f} MB",
    )


def test_the_gain_of_drawing_rows_together_is_that_which_was_measured() -> None:
    gains = _range(_values("rendering", "batch / loop"))
    _assert_told("seeing.md", f"are drawn {gains} times as fast as by a loop")


def test_the_costs_of_a_picture_are_those_that_were_measured() -> None:
    def measured(measure: str, digits: int = 2) -> list[str]:
        return [
            _range(_values("rendering", measure, f" {size}"), digits)
            for size in ("84x84", "480x640")
        ]

    bare, theirs = (measured(f"render / {name}") for name in ("mujoco.Renderer", "dm_control"))
    of_batch = _range(_values("rendering", "batch / mujoco.Renderer"))
    fast = measured("fast / full", 1)
    times = [1000 / row["ours"] for row in _rows("rendering", "render / mujoco.Renderer")]
    _assert_told(
        "seeing.md",
        f"| a bare `mujoco.Renderer` | {' | '.join(bare)} |",
        f"| dm_control | {' | '.join(theirs)} |",
        f"of the rows of a batch on two threads | {of_batch} | |",
        f'`"fast"` is {fast[0]} times as fast at 84 by 84, and {fast[1]} times at 480 by 640',
        f"takes {_range(times, 0)} ms, all but",
    )


def test_the_size_of_an_installation_is_that_which_was_measured() -> None:
    packages, megabytes = map(round, _values("installing"))
    assert packages == len(_required("limberjack")) - 1
    _assert_told("../README.md", f"# {packages} packages, {megabytes} MB")
    _assert_told("comparison.md", f"| {megabytes} MB, {packages} packages |")
    _assert_told("install.md", f"{packages} packages, of {megabytes} MB in all")


def _required(name: str) -> set[str]:
    """A package and those that it needs, by their names as an index has them."""
    waiting, found = [Requirement(name)], set[tuple[str, str]]()
    while waiting:
        wanted = waiting.pop()
        for extra in {"", *wanted.extras} - {one for other, one in found if other == wanted.name}:
            found.add((wanted.name, extra))
            needed = map(Requirement, importlib.metadata.requires(wanted.name) or ())
            waiting += [
                each
                for each in needed
                if each.marker is None or each.marker.evaluate({"extra": extra})
            ]
    return {canonicalize_name(name) for name, _ in found}


def test_the_times_of_the_viewer_are_those_that_were_measured() -> None:
    rows, title = _rows("viewer"), "cartpole swingup"
    frames = {row["subject"]: row["value"] for row in rows if row["measure"].startswith("a frame")}
    answers = [row["ours"] for row in rows if row["subject"] == title and row["bar"]]
    fast = [row for row in rows if row["bar"] and not row["subject"].endswith(", full")]
    drawn = max(row["value"] for row in fast if row["measure"] != "push")
    [push] = [row["value"] for row in fast if row["measure"] == "push"]
    _assert_told(
        "viewer.md",
        f"takes {frames[title]:.0f} ms instead of {frames['cartpole swingup, full']:.0f}",
        f"keys are answered within {max(answers):.0f} ms",
        f"drawn within {drawn:.0f} ms ({push:.0f} ms for a push)",
    )


def _messages() -> str:
    """All texts of the package, those that are made of parts joined as they are printed."""
    texts = []
    for path in sorted(_SOURCE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
            elif isinstance(node, ast.JoinedStr):
                parts = (p.value for p in node.values if isinstance(p, ast.Constant))
                texts.append("".join(map(str, parts)))
    return "\n".join(texts)


def test_every_message_on_the_page_of_troubleshooting_is_one_that_the_package_prints() -> None:
    text = (_DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    ours = text.partition("## Loading")[2].partition("## Warnings of other packages")[0]
    found = re.findall(r"^\| `([^`]+)` \|", ours, re.MULTILINE)
    assert len(found) > 15
    messages = _messages()
    assert [message for message in found if message not in messages] == []


@pytest.mark.parametrize("page", _PAGES, ids=lambda page: page.name)
def test_every_picture_has_words_in_its_place(page: Path) -> None:
    for words, path in re.findall(r"!\[([^\]]*)\]\(([^)]*)\)", page.read_text(encoding="utf-8")):
        assert len(words.split()) >= _FEWEST_WORDS, path


def test_the_first_picture_of_the_readme_is_within_its_first_lines() -> None:
    lines = (_REPOSITORY / "README.md").read_text(encoding="utf-8").splitlines()
    (first, *_) = [number for number, line in enumerate(lines) if line.startswith("![")]
    assert first < 10


def test_the_citation_names_this_version() -> None:
    for name in ("CITATION.cff", "docs/citing.md"):
        text = (_REPOSITORY / name).read_text(encoding="utf-8")
        assert re.findall(r"^ *version *[:=] \{?([\d.]+)\}?,?$", text, re.MULTILINE) == [
            limberjack.__version__
        ], name


def test_the_citation_in_both_files_is_of_the_same_work() -> None:
    cff, page = (_REPOSITORY / "CITATION.cff").read_text(), (_DOCS / "citing.md").read_text()
    found = re.findall(r"doi: (\S+)", cff)
    assert len(found) == 2
    assert found == re.findall(r"doi *= \{(\S+)\}", page)


def test_the_page_of_exactness_tells_the_results_of_the_long_comparison() -> None:
    results = json.loads((_RESULTS / "exactness.json").read_text("utf-8"))
    _assert_told(
        "exactness.md",
        f"took {results['core_minutes']:.0f} minutes of processor time: {results['steps']:,} steps "
        f"of {len(results['tasks'])} tasks in {results['comparisons']:,} comparisons, "
        f"with {results['differences']} differences.",
    )
    assert results["differences"] == 0
    assert set(results["tasks"]) == {":".join(task) for task in suite.ALL_TASKS}


def test_the_recipe_that_begins_the_training_page_takes_five_minutes() -> None:
    page = (_DOCS / "training.md").read_text(encoding="utf-8")
    domain, task = re.findall(r"^ +limberjack train (\w+) (\w+) --out \w+$", page, re.MULTILINE)[0]
    path = _RESULTS / "learned" / f"{domain}-{task}.json"
    runs = json.loads(path.read_text(encoding="utf-8"))["runs"]
    assert len(runs) >= 3
    assert max(run["curve"][-1][1] for run in runs) < 300


@pytest.mark.parametrize(
    "path", sorted((_RESULTS / "learned").glob("*.json")), ids=lambda p: p.stem
)
def test_every_learning_curve_is_of_the_command_that_the_training_page_names(path: Path) -> None:
    result = json.loads(path.read_text(encoding="utf-8"))
    settings = settings_for(result["domain"], result["task"])
    if result["settings"] is None:  # of another program
        page = (_DOCS / "training.md").read_text("utf-8")
        for run in result["runs"]:
            command, _, seed = run["command"].rpartition(" --seed ")
            assert seed == str(run["seed"])
            assert f"\n    {command} --seed 0 --out " in page
        return
    for run in result["runs"]:
        named = f"limberjack train {result['domain']} {result['task']} --seed {run['seed']}"
        assert run["command"] == named
        assert (run["steps"], run["action_repeat"]) == (settings.steps, settings.action_repeat)


def test_the_page_of_training_has_what_evolution_reached() -> None:
    result = json.loads((_RESULTS / "learned" / "lqr-lqr_6_2.json").read_text("utf-8"))
    runs = result["runs"]
    first, second, third = (f"{run['cost'] / result['optimal']:.3f}" for run in runs)
    seconds = sorted(run["curve"][-1][1] for run in runs)
    _assert_told(
        "training.md",
        f"of lqr_6_2 cost {first}, {second} and {third} times as much as the optimal",
        f"after {round(runs[0]['steps'] / 1e6)} million control steps",
        f"steps: {seconds[0]:.0f} to {seconds[-1]:.0f} seconds of one",
    )


def test_the_curve_from_pictures_is_the_one_that_was_measured() -> None:
    section = (_DOCS / "training.md").read_text("utf-8").partition("## From pictures")[2]
    section = section.partition("\n## ")[0]
    file = _RESULTS / "drq" / "cartpole-balance-0.csv"
    with file.open(encoding="utf-8", newline="") as lines:
        measured = [
            f"| {int(line['control_steps']):,} | {float(line['processor_seconds']) / 60:.1f} "
            f"| {float(line['mean']):.0f} |"
            for line in csv.DictReader(lines)
        ]
    shown = re.findall(r"^\| [\d,]+ \| [\d.]+ \| \d+ \|$", section, re.MULTILINE)
    assert len(shown) >= 5
    assert set(shown) <= set(measured)
    assert (shown[0], shown[-1]) == (measured[0], measured[-1])


def _call(code: str, name: str) -> ast.Call:
    """The call of a function, or of a method of any object, in a program."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == name:
            return node
    raise AssertionError(f"{name} is not called")


def _assigned(code: str) -> dict[str, Any]:
    """The values of the names that a program assigns constants to, or containers of them."""
    found: dict[str, Any] = {}
    for node in ast.parse(code).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            if isinstance(target, ast.Name) and isinstance(node, ast.Assign | ast.AnnAssign):
                with contextlib.suppress(ValueError):
                    found[target.id] = ast.literal_eval(node.value or ast.Constant(None))
    return found


def test_the_snippet_of_stable_baselines3_has_the_settings_of_its_example() -> None:
    section = (_DOCS / "training.md").read_text("utf-8").partition("## Stable-Baselines3")[2]
    lines = re.findall(r"(?:^ {4}.*\n|^\n)+", section, re.MULTILINE)[0]
    snippet = textwrap.dedent(lines)
    example = (_REPOSITORY / "examples" / "sb3_crossq.py").read_text(encoding="utf-8")
    values = _assigned(example)
    repeat = values["ACTION_REPEAT"]
    options = {
        ast.literal_eval(node.args[0]): {k.arg: k.value for k in node.keywords}["default"]
        for node in ast.walk(ast.parse(example))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "parser.add_argument"
        if any(k.arg == "default" for k in node.keywords)
    }
    rows, steps = (ast.literal_eval(options[name]) for name in ("--envs", "--steps"))
    updates = max(1, round(values["_UPDATES"] * rows))
    given = {k.arg: ast.literal_eval(k.value) for k in _call(snippet, "CrossQ").keywords}
    assert given == {**values["SETTINGS"], "gradient_steps": updates}
    made = _call(snippet, "make_vec_env")
    assert [ast.literal_eval(value) for value in made.args] == ["reacher", "easy", rows]
    assert {k.arg: ast.literal_eval(k.value) for k in made.keywords} == {
        "action_repeat": repeat,
        "stagger": True,
    }
    assert ast.literal_eval(_call(snippet, "learn").args[0]) == steps // repeat
    assert f"--steps {steps} --envs {rows} " in example


def test_the_speed_of_workers_is_the_one_that_was_measured() -> None:
    pattern = r"took ([\d.]+) of the time .* and ([\d.]+) of .* Ray took ([\d.]+) of"
    found = re.findall(pattern, _text(_DOCS / "scaling.md"))
    assert found == [tuple(f"{ratio:.2f}" for ratio in _values("scaling"))]


def test_the_speed_of_collecting_is_the_one_that_was_measured() -> None:
    walk, read_walk, ball, read_ball = _values("collecting")
    _assert_told(
        "datasets.md",
        f"made {walk:.2f} of the steps per second of evaluating on humanoid walk and {ball:.2f} on",
        f"reading was {read_walk:.0f} and {read_ball:.0f} times as fast as evaluating",
    )


def test_the_costs_of_writing_are_those_that_were_measured() -> None:
    unit, counting, resuming, footer = _values("writing")
    _assert_told(
        "datasets.md",
        f"a unit sent up to {unit:.2f} kB",
        f"it took {counting:.1f} s to count them",
        f"and {resuming:.1f} s to find them",
        f"the footer is {footer:.1f} %",
    )


def test_the_returns_learned_from_datasets_are_those_that_were_measured() -> None:
    page = (_DOCS / "datasets.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| `(\w+)\.py` \| `(\w+)\.py` \| (\d+) \| ([\d, ]+) \|$", page, re.MULTILINE
    )
    content = json.loads((_RESULTS / "from_datasets.json").read_text(encoding="utf-8"))
    assert rows == [
        (
            row["example"],
            row["dataset"],
            f"{row['return_of_dataset']:.0f}",
            ", ".join(f"{mean:.0f}" for mean in row["returns"]),
        )
        for row in content["rows"]
    ]
    scores = {(row["example"], row["dataset"]): row for row in content["rows"]}
    learned, cloned = (scores[name, "offline_iql"] for name in ("offline_iql", "behaviour_cloning"))
    assert min(learned["returns"]) > learned["return_of_dataset"] > max(cloned["returns"])


def test_the_time_of_path_searches_is_the_one_that_was_measured() -> None:
    median, most, worst = _values("path_searches")
    told = f"up to {median:.1f} ms, 99 % up to {most:.0f} ms, and the longest {worst:.0f} ms"
    _assert_told("planner.md", told)


def test_the_comparison_counts_the_tasks_that_the_planner_plays() -> None:
    played = [
        task for task in suite.ALL_TASKS if suite.load(*task, {"random": 0}).task.planner_cost
    ]
    scored = list((_RESULTS / "scores").glob("*-planner.json"))
    counts = re.findall(
        r"\[(\d+)\]\(planner.md#the-costs\), of (\d+) domains; \[scores\]\(scores.md\) of (\d+) ",
        _text(_DOCS / "comparison.md"),
    )
    domains = {domain for domain, _ in played}
    assert counts == [(str(len(played)), str(len(domains)), str(len(scored)))]


def test_playgrounds_tasks_are_all_but_those_that_its_page_says_it_lacks() -> None:
    page = _text(_DOCS / "from_playground.md")
    whole, _, others = page.partition(" It lacks ")[2].partition(", and of the domains above ")
    lacking = {
        (domain, task)
        for domain, task in suite.ALL_TASKS
        if re.search(rf"\b{domain}\b", whole)
        or (re.search(rf"\b{domain}", others) and re.search(rf"\b{task}\b", others))
    }
    assert ("quadruped", "walk") in lacking
    assert ("humanoid", "walk") not in lacking
    told = str(len(suite.ALL_TASKS) - len(lacking))
    assert re.findall(r"has (\d+) tasks that resemble", page) == [told]
    assert re.findall(r"Playground: \[(\d+)\]", _text(_DOCS / "comparison.md")) == [told]


def test_the_times_of_the_planner_are_those_that_were_measured() -> None:
    def times(*domains: str) -> str:
        rows = _rows("planner", subject=", 4 threads")
        return _range([row["ours"] for row in rows if row["subject"].startswith(domains)], 0)

    arm, body = times("manipulator", "stacker"), times("humanoid")
    share = _range(_values("planner", "not MuJoCo's, of a plan"), 0)
    _assert_told(
        "planner.md",
        f"a plan takes {arm} ms for the arm and {body} for humanoids",
        f"{share} % of the time of a plan",
    )


def test_the_towers_that_stood_are_those_of_the_scores() -> None:
    path = _RESULTS / "scores" / "stacker-stack_4-planner.json"
    strata = json.loads(path.read_text(encoding="utf-8"))["summary"]["planner"]["strata"]
    highest = strata["level_3"]
    told = f"of {highest['episodes']}, {highest['successes']} stood at its end"
    _assert_told("planner.md", told)


def test_the_table_of_what_can_be_reached_is_the_one_that_was_measured() -> None:
    results = json.loads((_RESULTS / "reach.json").read_text(encoding="utf-8"))
    rows = [
        f"| {row['domain']} {row['task']} | "
        + " | ".join(f"{100 * row[part]:.1f} %" for part in ("taken", "raked", "brought"))
        + f" | {row['cap']:.0f} |"
        for row in results
    ]
    page = (_DOCS / "planner.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| (?:manipulator|stacker) \w+ \| .*%.*\|$", page, re.MULTILINE) == rows
    (brought,) = [row["brought"] for row in results if row["task"] == "bring_ball"]
    assert f"{1000 * (1 - brought):.0f} of 1,000 starts of bring_ball cannot give" in page


def test_the_challenges_on_the_page_of_faults_are_the_presets() -> None:
    text = (_DOCS / "faults.md").read_text(encoding="utf-8")
    rows = {
        row[0]: row[1:] for row in re.findall(r"^\| (.+) \| (.+) \| (.+) \| (.+) \|$", text, re.M)
    }
    presets = [PRESETS[name] for name in CHALLENGES]
    found = [
        [
            rows[f"delay of {what}, steps"],
            rows["noise of actions and observations"],
            rows["dropped and stuck observations: probability"],
            rows["dropped and stuck observations: steps"],
            rows["repetition of every action, steps"],
            rows["dummies"],
        ]
        for what in ("actions and observations", "rewards")
    ]
    for number, one in enumerate(presets):
        loss = one.dropped.observations
        common = [one.noise.actions, loss.probability, loss.steps]
        common += [one.repetition.steps, one.dummies]
        for delay, texts in zip((one.delay.actions, one.delay.rewards), found, strict=True):
            assert [float(text[number]) for text in texts] == [delay, *common]
    for domain, task in (("cartpole", "swingup"), ("walker", "walk"), ("quadruped", "walk")):
        _check_ranges(rows, domain, task)
    _check_ranges(rows, "humanoid", "walk")
    _check_ranges(rows, "manipulator", "bring_ball")


def _check_ranges(rows: dict[str, tuple[str, ...]], domain: str, task: str) -> None:
    (texts,) = [texts for title, texts in rows.items() if title.startswith(domain)]
    parameters = suite.load(domain, task).task.PERTURBATIONS.values()
    (presets,) = [one.presets for one in parameters if one.presets]
    assert texts == tuple(f"{one.lowest} to {one.highest}" for one in presets.values())
