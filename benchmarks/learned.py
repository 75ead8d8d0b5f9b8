"""Scores the policies that `limberjack train` has learned, bundles the median ones, writes a table.

    limberjack train walker walk --seed 0 --out trained/walker-walk-0      # and seeds 1 and 2
    python examples/evolution.py --seed 0 --out trained/lqr-lqr_6_2-0
    python benchmarks/learned.py trained

plays each finished policy of `trained/DOMAIN-TASK-SEED` on 100 seeds that no training has seen,
keeps all returns and learning curves in results/learned, and puts the policy of the median run into
the package, of an even number the lower one in the middle. Runs that were scored earlier with the
same settings count too, so that tasks that take hours can begin with one. Then, and without a
folder, it writes what is made of these results: the table of docs/policies.md, the figures of the
recipe that begins docs/training.md, the package's file of learning curves, and
docs/images/learning_curves.svg, which shows them. tools/learned_pictures.py films the policies.
"""

import csv
import dataclasses
import hashlib
import json
import statistics
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import pages
import sources
import typer

from limberjack import suite
from limberjack.episodes.environments import seconds_without_a_limit
from limberjack.evaluation import Evaluation, evaluate, published
from limberjack.policies import learning, mlp
from limberjack.see.report import write_learning_plot
from limberjack.suite import lqr_solver
from limberjack.training import Settings, settings_for
from limberjack.utils.files import write_whole

__all__ = [
    "PICTURE",
    "RECIPE",
    "RESULTS",
    "SEEDS",
    "bundle",
    "is_outdated",
    "known_curves",
    "main",
    "recipe",
    "results",
    "section",
    "write_curves",
    "write_pages",
]

RESULTS = Path(__file__).parent / "results" / "learned"
SEEDS = range(40_000, 40_100)  # on which nothing was trained, evaluated or tuned

_ROOT = Path(__file__).parents[1]
PICTURE = _ROOT / "docs" / "images" / "learning_curves.svg"
RECIPE = "cartpole-swingup"  # the task that the page of training begins with
_DOCS = _ROOT / "docs"
_BUNDLED = _ROOT / "src" / "limberjack" / "policies" / "pretrained"
_POLICY = "policy.safetensors"
_LICENCE = "Apache-2.0"
_WIDTH = 100  # of a line of text
_COLUMNS = (
    *("task", "steps", "repeat", "mean", "interval", "median", "minimum"),
    *("success", "runs", "zero here", "published"),
)
_MILLION = 1_000_000

_TEXT = """
Each task was trained with {runs} seeds by `limberjack train`{others}.
The policy of the median run is bundled, never the best one of several. Returns are those of 100
seeds that no training has seen ({first}:{end}), from observations, at the action repeat of the
card. *interval*:
95 % confidence, of the mean over these seeds. *success*: the share of episodes whose last 100 steps
have a mean reward of at least 0.9. *runs*: the means of all runs. *published*: the best published
mean after 1 million steps, as in [Scores](scores.md#published-scores); of lqr, whose optimal policy
is known, the cost as a multiple of that of the optimal policy on the same starts. It is optimal for
episodes without an end: within 1,000 steps another one may cost less.
`benchmarks/results/learned` has every return and the learning curves.
"""

# Any: what was read from JSON.
_Result = dict[str, Any]


