"""Published scores of learned agents, each with its training steps and its source.

    from limberjack.evaluation import published

    for score in published.scores("humanoid", "walk"):
        print(score.algorithm, score.steps, score.mean, score.spread, score.source.address)
    published.best("humanoid", "walk", steps=1_000_000).algorithm       # 'FlashSAC'

The numbers are in published.json beside this file. `tools/read_published.py` computes them from the
files of their authors, of which none is copied; a source that could not be read itself is marked
second-hand. All scores come from dm_control on older versions of MuJoCo, from few episodes and from
seeds that are not known, so a difference of a few percent to a score of this package means nothing.

A score says how many control steps its agent was trained for. Scores after different numbers of
steps are different results: `best` compares only those within 5 % of the same number.
"""

import dataclasses
import functools
import json
from pathlib import Path
from typing import Any

from limberjack.utils.suggest import did_you_mean

__all__ = ["PublishedScore", "Source", "best", "none_found", "scores", "sources"]

_FILE = Path(__file__).with_name("published.json")
_SAME_STEPS = 0.05  # largest relative difference; some runs end one evaluation early


@dataclasses.dataclass(frozen=True)
class Source:
    """A file or a table of published scores."""

    name: str  # such as 'tdmpc2'
    algorithm: str
    address: str  # of the repository, or of the paper
    revision: str | None  # the commit that was read; None for a source that was not read
    file: str  # or table; the folder and a pattern if there is a file for each task
    licence: str  # of the repository; only numbers were taken
    action_repeat: int | None  # control steps per action; None if the source does not say
    mean: str  # definition of the mean
    spread: str  # definition of the number after the plus-minus sign
    second_hand: str | None  # reason why a score is not from its authors, or was not read itself


@dataclasses.dataclass(frozen=True)
class PublishedScore:
    """A published return of one algorithm on one task."""

    domain: str
    task: str
    source: Source
    steps: int | None  # control steps of training; None if it learned from a dataset
    seeds: int | None  # runs that the mean is over; None if the source does not say
    mean: float
    spread: float | None

    @property
    def algorithm(self) -> str:
        """Name of the algorithm, as its authors write it."""
        return self.source.algorithm

    @property
    def agent_steps(self) -> int | None:
        """Actions chosen in training; None if steps or action repeat are not known."""
        if self.steps is None or self.source.action_repeat is None:
            return None
        return self.steps // self.source.action_repeat

    def is_after(self, steps: int | None) -> bool:
        """Whether the agent trained for this number of control steps, within 5 %; see `best`."""
        if self.steps is None or steps is None:
            return self.steps is steps
        return abs(self.steps - steps) <= _SAME_STEPS * steps


def sources() -> dict[str, Source]:
    """All sources by name."""
    return {name: Source(name, **facts) for name, facts in _content()["sources"].items()}


def scores(domain: str | None = None, task: str | None = None) -> tuple[PublishedScore, ...]:
    """The published scores in the order of the suite's tasks; of a domain or a task if named.

    Raises:
      ValueError: the suite has no such domain or task.
    """
    found = [score for score in _scores() if domain in (None, score.domain)]
    if (domain, task) != (None, None):
        _check(domain, task)
    return tuple(score for score in found if task in (None, score.task))


def none_found() -> tuple[tuple[str, str], ...]:
    """The (domain, task) pairs for which no published score was found."""
    return tuple((domain, task) for domain, task in _content()["none_found"])


def best(domain: str, task: str, steps: int | None) -> PublishedScore | None:
    """The highest published mean after a number of control steps; None if there is no score.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      steps: of training; scores within 5 % of it count. None for those learned from a dataset.

    Raises:
      ValueError: the suite has no such domain or task.
    """
    matching = [score for score in scores(domain, task) if score.is_after(steps)]
    return max(matching, key=lambda score: score.mean, default=None)


def _check(domain: str | None, task: str | None) -> None:
    """Raises ValueError unless the file knows the domain and the task, where they are named."""
    known = [(score.domain, score.task) for score in _scores()] + list(none_found())
    if not any(domain in (None, one) and task in (None, name) for one, name in known):
        names = [f"{one if domain else ''} {name if task else ''}".strip() for one, name in known]
        given = f"{domain or ''} {task or ''}".strip()
        raise ValueError(
            f"no {given!r} among the suite's published scores.{did_you_mean(given, names)}"
        )


@functools.cache
def _content() -> dict[str, Any]:  # Any: values of JSON
    return json.loads(_FILE.read_text(encoding="utf-8"))


@functools.cache
def _scores() -> tuple[PublishedScore, ...]:
    known = sources()
    return tuple(
        PublishedScore(domain, task, known[source], steps, seeds, mean, spread)
        for domain, task, source, steps, seeds, mean, spread in _content()["scores"]
    )
