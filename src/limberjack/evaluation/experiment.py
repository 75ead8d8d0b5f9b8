"""`evaluate`: scores of a policy, of zero actions and of random actions, on the same seeds.

evaluation = evaluate("manipulator", "bring_ball", "my_policies:still", range(1000))
print(evaluation.summary().mean, evaluation.summary("zero").mean)
"""

import dataclasses
import json
import re
from collections.abc import Iterable
from pathlib import Path

from limberjack import report
from limberjack.evaluation import actors, statistics
from limberjack.evaluation.runner import OnProgress, Runner, check_seeding
from limberjack.evaluation.statistics import Score, Summary
from limberjack.evaluation.store import RESULT, Store
from limberjack.factories import Factory, Make, factory_of
from limberjack.report import Facts
from limberjack.rl.control import Environment
from limberjack.rl.guards import at_least_one
from limberjack.utils.files import replacing
from limberjack.utils.seeds import checked_seed

__all__ = ["FLOORS", "PAGE", "PICTURE", "Evaluation", "evaluate"]

FLOORS = ("zero", "random")  # baselines, always played on the same seeds as the policy
PAGE = "report.html"
PICTURE = "returns.png"

_PLACEHOLDER = "line-"  # followed by a number, it stands for a line of result.json


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Scores of a policy and of the two baselines on the same seeds."""

    facts: Facts  # the request, and everything that the numbers depend on
    scores: dict[str, list[Score]]  # by policy, in the order of the seeds; the evaluated one first
    files: tuple[Path, ...] = ()  # files that were written
    left_out: str | None = None  # the reason why the picture was not written

    @property
    def policy(self) -> str:
        """The name of the policy that was evaluated."""
        return next(iter(self.scores))

    def summary(self, policy: str | None = None) -> Summary:
        """Statistics of all episodes of the policy, or of 'zero' or 'random'."""
        return statistics.summarise(self.scores[policy or self.policy])

    def strata(self, policy: str | None = None) -> dict[str, Summary]:
        """The same for each kind of start, by name; empty where the task has no kinds."""
        return statistics.strata(self.scores[policy or self.policy])

    def as_json(self) -> Facts:
        """The content of result.json."""
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
          ImportError: matplotlib is not installed.
        """
        facts = self.facts
        name = facts.get("environment") or f"{facts['domain']} {facts['task']}"
        title = f"{name}, policy {self.policy}"
        by_policy = {name: [score.total for score in self.scores[name]] for name in self.scores}
        by_start: dict[str, list[float]] = {}
        for score in sorted(self.scores[self.policy], key=lambda score: score.start or ""):
            by_start.setdefault(score.start or "all", []).append(score.total)
        report.write_distribution_plot(path, title, by_policy, by_start)


def evaluate(
    domain: str | Make,
    task: str | None = None,
    policy: object = "zero",
    seeds: Iterable[int] = range(100),
    *,
    out: Path | str | None = None,
    num_threads: int | None = None,
    time_limit: float | None = None,
    on_progress: OnProgress | None = None,
    command: str = "",
) -> Evaluation:
    """The scores of a policy, of zero actions and of random ones, on the same seeds.

    Episode k is the first episode of the environment seeded with the k-th seed.

    Args:
      domain: such as 'humanoid', or a function `make(seed) -> control.Environment`; see
        `limberjack.factories`.
      task: such as 'walk'; None with a function.
      policy: its name, or the function, object or class itself; see `limberjack.policies`.
      seeds: distinct, from 0 to 2**32 - 1.
      out: a folder for the results. Episodes that finished there in an earlier call, which may have
        been killed, are not played again.
      num_threads: number of threads that step the batch; by default one per usable core.
      time_limit: seconds per episode; the task's own by default, as with a function.
      on_progress: called before a policy's first step, and after each step and episode, with the
        name of the policy, the number of finished episodes of all policies, and how many episodes'
        worth of steps the running ones have played.
      command: the command line as it was typed, for the page; empty if there was none.

    Raises:
      ValueError, TypeError: there is no such task, policy or seed, a number is out of range, the
        episodes have no time limit, the task cannot run in batches, or the folder holds other
        results. Nothing was played.
      PolicyError: the policy returned no valid action; finished episodes stay in the folder.
      OSError: a file cannot be written.
    """
    checked = _checked_seeds(seeds)
    if num_threads is not None:
        at_least_one("num_threads", num_threads)
    factory = factory_of(domain, task, time_limit)
    directory = None if out is None else Path(out)
    if directory is not None:
        _check_known(factory)
    environment = factory.make(checked[0])
    _check_ends(factory, environment)
    found = actors.find(policy, environment, num_threads)
    identity = _identity(factory, found, environment)
    if callable(domain):
        check_seeding(factory, environment, checked[:2])
    full_length = factory if callable(domain) else factory_of(domain, task)
    store = _store(directory, identity, found)
    everyone = [found, *(actors.find(n, environment) for n in FLOORS if n != found.name)]
    runner = Runner(environment, full_length.make(0), store, checked, num_threads)
    try:
        for one in everyone:
            runner.run(one, on_progress)
    finally:
        store.close()
        runner.close()
    facts = {**identity, **_asked_for(checked), **_played_with(store, identity)}
    scores = {one.name: [store.scores[one.name][seed] for seed in checked] for one in everyone}
    evaluation = Evaluation(facts, scores)
    return evaluation if directory is None else _written(evaluation, directory, command)


