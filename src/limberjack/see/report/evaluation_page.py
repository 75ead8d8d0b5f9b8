"""report.html of an evaluation: a policy beside zero and random actions, on one page.

    write_evaluation_page(Path("scores/report.html"), result)

It shows what result.json holds: the summary of each policy and kind of start, the distribution of
returns, and every episode. Of more than 10,000 episodes it shows a sample, and quantiles of all, so
that it stays below five megabytes. There is no film, as the episodes were played in batches.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NotRequired, TypedDict

import numpy as np

from limberjack.see.report import parts
from limberjack.see.report.chart import line_chart, steps_of
from limberjack.utils.facts import Facts, title_of

__all__ = ["EvaluationResult", "write_evaluation_page"]

_MOST = 10_000  # episodes that a page lists, in up to 400 bytes each
_SAMPLE = 1_000  # episodes that it lists of more
_QUANTILES = (0, 1, 5, 25, 50, 75, 95, 99, 100)  # percent

_ACROSS = "over the share of episodes with less in percent"

_Entry = TypedDict(
    "_Entry",
    {
        "seed": int,
        "return": float,
        "length": int,
        "start": NotRequired[str],  # its kind, if the task has several
        "final_reward": float,
        "success": bool,
        "diverged": NotRequired[bool],
    },
)


class _Summary(TypedDict):
    """Statistics of the returns of some episodes; of a policy, those by kind of start too."""

    episodes: int
    mean: float
    interval: Sequence[float] | None
    median: float
    success_rate: float
    diverged: int
    strata: NotRequired[Mapping[str, "_Summary"]]


class _Success(TypedDict):
    last_steps: int
    mean_reward_at_least: float


class _Interval(TypedDict):
    confidence: float
    method: str
    resamples: int


class EvaluationResult(Facts):
    """The contents of the result.json of an evaluation; of its entries those that are shown."""

    seeds: str | Sequence[int]
    success: _Success
    interval: _Interval
    summary: Mapping[str, _Summary]  # by policy
    episodes: Sequence[_Entry]  # of the evaluated policy
    floors: Mapping[str, Mapping[str, Sequence[float]]]  # by policy: 'returns'
    versions_of_episodes: NotRequired[Sequence[Mapping[str, str]]]


def write_evaluation_page(path: Path, result: EvaluationResult, command: str = "") -> None:
    """Writes the page whole, or leaves the one that is there.

    Args:
      path: the file.
      result: the contents of result.json, as `Evaluation.as_json` gives them.
      command: as it was typed; the empty string if it is not known.

    Raises:
      OSError: it cannot be written.
    """
    name = title_of(result)
    policy, whole = result["policy"], len(result["episodes"])
    heading, shown = f"Episodes of {policy}", result
    if whole > _MOST:
        heading, shown = f"{heading}: {_SAMPLE:,} of {whole:,}", _sampled(result)
    body = [
        parts.header(name, parts.subtitle(result)),
        parts.figures(_figures(result["summary"][policy], result)),
        parts.section("Policies on the same seeds", _summaries(result["summary"])),
        f'<p class="quiet">{_explained(result)}</p>\n',
        parts.section("Returns", parts.cards(_charts(result))),
        *([parts.section("Quantiles of returns", _quantiles(result))] if whole > _MOST else []),
        parts.cards(
            [
                parts.section(heading, _episodes(shown["episodes"])),
                parts.section("To run it again", parts.facts_of(result, command, _facts(shown))),
            ]
        ),
    ]
    parts.write_document(path, f"{name}, policy {policy}, evaluation", "\n".join(body), shown)


def _sampled(result: EvaluationResult) -> EvaluationResult:
    """A result with some episodes, equally far from each other in the order of the seeds."""
    episodes, seeds = result["episodes"], result["seeds"]
    chosen = np.linspace(0, len(episodes) - 1, _SAMPLE).astype(int).tolist()
    if not isinstance(seeds, str):
        seeds = f"{len(seeds):,} seeds from {min(seeds)} to {max(seeds)}, as in result.json"
    sample = [episodes[number] for number in chosen]
    return {**result, "seeds": seeds, "episodes": sample, "floors": {}}


def _quantiles(result: EvaluationResult) -> str:
    """A row of quantiles for each policy, and for each kind of start of the evaluated one."""
    rows = [
        [name, *(f"{value:.3f}" for value in np.percentile(returns, _QUANTILES))]
        for name, returns in {**_returns(result), **_returns_by_start(result)}.items()
    ]
    return parts.table("Quantiles", ["Policy<", *(f"{one} %" for one in _QUANTILES)], rows)


def _figures(summary: _Summary, result: EvaluationResult) -> Iterator[tuple[str, str]]:
    """The numbers that a reader looks for first."""
    yield "Episodes", str(summary["episodes"])
    yield "Mean return", f"{summary['mean']:.1f}"
    if summary["interval"] is not None:
        share = 100 * result["interval"]["confidence"]
        yield f"{share:g} % interval of the mean", _interval(summary)
    yield "Median return", f"{summary['median']:.1f}"
    yield "Success", f"{100 * summary['success_rate']:.1f} %"
    if summary["diverged"]:
        yield "Diverged", str(summary["diverged"])


def _summaries(summaries: Mapping[str, _Summary]) -> str:
    """A row for each policy, and for each kind of start."""
    rows = []
    for policy, summary in summaries.items():
        strata = summary.get("strata", {})
        rows.append(_row(policy, "all" if strata else "", summary))
        rows += [_row("", start, part) for start, part in strata.items()]
    columns = ["Policy<", "Start<", "Episodes", "Mean return", "Interval", "Median", "Success"]
    return parts.table("Policies", columns, rows)


def _row(policy: str, start: str, summary: _Summary) -> list[str]:
    return [
        policy,
        start,
        str(summary["episodes"]),
        f"{summary['mean']:.1f}",
        _interval(summary),
        f"{summary['median']:.1f}",
        f"{100 * summary['success_rate']:.1f} %",
    ]


def _interval(summary: _Summary) -> str:
    return "" if summary["interval"] is None else "{:.1f} to {:.1f}".format(*summary["interval"])


def _explained(result: EvaluationResult) -> str:
    success, interval = result["success"], result["interval"]
    return (
        f"Success: a mean reward of at least {success['mean_reward_at_least']} over the last "
        f"{success['last_steps']} steps. Interval: of the mean, "
        f"{100 * interval['confidence']:g} %, by {interval['method']} with "
        f"{interval['resamples']:,} resamples."
    )


def _charts(result: EvaluationResult) -> Iterator[str]:
    """The returns of each policy, and those of the evaluated one by kind of start."""
    yield _distribution(f"Returns by policy, {_ACROSS}", _returns(result))
    by_start = _returns_by_start(result)
    if by_start:
        yield _distribution(f"Returns of {result['policy']} by start, {_ACROSS}", by_start)


def _returns(result: EvaluationResult) -> dict[str, Sequence[float]]:
    """The returns of each policy."""
    floors = {name: floor["returns"] for name, floor in result["floors"].items()}
    return {result["policy"]: [entry["return"] for entry in result["episodes"]], **floors}


def _returns_by_start(result: EvaluationResult) -> dict[str, list[float]]:
    """The returns of the evaluated policy by kind of start; empty unless there are several."""
    found: dict[str, list[float]] = {}
    for entry in sorted(result["episodes"], key=lambda entry: entry.get("start", "")):
        found.setdefault(entry.get("start", ""), []).append(entry["return"])
    return found if len(found) > 1 else {}


def _distribution(title: str, returns: Mapping[str, Sequence[float]]) -> str:
    lines = [steps_of(f"{name} ({len(values)})", values) for name, values in returns.items()]
    ends = np.array([0.0, 100.0])
    return parts.card(line_chart(title, ends, lines, low=0.0, axis="percent"), "tall")


def _episodes(episodes: Sequence[_Entry]) -> str:
    def cells(entry: _Entry) -> list[str]:
        return [
            f"{entry['return']:.3f}",
            str(entry["length"]),
            f"{entry['final_reward']:.3f}",
            "diverged" if entry.get("diverged") else "yes" if entry["success"] else "no",
        ]

    columns = ["Return", "Steps", "Last reward", "Success"]
    return parts.episode_table(episodes, columns, cells)


def _facts(result: EvaluationResult) -> Iterator[tuple[str, str]]:
    seeds = result["seeds"]
    yield "Seeds", seeds if isinstance(seeds, str) else ", ".join(map(str, seeds))
    if result.get("policy_sha256"):
        yield "Policy", f"SHA-256 {result['policy_sha256']}"
    others = result.get("versions_of_episodes")
    if others:
        versions = "; ".join(", ".join(f"{k} {v}" for k, v in each.items()) for each in others)
        yield "Played with", versions
