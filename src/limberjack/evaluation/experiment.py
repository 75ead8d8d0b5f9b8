"""`evaluate`: a policy on many seeds, beside doing nothing and acting at random on the same ones.

evaluation = evaluate("manipulator", "bring_ball", "my_policies:still", range(1000))
print(evaluation.summary().mean, evaluation.summary("zero").mean)
"""

import dataclasses
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from limberjack import report, suite
from limberjack.evaluation import actors, statistics
from limberjack.evaluation.episodes import play, play_alone
from limberjack.evaluation.starts import kind_of_start
from limberjack.evaluation.statistics import Score, Summary
from limberjack.evaluation.store import RESULT, Store
from limberjack.rl.guards import at_least_one
from limberjack.utils.files import replacing

__all__ = ["FLOORS", "PICTURE", "Evaluation", "evaluate"]

FLOORS = ("zero", "random")  # played on the same seeds, whatever is evaluated
PICTURE = "returns.png"

_SEEDS = 2**32  # numpy.random.RandomState takes seeds below this
_PLACE = "line-"  # followed by a number, it stands for a line of result.json

_OnProgress = Callable[[str, int, float], object]


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """What a policy and the two floors reached on the same seeds."""

    facts: dict[str, Any]  # what was asked for, and all that the numbers depend on
    scores: dict[str, list[Score]]  # by policy, in the order of the seeds; the evaluated one first
    files: tuple[Path, ...] = ()  # that were written
    left_out: str | None = None  # why the picture was not

    @property
    def policy(self) -> str:
        """The name of the policy that was evaluated."""
        return next(iter(self.scores))

    def summary(self, policy: str | None = None) -> Summary:
        """What all episodes say about the policy, or about 'zero' or 'random'."""
        return statistics.summarise(self.scores[policy or self.policy])

    def strata(self, policy: str | None = None) -> dict[str, Summary]:
        """The same for each kind of start, by name; empty where the task has no kinds."""
        return statistics.strata(self.scores[policy or self.policy])

    def as_json(self) -> dict[str, Any]:
        """What result.json holds."""
        rows = {
            policy: {
                **self.summary(policy).as_json(),
                "strata": {name: part.as_json() for name, part in self.strata(policy).items()},
            }
            for policy in self.scores
        }
        floors = {
            policy: {
                "returns": [score.total for score in scores],
                "final_rewards": [score.final_reward for score in scores],
            }
            for policy, scores in self.scores.items()
            if policy != self.policy
        }
        episodes = [_entry(score) for score in self.scores[self.policy]]
        return {**self.facts, "summary": rows, "episodes": episodes, "floors": floors}

    def draw(self, path: Path) -> None:
        """Draws the returns of all rows, and those of the policy by kind of start.

        Raises:
          OSError: the file cannot be written.
          ImportError: the extra `video` is missing.
        """
        title = "{domain} {task}, policy {policy}".format(**self.facts)
        by_policy = {name: [score.total for score in self.scores[name]] for name in self.scores}
        by_start: dict[str, list[float]] = {}
        for score in sorted(self.scores[self.policy], key=lambda score: score.start or ""):
            by_start.setdefault(score.start or "all", []).append(score.total)
        report.write_distribution_plot(path, title, by_policy, by_start)