def bundle(trained: Path, folder: Path = _BUNDLED, out: Path = RESULTS) -> list[str]:
    """Scores the runs of a folder and bundles the median ones; returns the names of the tasks.

    Args:
      trained: has folders DOMAIN-TASK-SEED of `limberjack train` or of another program.
      folder: of the bundled policies.
      out: of the results.

    Raises:
      ValueError: runs of a task differ in more than their seeds.
    """
    tasks: dict[str, list[Path]] = {}
    for path in sorted(trained.glob(f"*/{_POLICY}")):
        tasks.setdefault(path.parent.name.rpartition("-")[0], []).append(path.parent)
    for name, folders in tasks.items():
        _check_alike(name, folders)
        bundled, result = folder / f"{name}.safetensors", out / f"{name}.json"
        known, policies = _known_runs(result, folders[0], bundled)
        evaluation = None
        for one in folders:
            run, evaluation = _scored(one)
            known[run["seed"]], policies[run["seed"]] = run, one / _POLICY
        assert evaluation is not None
        runs = [known[seed] for seed in sorted(known)]
        middle = statistics.median_low(run["mean"] for run in runs)
        run = next(one for one in runs if one["mean"] == middle)
        if run["seed"] not in policies:
            raise ValueError(
                f"the median run of {name} is that of seed {run['seed']}, whose policy is neither "
                f"in {trained} nor bundled: train it again"
            )
        _copy(policies[run["seed"]], bundled, run)
        content = {
            "domain": evaluation.facts["domain"],
            "task": evaluation.facts["task"],
            "seeds": f"{SEEDS.start}:{SEEDS.stop}",
            "versions": evaluation.facts["versions"],
            "zero": evaluation.summary("zero").mean,
            "random": evaluation.summary("random").mean,
            "bundled": run["seed"],
            "settings": _settings(folders[0]),
            "runs": runs,
        }
        if content["domain"] == "lqr":
            content["optimal"] = _optimal_cost(content["task"])
        sources.write(result, content)
    return list(tasks)


def _known_runs(
    result: Path, folder: Path, bundled: Path
) -> tuple[dict[int, _Result], dict[int, Path]]:
    """The runs of an earlier result with a folder's settings, and the bundled policy, by seed."""
    if not result.exists():
        return {}, {}
    earlier = json.loads(result.read_text("utf-8"))
    if _used(earlier["settings"]) != _used(_settings(folder)):
        return {}, {}
    return {run["seed"]: run for run in earlier["runs"]}, {earlier["bundled"]: bundled}


def _check_alike(name: str, runs: Iterable[Path]) -> None:
    """Raises ValueError unless runs are of the task of their folders, and differ by their seeds."""
    first, *others = runs
    seeds = set()
    for run in (first, *others):
        card = mlp.load(run / _POLICY).card
        if f"{card.domain}-{card.task}" != name or card.world is not None:
            world = f" with {card.world}" if card.world else ""
            raise ValueError(f"{run} is of {card.title}{world}: name its folder so, or move it")
        if _used(_settings(run)) != _used(_settings(first)):
            raise ValueError(f"{run} has other settings than {first}: train one of them again")
        if card.seeds in seeds:
            raise ValueError(f"{run} has the seed of another run, {card.seeds[0]}: move it")
        seeds.add(card.seeds)


def results(folder: Path = RESULTS) -> list[_Result]:
    """The results of all tasks, in the order of their names."""
    return [json.loads(path.read_text("utf-8")) for path in sorted(folder.glob("*.json"))]


def section(found: Iterable[_Result]) -> str:
    """The text of the page about the bundled policies."""
    found = list(found)
    counts = sorted({len(result["runs"]) for result in found})
    others = [
        f"{one['domain']} {one['task']} by `{_program(one)}`"
        for one in found
        if one["settings"] is None
    ]
    lines = pages.table(_COLUMNS, map(_row, found))
    text = _TEXT.format(
        runs=" or ".join(map(str, counts)),
        others=f", {', '.join(others)}" if others else "",
        first=SEEDS[0],
        end=SEEDS.stop,
    )
    outdated = [f"{one['domain']} {one['task']}" for one in found if is_outdated(one)]
    if outdated:
        told = f"The settings of these tasks have changed since their runs: {', '.join(outdated)}."
        text += f"\n{textwrap.fill(told, _WIDTH)}\n"
    return f"{text}\n" + "\n".join(lines) + "\n\n" if counts else ""


