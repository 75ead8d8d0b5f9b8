"""`evaluate_set`: scores of an agent on a set of tasks, by the protocol of papers.

    found = evaluate_set("dmc28", "sb3:runs/0/{domain}-{task}.zip", out="set")
    print(found.interquartile_mean, found.missing)

    runs = [{("walker", "walk"): my_agent, ("walker", "run"): other}, ...]  # policies by task
    found = evaluate_set("dmc28", runs)
    print(found.interval, found.percentiles)

A run is one training of an agent on each of the tasks. The protocol fixes everything else, so that
two results with the same set and version can be compared: ten episodes of each task, from the same
seeds, of 1,000 control steps; and two control steps per action, except for policies that demand
another number, as policy files and the planner do. A score is the mean return divided by 1,000.

Episodes are played and kept by `evaluate`, with zero and random actions beside them, in a folder
for each run and task. The same call continues where an earlier one was killed. A task for which a
run has no policy, or one that does not fit, is left out of all means, and listed with the reason.
"""

import concurrent.futures
import contextlib
import dataclasses
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from limberjack import policies, suite
from limberjack.episodes.environments import seconds_without_a_limit
from limberjack.episodes.places import local
from limberjack.evaluation import statistics
from limberjack.evaluation.experiment import FLOORS, evaluate
from limberjack.evaluation.results import Evaluation
from limberjack.evaluation.store import SUMMARY
from limberjack.policies import PolicyError
from limberjack.registry import sets
from limberjack.registry.sets import Tasks, TaskSet, refusals_named
from limberjack.rl.control import Environment
from limberjack.utils.files import read_regular, write_whole
from limberjack.workers import OnProgress, OnState, WorkError, counted_from
from limberjack.worlds import World
from limberjack.worlds.appearance import Appearance, Looks
from limberjack.worlds.faults import Faults

__all__ = [
    "VERSION",
    "SetEvaluation",
    "TaskScores",
    "episodes_of",
    "evaluate_set",
]

VERSION = 1  # of the protocol: it changes with any of the numbers below

_SEEDS = range(30_000, 30_010)  # on which neither the planner nor an agent of ours was tuned
_ACTION_REPEAT = 2
_FULL_RETURN = 1000.0  # the largest return of such an episode; a score is a share of it

_Task = tuple[str, str]


@dataclasses.dataclass(frozen=True)
class _Plan:
    """The arguments of `evaluate` for a task and each run."""

    time_limit: float | None  # seconds of an episode; None for the task's own
    policies: tuple[object, ...]
    action_repeats: tuple[int | None, ...]  # None for the number that the policy demands


@dataclasses.dataclass(frozen=True)
class TaskScores:
    """Scores of all runs on one task."""

    domain: str
    task: str
    returns: tuple[float, ...]  # the mean return of each run
    action_repeats: tuple[int, ...]  # control steps per action of each run
    control_steps: int  # of the longest episode of all runs
    floors: Mapping[str, float]  # the mean return of zero and of random actions

    @property
    def scores(self) -> tuple[float, ...]:
        """The mean return of each run divided by 1,000."""
        return tuple(one / _FULL_RETURN for one in self.returns)

    @property
    def agent_steps(self) -> tuple[int, ...]:
        """Actions in an episode of each run."""
        return tuple(math.ceil(self.control_steps / repeat) for repeat in self.action_repeats)