def _check_known(factory: Factory) -> None:
    """Raises ValueError if results in a folder could belong to another environment."""
    if not factory.is_known:
        raise ValueError(
            f"{factory.title} cannot be distinguished from other functions of that name, so its "
            "results cannot be kept: define make(seed) at the top level of a module, or pass no "
            "folder"
        )


def _check_ends(factory: Factory, environment: Environment) -> None:
    """Raises ValueError if episodes have no time limit."""
    if environment.step_limit is None:
        raise ValueError(
            f"{factory.title} has no time limit, so an episode might never end: give it a "
            "time_limit (--time-limit SECONDS)"
        )


def _store(directory: Path | None, identity: Facts, found: actors.Found) -> Store:
    """The store in a folder; raises if its episodes may be those of another policy."""
    store = Store(directory, identity)
    if found.sha256 is None and store.scores[found.name]:
        store.close()
        raise ValueError(
            f"{directory} holds episodes of {found.name!r}, whose source is unknown here, so "
            "another policy of that name may have played them: choose another folder, or define "
            "the policy in a file"
        )
    return store


def _written(evaluation: Evaluation, directory: Path, command: str) -> Evaluation:
    """Writes result.json, report.html and returns.png; returns the evaluation with their names."""
    result, page, picture = (directory / name for name in (RESULT, PAGE, PICTURE))
    content = evaluation.as_json()
    with replacing(result) as partial:
        partial.write_text(_text(content), encoding="utf-8")
    report.write_evaluation_page(page, content, command)
    files = (result, page)
    try:
        evaluation.draw(picture)
    except ImportError as error:
        picture.unlink(missing_ok=True)  # of an earlier call
        return dataclasses.replace(evaluation, files=files, left_out=f"no {PICTURE}: {error}")
    return dataclasses.replace(evaluation, files=(*files, picture))


def _identity(factory: Factory, found: actors.Found, environment: Environment) -> Facts:
    """Everything that an episode depends on except its seed."""
    limit, control_timestep = environment.step_limit, environment.control_timestep()
    return {
        **factory.facts,
        "policy": found.name,
        "policy_sha256": found.sha256,
        "time_limit": None if limit is None else limit * control_timestep,
        "control_timestep": control_timestep,
        "action_repeat": 1,  # the policy acts at every control step
        "versions": report.versions(),
        "fingerprint": report.fingerprint(environment.physics.model._model),
    }


def _played_with(store: Store, identity: Facts) -> Facts:
    """The versions that played the episodes, if others than the present ones did."""
    present = [identity["versions"]]
    return {} if store.versions == present else {"versions_of_episodes": store.versions}


def _asked_for(seeds: list[int]) -> Facts:
    """The seeds, and the definitions of success and of the interval."""
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
      ValueError, TypeError: there is no seed, one occurs twice, or one is invalid.
    """
    checked = [checked_seed(seed) for seed in seeds]
    if not checked:
        raise ValueError("there are no seeds; expected at least one, such as range(100)")
    if len(set(checked)) < len(checked):
        raise ValueError("a seed occurs twice; expected each once, so that no episode counts twice")
    return checked


def _entry(score: Score) -> Facts:
    """An episode as `limberjack run` writes it, with its final reward and success."""
    entry: Facts = {"seed": score.seed, "return": score.total, "length": score.length}
    if score.start is not None:
        entry["start"] = score.start
    entry |= {"final_reward": score.final_reward, "success": score.success}
    return {**entry, "diverged": True} if score.diverged else entry


def _text(content: Facts) -> str:
    """JSON with one line per episode, so that a file of a thousand episodes stays readable."""
    lines: list[str] = []

    def on_one_line(value: object) -> str:
        lines.append(json.dumps(value, allow_nan=False))
        return f"{_PLACEHOLDER}{len(lines) - 1}"

    episodes = [on_one_line(episode) for episode in content["episodes"]]
    floors = {
        policy: {name: on_one_line(values) for name, values in of_policy.items()}
        for policy, of_policy in content["floors"].items()
    }
    shown = {**content, "episodes": episodes, "floors": floors}
    text = json.dumps(shown, indent=2, allow_nan=False)
    return re.sub(f'"{_PLACEHOLDER}(\\d+)"', lambda found: lines[int(found[1])], text) + "\n"