def _row(result: _Result) -> list[str]:
    (run,) = (one for one in result["runs"] if one["seed"] == result["bundled"])
    low, high = run["interval"]
    return [
        f"{result['domain']} {result['task']}",
        f"{run['steps'] // 1000}k",
        str(run["action_repeat"]),
        f"{run['mean']:.1f}",
        f"{low:.1f} to {high:.1f}",
        f"{statistics.median(run['returns']):.1f}",
        f"{min(run['returns']):.1f}",
        f"{run['success_rate']:.0%}".replace("%", " %"),
        ", ".join(f"{one['mean']:.0f}" for one in result["runs"]),
        f"{result['zero']:.1f}",
        _known(result, run),
    ]


def _program(result: _Result) -> str:
    """The program that trained a task in the place of `limberjack train`."""
    return next(word for word in result["runs"][0]["command"].split() if word.endswith(".py"))


def _known(result: _Result, run: _Result) -> str:
    """The best that a policy can do, where that is known, or else the best that others did."""
    if "optimal" in result:
        return f"{run['cost'] / result['optimal']:.3f} of the optimal policy's cost"
    best = published.best(result["domain"], result["task"], _MILLION)
    return "none" if best is None else f"{best.mean:.0f} {best.algorithm}"


def _optimal_cost(task: str) -> float:
    """The mean cost of an episode with lqr's optimal policy; a step's reward is 1 minus its cost.

    Each seed has springs of its own, which the policy is computed from.
    """
    costs = []
    for seed in SEEDS:
        kwargs = {"random": seed, "time_limit": _time_limit("lqr", task)}
        with suite.load("lqr", task, task_kwargs=kwargs) as environment:
            _, gain, _ = lqr_solver.solve(environment)
            time_step, cost = environment.reset(), 0.0
            while not time_step.last():
                time_step = environment.step(gain @ environment.physics.state())
                cost += 1 - time_step.reward
            costs.append(cost)
    return statistics.fmean(costs)


def _scored(folder: Path) -> tuple[_Result, Evaluation]:
    """The facts of a run, and its evaluation."""
    path = folder / _POLICY
    card = mlp.load(path).card
    where = card.domain, card.task
    evaluation = evaluate(*where, f"mlp:{path}", SEEDS, time_limit=_time_limit(*where))
    summary = evaluation.summary()
    scores = evaluation.scores[evaluation.policy]
    with (folder / "curve.csv").open(encoding="utf-8") as file:
        _, *lines = csv.reader(file)
    run = {
        "seed": card.seeds[0],
        "command": _command(folder, card),
        "steps": card.steps,
        "action_repeat": card.action_repeat,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "mean": summary.mean,
        "interval": summary.interval,
        "success_rate": summary.success_rate,
        "returns": [score.total for score in scores],
        # Control steps, seconds of one processor core, mean return of ten episodes.
        "curve": [[int(line[0]), float(line[2]), float(line[3])] for line in lines],
    }
    if card.domain == "lqr":  # where a control step pays 1 less its cost
        run["cost"] = statistics.fmean(score.length - score.total for score in scores)
    return run, evaluation


def _time_limit(domain: str, task: str) -> float | None:
    """Seconds of an episode of a task without a time limit; None for a task that has one."""
    with suite.load(domain, task) as environment:
        return seconds_without_a_limit(environment)


def _command(folder: Path, card: mlp.Card) -> str:
    """The command of a run, without its folder."""
    if _settings(folder) is None:
        return card.command
    return f"limberjack train {card.title} --seed {card.seeds[0]}"


def _settings(folder: Path) -> dict[str, object] | None:
    """The settings of a run of `limberjack train`; None of one of another program."""
    file = folder / "training.json"
    return json.loads(file.read_text("utf-8"))["settings"] if file.exists() else None


