"""Generates docs/scores.md from results of `limberjack evaluate` in benchmarks/results/scores/.

    limberjack evaluate humanoid walk --policy planner --seeds 0:100 --out DIR
    python benchmarks/scores.py DIR

copies DIR's result, draws the starts that the planner did not solve, and writes the page. Without a
folder it only writes the page. The planner's source changes more often than what it does, so

    python benchmarks/scores.py --play-again [DOMAIN-TASK ...]

plays the first seed of each of its results that another source has made. Where the return is the
same, bit for bit, the page has that source's hash beside the result's own; otherwise the task has
to be scored again, and the exit status is 1.
"""

import argparse
import json
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import baselines
import numpy as np
from pages import table

from limberjack import suite
from limberjack.evaluation import evaluate, published
from limberjack.mujoco import TextOverlay
from limberjack.planner.cost import sources_for
from limberjack.see.video import mosaic
from limberjack.utils import png
from limberjack.utils.sources import hash_of_files

__all__ = ["main", "page", "read_results"]

_RESULTS = Path(__file__).parent / "results" / "scores"
_NOTES = _RESULTS.parent / "played_again.json"
_PAGE = Path(__file__).parents[1] / "docs" / "scores.md"
_IMAGES = _PAGE.parent / "images"
_DRAWN = "manipulator", "stacker"  # all starts of the humanoid look alike

_START_SIZE = 150, 200  # pixels of an unsolved start
_STARTS_BESIDE = 5

_MILLION = 1_000_000
_STEPS = tuple(_MILLION * count for count in (1, 4, 8, 14, 100))  # of training; a column each
_SECOND_HAND = " (2)"  # marks it
_NOTHING = "-"

_HEAD = """# Scores

Returns of the planner on the tasks of this table, of doing nothing, and of random actions. The
planner plays [all 51 tasks](planner.md#the-costs); those that are missing here were not scored yet.
`benchmarks/scores.py` writes this page from the results in `benchmarks/results/scores`. Each of
them was made by

    limberjack evaluate DOMAIN TASK --policy NAME --seeds A:B --out DIR

and contains every episode, so that all figures can be computed again, as
[Evaluation](evaluation.md) describes. A return is a sum of 1,000 rewards between 0 and 1, at an
action repeat of 1; of lqr, whose episodes have no end of their own, with `--time-limit 30`, and
rewards of at most 1. *interval*: 95 % confidence, of the mean. *success*: the share of episodes
whose last 100 steps have a mean reward of at least 0.9. *zero here*: the mean return of doing
nothing on the same seeds.
"""

_BY_START = """
## By start

Mean return, with the share of successes in brackets. [Manipulator](manipulator.md#start),
[Stacker](stacker.md#start) and [Evaluation](evaluation.md#kinds-of-starts), for humanoid,
humanoid_CMU and swimmer, describe the kinds of starts.
"""

_UNSOLVED = """
## What the planner did not solve

The starts of the arm's episodes that were not a success, each with its seed. Some of them cannot be
solved: [what can be reached](planner.md#what-can-be-reached).
"""

_BASELINES = """
## The benchmark without a policy

Mean returns of zero and of random actions on the 28 tasks tagged benchmarking, with the 95 %
interval of the mean, over the first episodes of seeds {seeds} (`benchmarks/baselines.py`). A policy
has learned something where it does better than both.
"""

_PUBLISHED_TEXT = """
## Published scores

Returns of learned agents from the suite's observations: the best mean that we found, up to November
2026, after each number of control steps of training, with its spread. An action that is repeated
counts as several control steps. **Compare within a column only**: scores after 1 million and after
4 million steps are different results. *dataset*: learned from recorded episodes. *zero*, *planner*:
the means of this project, where it has measured them. (2): second-hand, as explained below.

These scores come from few runs and episodes, other seeds and older versions of MuJoCo, so
differences of a few percent mean nothing (see
[Exactness](exactness.md#mujoco-versions-are-different-benchmarks)). The best of several algorithms
is also an optimistic figure. We found no score for {without}.
"""

_SOURCES_TEXT = """
These are the best of {scores} scores in `src/limberjack/evaluation/published.json`, which also has
the number of runs of each; `limberjack.evaluation.published` reads them. No file of a source is
copied: `tools/read_published.py` computes means and spreads from the commits that are linked here.
*repeat*: control steps per action; - if the source does not state it. *runs*: from the smallest to
the largest number.
"""

