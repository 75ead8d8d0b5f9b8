"""`Evaluation`: the scores of a policy and of the baselines, and the files that show them.

evaluation.summary("zero").mean
write(evaluation, Path("scores"), command="")
"""

import dataclasses
from pathlib import Path
from typing import cast

from limberjack.episodes import statistics
from limberjack.episodes.manifest import in_lines
from limberjack.episodes.statistics import Score, Summary
from limberjack.evaluation.store import PAGE, PICTURE, RESULT
from limberjack.see import report
from limberjack.utils.facts import Facts, title_of
from limberjack.utils.files import write_whole

__all__ = ["Evaluation", "write"]


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

    def as_json(self) -> report.EvaluationResult:
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
                **_processors(scores),
            }
            for policy, scores in self.scores.items()
            if policy != self.policy
        }
        episodes = [_entry(score) for score in self.scores[self.policy]]
        result: dict[str, object] = {
            **self.facts,
            "summary": rows,
            "episodes": episodes,
            "floors": floors,
        }
        return cast(report.EvaluationResult, result)

    def draw(self, path: Path) -> None:
        """Draws the returns of all rows, and those of the policy by kind of start.

        Raises:
          OSError: the file cannot be written.
          ImportError: matplotlib is not installed.
        """
        facts = self.facts
        name = title_of(facts)
        title = f"{name}, policy {self.policy}"
        by_policy = {name: [score.total for score in self.scores[name]] for name in self.scores}
        by_start: dict[str, list[float]] = {}
        for score in sorted(self.scores[self.policy], key=lambda score: score.start or ""):
            by_start.setdefault(score.start or "all", []).append(score.total)
        report.write_distribution_plot(path, title, by_policy, by_start)


def write(evaluation: Evaluation, directory: Path, command: str) -> Evaluation:
    """Writes result.json, report.html and returns.png; returns the evaluation with their names.

    Raises:
      OSError: a file cannot be written.
    """
    result, page, picture = (directory / name for name in (RESULT, PAGE, PICTURE))
    content = evaluation.as_json()
    write_whole(result, in_lines(content))
    report.write_evaluation_page(page, content, command)
    files = (result, page)
    try:
        evaluation.draw(picture)
    except ImportError as error:
        picture.unlink(missing_ok=True)  # of an earlier call
        return dataclasses.replace(evaluation, files=files, left_out=f"no {PICTURE}: {error}")
    return dataclasses.replace(evaluation, files=(*files, picture))


def _entry(score: Score) -> dict[str, object]:
    """An episode as `limberjack run` writes it, with its final reward and success."""
    entry: dict[str, object] = {"seed": score.seed, "return": score.total, "length": score.length}
    if score.start is not None:
        entry["start"] = score.start
    entry |= {"final_reward": score.final_reward, "success": score.success}
    if score.processor is not None:
        entry["processor"] = score.processor
    return {**entry, "diverged": True} if score.diverged else entry


def _processors(scores: list[Score]) -> dict[str, object]:
    """The processors of episodes, where they were recorded."""
    processors = [score.processor for score in scores]
    return {"processors": processors} if any(processors) else {}
