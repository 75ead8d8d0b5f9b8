"""report.html of a run: everything on one page, with the film in it, for any browser.

    write_page(Path("out/report.html"), result, episodes, trace, film=Path("out/video.mp4"))

It shows the first episode in full (film, reward, observations, actions, and plans where there are
any) and the rewards and returns of all of them. The page loads nothing from anywhere, so it may be
sent by mail. Its style is in `page.html`; the charts are from `chart`.
"""

import base64
import html
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from limberjack.see.report import parts
from limberjack.see.report.chart import Line, line_chart, steps_of
from limberjack.see.report.labels import Label
from limberjack.see.report.result import Entry, Played, Result
from limberjack.see.report.trace import Trace
from limberjack.utils.facts import title_of

__all__ = ["write_page"]

_ABOUT_CONTROLS = "in brackets the force or torque of 1"


def write_page(
    path: Path,
    result: Result,
    episodes: Sequence[Played],
    trace: Trace,
    film: Path | None,
    no_film: str = "",
    command: str = "",
) -> None:
    """Writes the page whole, or leaves the one that is there.

    Args:
      path: the file.
      result: the contents of result.json.
      episodes: those of the result, at least one.
      trace: of the first episode.
      film: of the first episode; None without one.
      no_film: the reason why there is none.
      command: as it was typed; the empty string if it is not known.

    Raises:
      OSError: the film cannot be read, or the page cannot be written.
    """
    name = title_of(result)
    seen = "".join(_observation_charts(trace)) + "".join(_action_charts(trace))
    body = [
        parts.header(name, _subtitle(result)),
        parts.figures(_figures(result)),
        parts.section(
            f"The first episode, seed {result['episodes'][0]['seed']}",
            parts.cards([_video(film, no_film, name), _reward_chart(trace)]),
        ),
        parts.section(
            "Observations and actions of the first episode, over seconds",
            f'<div class="pair">\n{seen}</div>\n',
        ),
    ]
    if trace.plan_terms:
        plans = parts.cards(_plan_parts(trace))
        body.append(parts.section("Plans of the first episode", plans))
    if len(episodes) > 1:
        charts = parts.cards(_charts_of_all(episodes, result["control_timestep"]))
        body.append(parts.section("All episodes", charts))
    body.append(
        parts.cards(
            [
                parts.section("Episodes", _episode_table(result["episodes"])),
                parts.section("To run it again", parts.facts_of(result, command)),
            ]
        )
    )
    parts.write_document(path, f"{name}, policy {result['policy']}", "\n".join(body), result)


def _subtitle(result: Result) -> str:
    done, asked = len(result["episodes"]), result["episodes_asked_for"]
    text = parts.subtitle(result)
    return text if done == asked else f"{text}; cut short after {done} of {asked} episodes"


def _figures(result: Result) -> Iterator[tuple[str, str]]:
    """The numbers that a reader looks for first."""
    episodes = result["episodes"]
    returns = [entry["return"] for entry in episodes if entry["return"] is not None]
    steps = sum(entry["length"] for entry in episodes)
    yield "Episodes", str(len(episodes))
    yield "Steps", f"{steps:,}"
    if len(returns) > 1:
        yield "Mean return", f"{np.mean(returns):.3f}"
        yield "Standard deviation", f"{np.std(returns, ddof=1):.3f}"
        yield "Least and greatest", f"{min(returns):.4g} to {max(returns):.4g}"
    else:
        yield "Return", _number(episodes[0]["return"])
    counted = sum(entry["length"] for entry in episodes if entry["return"] is not None)
    mean = sum(returns) / counted if counted else math.nan
    yield "Mean reward", f"{mean:.4f}"


def _video(film: Path | None, no_film: str, name: str) -> str:
    if film is None:
        return parts.card(f'<p class="quiet">There is no video: {html.escape(no_film)}</p>\n')
    content = base64.b64encode(film.read_bytes()).decode()
    return parts.card(
        f'<video src="data:video/mp4;base64,{content}" controls loop muted playsinline '
        f'preload="auto" aria-label="{html.escape(name)}, the first episode"></video>\n'
        '<p class="quiet">Play it, or click into a chart: all of them show the same moment. Point '
        "at a name below a chart to see its line alone.</p>\n"
    )