_SECOND_HAND_TEXT = """
Scores marked (2) are second-hand:
"""

_MEASURED = """
## Versions and models

*its hash*: of the policy's source. *played again*: of a later source of the planner that has played
the episode of the first seed again, with the same return to the last bit.
"""

_Result = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> None:
    """Imports results and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("folders", nargs="*", type=Path, help="of `limberjack evaluate --out`")
    parser.add_argument("--play-again", nargs="*", metavar="DOMAIN-TASK", help="all by default")
    parsed = parser.parse_args(arguments)
    if parsed.play_again is not None:
        same = _play_again(parsed.play_again)
        _PAGE.write_text(page(read_results()), encoding="utf-8")
        raise SystemExit(not same)
    for folder in parsed.folders:
        result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        _check(folder, result)
        policy = re.sub(r"\W+", "-", result["policy"])
        name = f"{result['domain']}-{result['task']}-{policy}.json"
        _RESULTS.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / "result.json", _RESULTS / name)
        if not _is_shown(result):
            continue
        drawn, picture = _IMAGES / _picture_of(result), _draw_unsolved(result)
        if picture is None:
            drawn.unlink(missing_ok=True)  # of an earlier result
        else:
            drawn.write_bytes(png.encode(picture))
    _PAGE.write_text(page(read_results()), encoding="utf-8")


def _check(folder: Path, result: _Result) -> None:
    """Ends the program for a result whose numbers the page would show as if they were others."""
    expected = {"world": None, "action_repeat": 1}
    for name, value in expected.items():
        if result.get(name) != value:
            raise SystemExit(f"{folder} has {name} {result.get(name)!r}; the page is of {value!r}")
    if (result.get("domain"), result.get("task")) not in suite.ALL_TASKS:
        raise SystemExit(f"{folder} is of no task of the suite, and the page has no other")
    if result["episodes_asked_for"] < 2:
        raise SystemExit(f"{folder} has one episode, and the page needs an interval")


def _play_again(names: Sequence[str]) -> bool:
    """Whether the present source plays the first episodes of the planner's results as they were."""
    notes, same = _notes(), True
    results = {_name(one): one for one in read_results() if one["policy"] == "planner"}
    unknown = sorted({*names} - {*results})
    if unknown:
        raise SystemExit(f"no result of the planner is named {unknown[0]}: {', '.join(results)}")
    for name in names or results:
        result = results[name]
        present = hash_of_files(sources_for(suite.load(result["domain"], result["task"]).task))
        if present in (result["policy_sha256"], _now(result, notes)):
            continue
        first, again = result["episodes"][0], _first_again(result)
        if again == first:
            notes[name] = {"result": result["policy_sha256"], "now": present, "seed": first["seed"]}
            _NOTES.write_text(json.dumps(notes, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        else:
            same = False
        words = "the same" if again == first else f"was {first}, is {again}: score it again"
        print(f"{name}: {words}", flush=True)
    return same


def _first_again(result: _Result) -> _Result:
    """The first episode of a planner's result, as the present source plays it."""
    domain, task, seed = result["domain"], result["task"], result["episodes"][0]["seed"]
    again = evaluate(domain, task, "planner", [seed], time_limit=result["time_limit"]).as_json()
    if again["fingerprint"] != result["fingerprint"]:
        raise SystemExit(f"{_name(result)} has another model: score it again")
    return dict(again["episodes"][0])


def _notes() -> dict[str, dict[str, Any]]:
    """Notes of what was played again, by result."""
    return json.loads(_NOTES.read_text(encoding="utf-8")) if _NOTES.exists() else {}


def _now(result: _Result, notes: dict[str, dict[str, Any]]) -> str | None:
    """The hash of the source that has played a result's first episode again, if any."""
    note = notes.get(_name(result), {})
    return note["now"] if note.get("result", "") == result["policy_sha256"] else None


def _name(result: _Result) -> str:
    return f"{result['domain']}-{result['task']}"


def read_results() -> list[_Result]:
    """The committed results, by task and by number of episodes in descending order."""
    results = [json.loads(path.read_text(encoding="utf-8")) for path in _RESULTS.glob("*.json")]
    tasks = list(suite.ALL_TASKS)
    return sorted(
        results,
        key=lambda r: (tasks.index((r["domain"], r["task"])), -r["episodes_asked_for"]),
    )


def page(results: Sequence[_Result]) -> str:
    """The text of docs/scores.md."""
    columns = ["domain", "task", "policy", "seeds", "mean", "interval", "median", "success"]
    lines = [*table([*columns, "zero here"], _score_rows(results)), _BY_START]
    for domain in suite.TASKS_BY_DOMAIN:
        lines += _start_table([result for result in results if result["domain"] == domain])
    lines.pop()
    pictures = list(_unsolved_lines(results))
    lines += [_UNSOLVED, *pictures[:-1]] if pictures else []
    lines += _baseline_lines()
    lines += _published_lines(results)
    columns = ["domain", "task", "policy", "its hash", "played again", "model", "versions"]
    notes = _notes()
    lines += [_MEASURED, *table(columns, (_origin(result, notes) for result in results))]
    return "\n".join([_HEAD, *lines]) + "\n"


def _rows_of(results: Sequence[_Result]) -> Iterator[tuple[_Result, str, _Result]]:
    """Each policy's result, name and summary; baselines from the result with the most episodes."""
    listed: set[tuple[str, str, str]] = set()
    for result in results:
        for policy, summary in result["summary"].items():
            row = (result["domain"], result["task"], policy)
            if row not in listed:
                listed.add(row)
                yield result, policy, summary


def _score_rows(results: Sequence[_Result]) -> Iterator[list[str]]:
    for result, policy, summary in _rows_of(results):
        low, high = summary["interval"]
        yield [
            f"[{result['domain']}]({result['domain']}.md)",
            result["task"],
            policy,
            result["seeds"],
            f"**{summary['mean']:.1f}**",
            f"{low:.1f} to {high:.1f}",
            f"{summary['median']:.1f}",
            f"{100 * summary['success_rate']:.1f} %",
            f"{result['summary']['zero']['mean']:.1f}",
        ]


def _start_table(results: Sequence[_Result]) -> list[str]:
    """Rows are the kinds of starts of each task, columns the policies; nothing without kinds."""
    cells: dict[tuple[str, str], dict[str, str]] = {}
    policies: list[str] = []
    for result, policy, summary in _rows_of(results):
        if policy not in policies:
            policies.append(policy)
        for start, part in summary["strata"].items():
            text = f"{part['mean']:.1f} ({100 * part['success_rate']:.1f} %) of {part['episodes']}"
            task = f"{result['domain']} {result['task']}"
            cells.setdefault((task, start), {})[policy] = text
    rows = [
        [task, start, *(row.get(policy, "-") for policy in policies)]
        for (task, start), row in cells.items()
    ]
    return [*table(["task", "start", *policies], rows), ""] if rows else []


def _baseline_lines() -> list[str]:
    """The table of dm_control's benchmark, from the committed results."""
    found = json.loads(baselines.FILE.read_text(encoding="utf-8"))
    rows = [
        [
            f"[{row['domain']}]({row['domain']}.md)",
            row["task"],
            *(_with_interval(row[policy]) for policy in ("zero", "random")),
        ]
        for row in found["rows"]
    ]
    head = _BASELINES.format(seeds=found["seeds"])
    return [head, *table(["domain", "task", "zero", "random"], rows)]


def _published_lines(results: Sequence[_Result]) -> list[str]:
    """The best published score of each task by steps of training, and the sources of all."""
    measured = _measured(results)
    rows = [
        [
            f"[{domain}]({domain}.md)",
            task,
            *(_mean(measured.get((domain, task, policy))) for policy in ("zero", "planner")),
            *(_published(published.best(domain, task, steps)) for steps in (*_STEPS, None)),
        ]
        for domain, task in suite.ALL_TASKS
    ]
    columns = ["domain", "task", "zero", "planner", *map(_in_millions, _STEPS), "dataset"]
    sources = list(published.sources().values())
    head = ["algorithm", "steps", "repeat", "runs", "mean", "spread", "source", "licence"]
    notes = [
        f"- {source.algorithm}: {source.second_hand}." for source in sources if source.second_hand
    ]
    without = ", ".join(f"{domain} {task}" for domain, task in published.none_found())
    return [
        _PUBLISHED_TEXT.format(without=without),
        *table(columns, rows),
        _SOURCES_TEXT.format(scores=len(published.scores())),
        *table(head, map(_source_row, sources)),
        _SECOND_HAND_TEXT,
        *notes,
    ]


def _measured(results: Sequence[_Result]) -> dict[tuple[str, str, str], float]:
    """Means of this project by domain, task and policy; the results' before the baselines'."""
    found = json.loads(baselines.FILE.read_text(encoding="utf-8"))
    means = {(row["domain"], row["task"], "zero"): row["zero"]["mean"] for row in found["rows"]}
    for result, policy, summary in _rows_of(results):
        means[result["domain"], result["task"], policy] = summary["mean"]
    return means


def _mean(number: float | None) -> str:
    return _NOTHING if number is None else f"{number:.0f}" if number >= 10 else f"{number:.1f}"


def _published(score: published.PublishedScore | None) -> str:
    """A cell: mean, spread and algorithm."""
    if score is None:
        return _NOTHING
    spread = "" if score.spread is None else f" ± {_mean(score.spread)}"
    mark = _SECOND_HAND if score.source.second_hand else ""
    return f"{_mean(score.mean)}{spread} {score.algorithm}{mark}"


def _in_millions(steps: int) -> str:
    return f"{steps / _MILLION:g} million"


def _source_row(source: published.Source) -> list[str]:
    """Facts about a source, and the numbers of steps and runs of its scores."""
    found = [score for score in published.scores() if score.source == source]
    steps = sorted({steps for steps in _STEPS for score in found if score.is_after(steps)})
    runs = sorted({score.seeds for score in found if score.seeds is not None})
    kind = "tree" if source.file.endswith("/") else "blob"
    path = "" if source.revision is None else f"/{kind}/{source.revision}/{source.file}"
    mark = _SECOND_HAND if source.second_hand else ""
    return [
        f"{source.algorithm}{mark}",
        ", ".join(map(_in_millions, steps)) or "dataset",
        str(source.action_repeat or _NOTHING),
        " to ".join(map(str, dict.fromkeys((runs[0], runs[-1])))) if runs else _NOTHING,
        source.mean,
        source.spread,
        f"[{source.file}]({source.address}{path})",
        source.licence,
    ]


def _with_interval(summary: _Result) -> str:
    low, high = summary["interval"]
    return f"{summary['mean']:.1f} ({low:.1f} to {high:.1f})"


def _unsolved_lines(results: Sequence[_Result]) -> Iterator[str]:
    for result in results:
        seeds = _unsolved_seeds(result) if _is_shown(result) else []
        if seeds:
            yield f"{result['task']}, {len(seeds)} of {result['episodes_asked_for']}:"
            yield ""
            words = f"Starts of {result['task']} that the planner did not solve, with their seeds"
            yield f"![{words}](images/{_picture_of(result)})"
            yield ""


def _unsolved_seeds(result: _Result) -> list[int]:
    return [episode["seed"] for episode in result["episodes"] if not episode["success"]]


def _draw_unsolved(result: _Result) -> np.ndarray | None:
    """Unsolved starts side by side, each with its seed, (height, width, 3) uint8; None without."""
    pictures = []
    for seed in _unsolved_seeds(result):
        with suite.load(result["domain"], result["task"], {"random": seed}) as environment:
            environment.reset()
            label = TextOverlay(str(seed), position="bottom left")
            pictures.append(environment.physics.render(*_START_SIZE, "fixed", [label]))
    return mosaic(pictures, columns=min(_STARTS_BESIDE, len(pictures))) if pictures else None


def _is_shown(result: _Result) -> bool:
    return result["policy"] == "planner" and result["domain"] in _DRAWN


def _picture_of(result: _Result) -> str:
    return f"unsolved-{result['task']}.png"


def _origin(result: _Result, notes: dict[str, dict[str, Any]]) -> list[str]:
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    policy_hash = (result["policy_sha256"] or "none")[:12]
    now = (_now(result, notes) or _NOTHING)[:12]
    of_whom = [result["domain"], result["task"], result["policy"]]
    return [*of_whom, policy_hash, now, result["fingerprint"][:12], versions]


if __name__ == "__main__":
    main()