@dataclasses.dataclass(frozen=True)
class SetEvaluation:
    """Scores of the runs of an agent on a set of tasks."""

    set: TaskSet
    runs: tuple[str, ...]  # the names of their policies
    tasks: tuple[TaskScores, ...]  # those that all runs have
    missing: Mapping[_Task, str]  # the other tasks of the set, each with the reason
    versions: Mapping[str, str]  # of the packages
    world: World | None = None  # settings by which the world differs from the suite's, as JSON
    files: tuple[Path, ...] = ()  # files that were written

    @property
    def scores(self) -> np.ndarray:
        """(runs, tasks)."""
        return np.array([one.scores for one in self.tasks]).T

    @property
    def interquartile_mean(self) -> float:
        """The mean of the middle half of all scores."""
        return float(statistics.interquartile_mean(self.scores))

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of the interquartile mean over runs; None for one run."""
        return statistics.stratified_interval(self.scores)

    @property
    def percentiles(self) -> dict[int, float]:
        """Percentiles over runs of their mean scores."""
        return statistics.percentiles(self.scores)

    def as_json(self) -> dict[str, object]:
        """The content of set.json."""
        scores = self.scores
        summary = {
            "tasks": len(self.tasks),
            "mean": float(scores.mean()),
            "mean_of_runs": scores.mean(axis=-1).tolist(),
            "interquartile_mean": self.interquartile_mean,
            "interval": self.interval,
            "percentiles": {str(at): value for at, value in self.percentiles.items()},
        }
        tasks = [
            {**dataclasses.asdict(one), "scores": one.scores, "agent_steps": one.agent_steps}
            for one in self.tasks
        ]
        missing = [
            {"domain": domain, "task": task, "reason": reason}
            for (domain, task), reason in self.missing.items()
        ]
        facts = {"summary": summary, "tasks": tasks, "missing": missing}
        asked_for = _asked_for(self.set, self.runs, self.world)
        return {**asked_for, **facts, "versions": dict(self.versions)}


def evaluate_set(
    task_set: Tasks,
    runs: object,
    *,
    out: Path | str | None = None,
    num_threads: int | None = None,
    workers: int | None = None,
    executor: concurrent.futures.Executor | None = None,
    ray: str | None = None,
    any_processor: bool = False,
    world: World | None = None,
    on_progress: OnProgress | None = None,
    on_state: OnState | None = None,
    command: str = "",
) -> SetEvaluation:
    """The scores of one or more runs of an agent on all tasks of a set.

    Args:
      task_set: its name, such as 'dmc28', or a list of tasks; see `registry.sets.find`.
      runs: one, or a list of several. A run is the name of a policy, in which {domain} and {task}
        stand for those of each task; a policy itself; or a dictionary of policies by
        (domain, task), which may lack tasks.
      out: a folder for the results. Episodes that finished there in an earlier call are not played
        again.
      num_threads: as for `evaluate`, like the others.
      workers: processes that play.
      executor: plays the episodes in place of processes made here.
      ray: address of a Ray cluster that plays the episodes.
      any_processor: accept workers and episodes of processors that round differently.
      world: as for `evaluate`, of all tasks.
      on_progress: called as by `evaluate`, with the number of episodes of all tasks and runs; those
        of tasks that are left out count as finished. `episodes_of` has their number.
      on_state: as for `evaluate`.
      command: the command line as it was typed, for the pages; empty if there was none.

    Raises:
      ValueError: there is no such set, or no run, or the folder holds other results.
      SetError: the folder of a task does; episodes of tasks before stay.
      PolicyError: a run has no policy for any task; or a policy returned no valid action.
      WorkError, OSError: as `evaluate`.
    """
    chosen, given = _chosen(task_set, runs)
    names = tuple(map(_name_of, given))
    directory = None if out is None else local(out)
    settings = _settings_of(world)
    if directory is not None:
        _check_folder(directory, _asked_for(chosen, names, settings))
    plans, missing = _planned(chosen, given, world)
    if directory is not None and not (directory / SUMMARY).exists():
        _write(directory / SUMMARY, _asked_for(chosen, names, settings))
    finished = len(missing) * _episodes(given)
    found: dict[_Task, list[Evaluation]] = {task: [] for task in plans}
    for (domain, task), plan in plans.items():
        for number, run in enumerate(given):
            name = f"run-{number + 1}/{domain}-{task}"
            count = counted_from(finished, on_progress)
            with _noted(f"{domain} {task}"), refusals_named(domain, task, count) as show:
                of_run = evaluate(
                    domain,
                    task,
                    plan.policies[number],
                    _SEEDS,
                    out=None if directory is None else directory / name,
                    num_threads=num_threads,
                    time_limit=plan.time_limit,
                    action_repeat=plan.action_repeats[number],
                    workers=workers,
                    executor=executor,
                    ray=ray,
                    any_processor=any_processor,
                    world=world,
                    on_progress=show,
                    on_state=on_state,
                    command=command,
                )
            found[domain, task].append(of_run)
            finished += _episodes([run])
    tasks = tuple(_scores_of(*task, of_runs) for task, of_runs in found.items())
    versions = next(iter(found.values()))[0].facts["versions"]
    result = SetEvaluation(chosen, names, tasks, missing, versions, settings)
    return result if directory is None else _written(result, directory)


def episodes_of(task_set: Tasks, runs: object) -> int:
    """The number of episodes that `evaluate_set` reports progress of, baselines included."""
    chosen, given = _chosen(task_set, runs)
    return len(chosen.tasks) * _episodes(given)


def _chosen(task_set: Tasks, runs: object) -> tuple[TaskSet, list[object]]:
    """The set, and the runs as a list.

    Raises:
      ValueError: one of them is unknown or empty, or a run is there twice, which narrows intervals.
    """
    chosen = sets.find(task_set)
    given = list(runs) if isinstance(runs, list | tuple) else [runs]
    if not given:
        raise ValueError("there are no runs; expected at least one policy")
    pairs = itertools.combinations(given, 2)
    twice = [one for one, other in pairs if one is other or (isinstance(one, str) and one == other)]
    if twice:
        raise ValueError(
            f"run {twice[0]!r} occurs twice; expected each once: equal scores add none"
        )
    return chosen, given


@contextlib.contextmanager
def _noted(task: str) -> Iterator[None]:
    """Adds the name of a task to the notes of a policy's or a worker's error."""
    try:
        yield
    except Exception as error:
        if isinstance(error, PolicyError | WorkError) or hasattr(error, "__notes__"):
            error.add_note(task)
        raise


def _episodes(runs: Sequence[object]) -> int:
    """The number of episodes on one task."""
    return sum(len({_name_of(run), *FLOORS}) * len(_SEEDS) for run in runs)


def _name_of(run: object) -> str:
    """The name of a run, as results call it."""
    if isinstance(run, Mapping):
        return ", ".join(dict.fromkeys(_name_of(policy) for policy in run.values()))
    return run if isinstance(run, str) else policies.find(run).name


def _planned(
    task_set: TaskSet, runs: Sequence[object], world: World | None = None
) -> tuple[dict[_Task, _Plan], dict[_Task, str]]:
    """The plans of tasks, and the reasons why others are left out.

    Raises:
      PolicyError: all are left out.
    """
    plans: dict[_Task, _Plan] = {}
    missing: dict[_Task, str] = {}
    for domain, task in task_set.tasks:
        with contextlib.closing(suite.load(domain, task, None, world)) as environment:
            try:
                plans[domain, task] = _plan(environment, runs, domain, task)
            except PolicyError as error:
                missing[domain, task] = str(error)
    if not plans:
        (domain, task), reason = next(iter(missing.items()))
        raise PolicyError(f"no task has a policy of every run; {domain} {task}: {reason}")
    return plans, missing


def _plan(environment: Environment, runs: Sequence[object], domain: str, task: str) -> _Plan:
    """The plan of a task; raises PolicyError if a run has no policy that fits."""
    chosen = [policies.policy_for(run, domain, task) for run in runs]
    repeats: list[int | None] = []
    for run, policy in zip(runs, chosen, strict=True):
        if policy is None:
            raise PolicyError(f"{_name_of(run) or 'a run'} has no policy for it")
        demanded = policies.find(policy, environment, num_threads=1).action_repeat
        repeats.append(_ACTION_REPEAT if demanded is None else None)
    return _Plan(seconds_without_a_limit(environment), tuple(chosen), tuple(repeats))


def _scores_of(domain: str, task: str, evaluations: Sequence[Evaluation]) -> TaskScores:
    first = evaluations[0]
    return TaskScores(
        domain,
        task,
        tuple(one.summary().mean for one in evaluations),
        tuple(one.facts["action_repeat"] for one in evaluations),
        max(score.length for one in evaluations for score in one.scores[one.policy]),
        {name: first.summary(name).mean for name in FLOORS},
    )


def _asked_for(task_set: TaskSet, runs: Sequence[str], world: World | None) -> dict[str, object]:
    """The facts that identify the results of a folder."""
    return {
        "set": task_set.name,
        "source": task_set.source,
        "protocol": VERSION,
        "of_tasks": [list(task) for task in task_set.tasks],
        "seeds": f"{_SEEDS[0]}:{_SEEDS[-1] + 1}",
        "score": f"mean return divided by {_FULL_RETURN:g}",
        "runs": list(runs),
        "world": world,
    }


def _settings_of(world: World | None) -> World | None:
    """The complete settings of a world's options as values of JSON; None without any."""
    settings = {name: value for name, value in (world or {}).items() if value is not None}
    if "faults" in settings:
        # `of` checks what it is given.
        settings["faults"] = Faults.of(cast(Faults, settings["faults"])).as_json()
    if "appearance" in settings:
        options = Appearance.of(cast(Appearance, settings["appearance"]))
        settings["appearance"] = Looks(options, 1, 1.0).as_json()  # with the hash of files
    return settings or None


def _check_folder(directory: Path, asked_for: Mapping[str, object]) -> None:
    """Raises ValueError if a folder holds other results, or anything else."""
    path = directory / SUMMARY
    if not path.exists():
        # A process that was killed may have left a hidden file.
        if directory.exists() and any(one.name[0] != "." for one in directory.iterdir()):
            raise ValueError(
                f"{directory} holds other files and no {SUMMARY}: choose another folder"
            )
        return
    try:
        there = json.loads(read_regular(path))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is no result of this command: {error}") from None
    for name, expected in asked_for.items():
        found = there.get(name) if isinstance(there, dict) else None
        if found != expected:
            raise ValueError(
                f"{directory} holds an evaluation with {name} {found!r}, and this one has "
                f"{expected!r}: choose another folder, or remove that one"
            )


def _written(result: SetEvaluation, directory: Path) -> SetEvaluation:
    path = directory / SUMMARY
    _write(path, result.as_json())
    return dataclasses.replace(result, files=(path,))


def _write(path: Path, content: Mapping[str, object]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
