"""report.html: a run on one page, with its film within it, for anybody with a browser.

    write_page(Path("out/report.html"), result, trace, film=Path("out/video.mp4"))

The page loads nothing from anywhere: no fonts, no scripts, no pictures. It may be sent by mail. How
it looks is in `page.html`; the charts are from `chart`.
"""

import base64
import html
import json
import math
import shlex
import string
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from limberjack.report.chart import Line, line_chart
from limberjack.report.result import Facts
from limberjack.report.trace import Trace
from limberjack.utils.files import replacing

__all__ = ["write_page"]

_TEMPLATE = Path(__file__).with_name("page.html")


def write_page(
    path: Path,
    result: Facts,
    trace: Trace,
    film: Path | None,
    no_film: str = "",
) -> None:
    """Writes the page whole, or leaves the one that is there.

    Args:
      path: the file.
      result: what result.json holds, with at least one episode.
      trace: of the first episode.
      film: of the first episode; None without one.
      no_film: why there is none.

    Raises:
      OSError: the film cannot be read, or the page cannot be written.
    """
    name = f"{result['domain']} {result['task']}"
    parts = {
        "title": f"{name}, policy {result['policy']}",
        "heading": name,
        "subtitle": _subtitle(result),
        "seed": str(result["episodes"][0]["seed"]),
    }
    parts = {key: html.escape(text) for key, text in parts.items()} | {
        "figures": _figures(result),
        "video": _video(film, no_film, name),
        "reward": _reward_chart(trace),
        "observations": "".join(_observation_charts(trace)),
        "episodes": _episode_table(result["episodes"]),
        "facts": _facts(result),
        "result": json.dumps(result, allow_nan=False).replace("<", "\\u003c"),
    }
    template = string.Template(_TEMPLATE.read_text(encoding="utf-8"))
    with replacing(path) as partial:
        partial.write_text(template.substitute(parts), encoding="utf-8")


def _subtitle(result: Facts) -> str:
    done, asked = len(result["episodes"]), result["episodes_asked_for"]
    text = f"Policy {result['policy']}, an action every {result['control_timestep']:g} s"
    if result["time_limit"] is not None:
        text += f", episodes of {result['time_limit']:g} s"
    return text if done == asked else f"{text}; cut short after {done} of {asked} episodes"


def _figures(result: Facts) -> str:
    """The numbers that are looked for first."""
    episodes = result["episodes"]
    returns = [entry["return"] for entry in episodes if entry["return"] is not None]
    steps = sum(entry["length"] for entry in episodes)
    figures = [("Episodes", str(len(episodes))), ("Steps", f"{steps:,}")]
    if len(returns) > 1:
        figures.append(("Mean return", f"{np.mean(returns):.3f}"))
        figures.append(("Standard deviation", f"{np.std(returns, ddof=1):.3f}"))
        figures.append(("Least and greatest", f"{min(returns):.4g} to {max(returns):.4g}"))
    else:
        figures.append(("Return", _number(episodes[0]["return"])))
    mean = sum(returns) / steps if returns else math.nan
    figures.append(("Mean reward", f"{mean:.4f}"))
    return "".join(f'<div class="card"><dt>{k}</dt><dd>{v}</dd></div>\n' for k, v in figures)


def _video(film: Path | None, no_film: str, name: str) -> str:
    if film is None:
        return f'<p class="quiet">There is no video: {html.escape(no_film)}</p>\n'
    content = base64.b64encode(film.read_bytes()).decode()
    return (
        f'<video src="data:video/mp4;base64,{content}" controls loop muted playsinline '
        f'preload="auto" aria-label="{html.escape(name)}, the first episode"></video>\n'
        '<p class="quiet">Play it, or click into a chart: all of them show the same moment.</p>\n'
    )


def _reward_chart(trace: Trace) -> str:
    lines = [Line("reward", trace.rewards)]
    lines += [Line(name, values) for name, values in trace.terms.items()]
    # Rewards of the suite, and what they are made of, lie between 0 and 1.
    return line_chart("Reward and its terms over seconds", trace.seconds, lines, low=0.0, high=1.0)


def _observation_charts(trace: Trace) -> Iterable[str]:
    for name, values in trace.observations.items():
        size = values.shape[1]
        lines = [Line(str(number), values[:, number]) for number in range(size)]
        if size == 1:
            lines = [Line(name, values[:, 0])]
        count = "one number" if size == 1 else f"{size} numbers"
        if size:
            chart = line_chart(f"{name}, {count}", trace.seconds, lines)
            yield f'<div class="card">\n{chart}</div>\n'


def _episode_table(episodes: Sequence[Facts]) -> str:
    has_start = any("start" in entry for entry in episodes)
    start = '<th scope="col" class="word">Start</th>' if has_start else ""
    rows = []
    for entry in episodes:
        kind = f'<td class="word">{html.escape(entry.get("start", ""))}</td>' if has_start else ""
        rows.append(
            f'<tr><th scope="row">{entry["seed"]}</th>{kind}<td>{_number(entry["return"])}</td>'
            f"<td>{entry['length']}</td></tr>\n"
        )
    return (
        f'<table><thead><tr><th scope="col">Seed</th>{start}<th scope="col">Return</th>'
        f'<th scope="col">Steps</th></tr></thead>\n<tbody>{"".join(rows)}</tbody></table>\n'
    )


def _facts(result: Facts) -> str:
    """The command that gives this again, and what its numbers depend on."""
    episodes = result["episodes"]
    words = ["limberjack", "run", result["domain"], result["task"], "--policy", result["policy"]]
    words += ["--seed", str(episodes[0]["seed"]), "--episodes", str(result["episodes_asked_for"])]
    if result["time_limit"] is not None:
        words += ["--time-limit", f"{result['time_limit']:.12g}"]
    facts = {"Command": f"<code>{html.escape(shlex.join(words))}</code>"}
    facts |= {name: html.escape(version) for name, version in result["versions"].items()}
    facts["Model"] = f"<code>{html.escape(result['fingerprint'])}</code>"
    return "".join(f"<dt>{name}</dt><dd>{value}</dd>\n" for name, value in facts.items())


def _number(value: float | None) -> str:
    """A return as the command line prints it."""
    return "not a number" if value is None else f"{value:.3f}"