def _copy(source: Path, target: Path, run: _Result) -> None:
    """Copies a policy, with its scores in the card."""
    policy = mlp.load(source)
    low, high = run["interval"]
    scores = mlp.Scores(run["mean"], (low, high), (SEEDS.start, SEEDS.stop))
    card = dataclasses.replace(policy.card, scores=scores, licence=_LICENCE, command=run["command"])
    target.parent.mkdir(parents=True, exist_ok=True)
    mlp.save(target, policy.layers, card)


def is_outdated(result: _Result) -> bool:
    """Whether the table of settings has other ones than those of a task's runs."""
    if result["settings"] is None:
        return False
    now = settings_for(result["domain"], result["task"])
    return _used(result["settings"]) != _used(dataclasses.asdict(now))


def _used(settings: Mapping[str, object] | None) -> str:
    """The settings of a run as a text; those that did not exist then count with their defaults."""
    if settings is None:
        return ""
    return json.dumps({**dataclasses.asdict(Settings()), **settings}, sort_keys=True)


def recipe(found: Iterable[_Result]) -> str:
    """The text about the recipe that the page of training begins with."""
    (result,) = (one for one in found if f"{one['domain']}-{one['task']}" == RECIPE)
    runs = result["runs"]
    seconds = [f"{run['curve'][-1][1]:.0f}" for run in runs]
    best = published.best(result["domain"], result["task"], _MILLION)
    text = (
        f"With the seeds {_listed([run['seed'] for run in runs])} the policy had mean returns of "
        f"{_listed([format(run['mean'], '.0f') for run in runs])} over {len(SEEDS)} seeds that it "
        f"was not trained on, after {runs[0]['steps']:,} control steps: {_listed(seconds)} seconds "
        "of one processor core."
    )
    if best is not None:
        text += f" The best published mean after a million steps is {best.mean:.0f}."
    if is_outdated(result):
        text += " The settings have changed since these runs."
    return "\n" + textwrap.fill(text, _WIDTH) + "\n\n"


def _listed(values: Iterable[object]) -> str:
    *most, last = map(str, values)
    return f"{', '.join(most)} and {last}"


def write_pages(docs: Path = _DOCS) -> None:
    """Writes the table of the bundled policies and the figures of the recipe into their pages."""
    found = results()
    bundled = docs / "policies.md", "bundled policies", "learned.py"
    pages.write_section(*bundled, section(found))
    pages.write_section(docs / "training.md", "recipe", "learned.py", recipe(found))


def known_curves(found: Iterable[_Result]) -> str:
    """The text of the package's file of learning curves."""
    known = {}
    for result in found:
        best = published.best(result["domain"], result["task"], _MILLION)
        known[f"{result['domain']}-{result['task']}"] = {
            "published": best and {"mean": best.mean, "algorithm": best.algorithm},
            "runs": [{"seed": run["seed"], "curve": _rounded(run)} for run in result["runs"]],
        }
    # A line for each run.
    return json.dumps(known, separators=(",", ":")).replace('{"seed"', '\n{"seed"') + "\n"


def _rounded(run: _Result) -> list[tuple[int, float, float]]:
    return [(steps, round(seconds, 1), round(mean, 1)) for steps, seconds, mean in run["curve"]]


def write_curves(file: Path = learning.FILE, picture: Path = PICTURE) -> None:
    """Writes the package's file of learning curves, and draws all of them.

    The picture's description is the SHA-256 of the file.
    """
    text = known_curves(results())
    write_whole(file, text)
    tasks = list(learning.parse(text).values())
    write_learning_plot(picture, tasks, hashlib.sha256(text.encode()).hexdigest())


def main(
    trained: Annotated[Path | None, typer.Argument(help="Folder of folders of runs.")] = None,
) -> None:
    """Scores and bundles the runs of a folder, if one is given; writes table, curves and figure."""
    if trained is not None:
        for name in bundle(trained):
            typer.echo(name)
    write_pages()
    write_curves()


if __name__ == "__main__":
    typer.run(main)