def evaluate(
    domain: str,
    task: str,
    policy: Any = "zero",
    seeds: Iterable[int] = range(100),
    *,
    out: Path | str | None = None,
    num_threads: int | None = None,
    time_limit: float | None = None,
    on_progress: _OnProgress | None = None,
) -> Evaluation:
    """The scores of a policy, of zero actions and of random ones, on the same seeds.

    Episode k is the first episode of the environment seeded with the k-th seed.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      policy: its name, or the function, object or class itself; see `limberjack.evaluation.actors`.
      seeds: distinct, from 0 to 2**32 - 1.
      out: a folder for the results. Episodes that finished there in an earlier call, which may have
        been killed, are not played again.
      num_threads: threads that step the batch; by default the cores that this process may use.
      time_limit: seconds per episode; the task's own by default.
      on_progress: called before a policy's first step, and after each step and episode, with the
        policy that plays, how many episodes of all policies have finished, and what has been played
        of running ones, in episodes.

    Raises:
      ValueError: there is no such task, policy or seed, a number is out of range, or the folder
        holds other results. Nothing was played.
      PolicyError: the policy returned what is no action; finished episodes are kept in the folder.
      OSError: a file cannot be written.
    """
    checked = _checked_seeds(seeds)
    if num_threads is not None:
        at_least_one("num_threads", num_threads)
    if time_limit == math.inf:
        raise ValueError("time_limit is inf, so no episode would end; expected seconds")
    task_kwargs = {} if time_limit is None else {"time_limit": time_limit}
    environment = suite.load(domain, task, task_kwargs)
    found = actors.find(policy, environment, num_threads)
    directory = None if out is None else Path(out)
    identity = _identity(domain, task, found, environment)
    store = _store(directory, identity, found)
    everyone = [found, *(actors.find(n, environment) for n in FLOORS if n != found.name)]
    course = _Course(environment, suite.load(domain, task), store, checked, num_threads)
    try:
        for one in everyone:
            course.run(one, on_progress)
    finally:
        store.close()
        course.close()
    facts = {**identity, **_asked_for(checked)}
    scores = {one.name: [store.scores[one.name][seed] for seed in checked] for one in everyone}
    evaluation = Evaluation(facts, scores)
    return evaluation if directory is None else _written(evaluation, directory)


def _store(directory: Path | None, identity: dict[str, Any], found: actors.Found) -> Store:
    """Where the episodes are kept; raises if those that are there may be another policy's."""
    store = Store(directory, identity)
    if found.sha256 is None and store.scores[found.name]:
        store.close()
        raise ValueError(
            f"{directory} holds episodes of {found.name!r}, whose source is not known here, so "
            "another policy of that name may have played them: choose another folder, or keep the "
            "policy in a file"
        )
    return store


class _Course:
    """Plays what is missing in a store."""

    def __init__(
        self, environment: Any, falls: Any, store: Store, seeds: list[int], threads: int | None
    ) -> None:
        """Takes over two environments of the task; that of `falls` has no short time limit."""
        self._environment = environment
        self._falls = falls
        self._store = store
        self._seeds = seeds
        self._threads = threads
        by_seed = (score for of_policy in store.scores.values() for score in of_policy.values())
        self._starts = {score.seed: score.start for score in by_seed}
        self._finished = 0  # episodes, those of earlier calls included

    def run(self, found: actors.Found, on_progress: _OnProgress | None) -> None:
        """Plays the seeds that the policy has not played."""
        known = self._store.scores[found.name]
        missing = [seed for seed in self._seeds if seed not in known]
        limit = self._environment.step_limit or math.inf
        self._finished += len(self._seeds) - len(missing)
        steps = 0  # of episodes that go on

        def tell() -> None:
            if on_progress is not None:
                on_progress(found.name, self._finished, steps / limit)

        def on_steps(count: int) -> None:
            nonlocal steps
            steps += count
            tell()

        if missing:
            tell()
        for score in self._scores(found, missing, on_steps) if missing else ():
            self._store.add(found.name, self._with_start(score))
            self._finished += 1
            steps -= score.length
            tell()

    def close(self) -> None:
        """Frees the environments."""
        self._environment.close()
        self._falls.close()

    def _scores(
        self, found: actors.Found, seeds: list[int], on_steps: Callable[[int], None]
    ) -> Iterator[Score]:
        if found.actor is not None:
            return play(self._environment, found.actor, seeds, self._threads, on_steps)
        assert found.alone is not None
        return play_alone(self._environment, found.alone, seeds, on_steps)

    def _with_start(self, score: Score) -> Score:
        """The score with the kind of its start, which is found once for each seed."""
        if score.seed not in self._starts:
            self._starts[score.seed] = kind_of_start(self._falls, score.seed)
        return dataclasses.replace(score, start=self._starts[score.seed])