def _reward_chart(trace: Trace) -> str:
    lines = [Line("reward", trace.rewards)]
    lines += [Line(name, values) for name, values in trace.terms.items()]
    # Rewards of the suite, and their terms, lie between 0 and 1.
    chart = line_chart("Reward and its terms over seconds", trace.seconds, lines, low=0.0, high=1.0)
    return parts.card(chart, "tall")


def _plan_parts(trace: Trace) -> Iterator[str]:
    """The weighted terms of the plans' cost, and the stages."""
    lines = [Line(name, values) for name, values in trace.plan_terms.items()]
    chart = line_chart("Weighted terms of the plans' cost, over seconds", trace.seconds, lines)
    yield parts.card(chart, "tall")
    if trace.stages:
        rows = ([f"{second:.2f}", stage] for second, stage in trace.stages)
        yield parts.table("Stages", ["From second", "Stage<"], rows)


def _observation_charts(trace: Trace) -> Iterator[str]:
    for name, values in trace.observations.items():
        if values.shape[1]:
            labels = trace.labels.observations.get(name, ())
            yield _labelled_chart(name, trace.seconds, values, labels)
    for name, size in trace.too_large.items():
        text = f"{name}, {size:,} numbers, is too large for a chart"
        yield parts.card(f'<p class="quiet">{html.escape(text)}</p>\n')


def _action_charts(trace: Trace) -> Iterator[str]:
    if trace.actions.shape[1]:
        labels = trace.labels.actions
        name = f"action, {_ABOUT_CONTROLS}" if any(label.unit for label in labels) else "action"
        yield _labelled_chart(name, trace.seconds, trace.actions, labels, has_own_units=True)


def _labelled_chart(
    name: str,
    seconds: np.ndarray,
    values: np.ndarray,
    labels: Sequence[Label],
    has_own_units: bool = False,
) -> str:
    """A chart of the numbers of an observation or action.

    Args:
      name: of the quantity.
      seconds: (n,).
      values: (n, size).
      labels: one for each number; none if they are not known.
      has_own_units: write a unit beside each line, else beside the title if they are all equal.
    """
    size = values.shape[1]
    title = f"{name}, one number" if size == 1 else f"{name}, {size} numbers"
    if len(labels) != size:
        labels = [Label(name if size == 1 else str(i)) for i in range(size)]
    units = {label.unit for label in labels}
    if len(units) == 1 and not has_own_units:
        (unit,) = units
        title += f", {unit}" if unit else ""
        labels = [Label(label.name) for label in labels]
    lines = [Line(str(label), values[:, i]) for i, label in enumerate(labels)]
    return parts.card(line_chart(title, seconds, lines))


def _charts_of_all(episodes: Sequence[Played], control_timestep: float) -> Iterator[str]:
    """Rewards, returns so far, and returns in order of size, of all episodes."""
    steps = max(episode.length for episode in episodes)
    seconds = control_timestep * np.arange(steps + 1)
    rewards, returns = [], []
    for episode in episodes:
        # The reward of a step is earned when the step ends.
        after = np.full(steps - episode.length, np.nan)
        name = f"seed {episode.seed}: {_number(episode.total)}"
        rewards.append(Line(name, np.concatenate([[np.nan], episode.rewards, after])))
        returns.append(Line(name, np.concatenate([[0.0], episode.returns, after])))
    yield parts.card(line_chart("Return so far, over seconds", seconds, returns))
    yield parts.card(line_chart("Reward, over seconds", seconds, rewards, low=0.0, high=1.0))
    totals = [episode.total for episode in episodes if math.isfinite(episode.total)]
    if len(totals) > 1:
        title = "Returns in order of size, over the share of episodes with less in percent"
        line = steps_of("return", totals)
        yield parts.card(line_chart(title, np.array([0.0, 100.0]), [line], axis="percent"))


def _episode_table(episodes: Sequence[Entry]) -> str:
    def cells(entry: Entry) -> list[str]:
        return [_number(entry["return"]), str(entry["length"])]

    return parts.episode_table(episodes, ["Return", "Steps"], cells)


def _number(value: float | None) -> str:
    """A return as the command line prints it."""
    return "not a number" if value is None or math.isnan(value) else f"{value:.3f}"