def _written(evaluation: Evaluation, directory: Path) -> Evaluation:
    """Writes result.json and returns.png; the evaluation then knows which of them are there."""
    result, picture = directory / RESULT, directory / PICTURE
    with replacing(result) as partial:
        partial.write_text(_text(evaluation.as_json()), encoding="utf-8")
    try:
        evaluation.draw(picture)
    except ImportError as error:
        picture.unlink(missing_ok=True)  # that of an earlier call
        return dataclasses.replace(evaluation, files=(result,), left_out=f"no {PICTURE}: {error}")
    return dataclasses.replace(evaluation, files=(result, picture))


def _identity(domain: str, task: str, found: actors.Found, environment: Any) -> dict[str, Any]:
    """All that an episode depends on but its seed."""
    limit, control_timestep = environment.step_limit, environment.control_timestep()
    return {
        "domain": domain,
        "task": task,
        "policy": found.name,
        "policy_sha256": found.sha256,
        "time_limit": None if limit is None else limit * control_timestep,
        "control_timestep": control_timestep,
        "action_repeat": 1,  # the policy acts at every control step
        "versions": report.versions(),
        "fingerprint": report.fingerprint(environment.physics.model._model),
    }


def _asked_for(seeds: list[int]) -> dict[str, Any]:
    """The seeds, and what is counted and how."""
    first, end = seeds[0], seeds[-1] + 1
    is_range = seeds == list(range(first, end))
    return {
        "seeds": f"{first}:{end}" if is_range else seeds,
        "episodes_asked_for": len(seeds),
        "success": {
            "last_steps": statistics.LAST_STEPS,
            "mean_reward_at_least": statistics.SUCCESS_REWARD,
        },
        "interval": {
            "of": "mean",
            "confidence": statistics.CONFIDENCE,
            "method": "percentile bootstrap",
            "resamples": statistics.RESAMPLES,
        },
    }


def _checked_seeds(seeds: Iterable[int]) -> list[int]:
    """The seeds as a list.

    Raises:
      ValueError: there are none, one stands twice, or one is no seed.
    """
    checked = []
    for seed in seeds:
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer):
            raise ValueError(f"seed is {seed!r}; expected a whole number")
        if not 0 <= seed < _SEEDS:
            raise ValueError(f"seed is {seed}; expected 0 or more, and below {_SEEDS}")
        checked.append(int(seed))
    if not checked:
        raise ValueError("there are no seeds; expected at least one, such as range(100)")
    if len(set(checked)) < len(checked):
        raise ValueError("a seed stands twice; expected each once, or its episode counts twice")
    return checked


def _entry(score: Score) -> dict[str, Any]:
    """An episode as `limberjack run` writes it, and how it ended."""
    entry: dict[str, Any] = {"seed": score.seed, "return": score.total, "length": score.length}
    if score.start is not None:
        entry["start"] = score.start
    entry |= {"final_reward": score.final_reward, "success": score.success}
    return {**entry, "diverged": True} if score.diverged else entry


def _text(content: dict[str, Any]) -> str:
    """JSON with a line for each episode, so that a thousand of them can still be looked through."""
    lines: list[str] = []

    def on_one_line(value: Any) -> str:
        lines.append(json.dumps(value, allow_nan=False))
        return f"{_PLACE}{len(lines) - 1}"

    episodes = [on_one_line(episode) for episode in content["episodes"]]
    floors = {
        policy: {name: on_one_line(values) for name, values in of_policy.items()}
        for policy, of_policy in content["floors"].items()
    }
    shown = {**content, "episodes": episodes, "floors": floors}
    text = json.dumps(shown, indent=2, allow_nan=False)
    return re.sub(f'"{_PLACE}(\\d+)"', lambda found: lines[int(found[1])], text) + "\n"
