"""Parts that the pages of a run and of an evaluation share: the frame, figures, tables and facts.

    body = header("humanoid walk", "Policy random") + figures([("Episodes", "3")])
    write_document(Path("report.html"), "humanoid walk", body, result)

A document loads nothing from anywhere: no fonts, scripts or pictures. Arguments are plain text,
which is escaped here, unless they are called HTML.
"""

import html
import json
import string
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from limberjack.utils.facts import Facts
from limberjack.utils.files import write_whole
from limberjack.utils.texts import encodable

__all__ = [
    "card",
    "cards",
    "episode_table",
    "facts_of",
    "figures",
    "header",
    "section",
    "subtitle",
    "table",
    "write_document",
]

_Entry = TypeVar("_Entry", bound=Mapping[str, object])

_TEMPLATE = Path(__file__).with_name("page.html")

_FINGERPRINT = (
    "SHA-256 of all names and numbers of the compiled model. Two results with the same fingerprint "
    "were computed on the same model, bit for bit. Compare the returns of results only where "
    "fingerprints and MuJoCo's versions agree."
)


def write_document(path: Path, title: str, body: str, result: Mapping[str, object]) -> None:
    """Writes a document whole, or leaves the one that is there.

    Args:
      path: the file.
      title: of the browser's tab.
      body: HTML.
      result: the contents of result.json, which the document includes.

    Raises:
      OSError: it cannot be written.
    """
    parts = {
        "title": html.escape(title),
        "body": body,
        "result": json.dumps(result, allow_nan=False).replace("<", "\\u003c"),
    }
    template = string.Template(_TEMPLATE.read_text(encoding="utf-8"))
    write_whole(path, encodable(template.substitute(parts)))


def header(heading: str, subtitle: str) -> str:
    """The heading and a line about it."""
    return (
        f'<header>\n<h1>{html.escape(heading)}</h1>\n<p class="quiet">{html.escape(subtitle)}</p>\n'
        "</header>\n"
    )


def subtitle(result: Facts) -> str:
    """The policy, the time from action to action, and the time limit."""
    interval = result["control_timestep"] * result.get("action_repeat", 1)
    text = f"Policy {result['policy']}, an action every {interval:g} s"
    limit = result["time_limit"]
    return text if limit is None else f"{text}, episodes of {limit:g} s"


def section(heading: str, content: str) -> str:
    """A heading above HTML."""
    return f"<section>\n<h2>{html.escape(heading)}</h2>\n{content}</section>\n"


def card(content: str, kind: str = "") -> str:
    """HTML in a frame, of a class of page.html besides 'card'."""
    return f'<div class="{f"card {kind}".strip()}">\n{content}</div>\n'


def cards(contents: Iterable[str]) -> str:
    """Pieces of HTML side by side, two in a row where the window is wide enough."""
    return f'<div class="pair">\n{"".join(contents)}</div>\n'


def figures(numbers: Iterable[tuple[str, str]]) -> str:
    """Numbers with their names, large."""
    entries = (
        f'<div class="card"><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>\n'
        for name, value in numbers
    )
    return f'<dl class="figures">\n{"".join(entries)}</dl>\n'


def table(name: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table that scrolls; the first cell of a row is its heading.

    A column whose name ends in '<' holds words, which are aligned to the left.
    """
    words = [column.endswith("<") for column in columns]
    style = [' class="word"' if is_word else "" for is_word in words]
    heads = (
        f'<th scope="col"{look}>{html.escape(column.removesuffix("<"))}</th>'
        for column, look in zip(columns, style, strict=True)
    )
    lines = []
    for first, *others in rows:
        cells = (
            f"<td{look}>{html.escape(cell)}</td>"
            for cell, look in zip(others, style[1:], strict=True)
        )
        lines.append(
            f'<tr><th scope="row"{style[0]}>{html.escape(first)}</th>{"".join(cells)}</tr>\n'
        )
    return (
        f'<div class="card scroll" tabindex="0" role="region" aria-label="{html.escape(name)}">\n'
        f"<table><thead><tr>{''.join(heads)}</tr></thead>\n"
        f"<tbody>{''.join(lines)}</tbody></table>\n"
        "</div>\n"
    )


def episode_table(
    episodes: Sequence[_Entry], columns: Sequence[str], cells: Callable[[_Entry], Sequence[str]]
) -> str:
    """A row for each episode: its seed, the kind of start if there are any, and more.

    Args:
      episodes: have 'seed' and, where the task has kinds of starts, 'start'.
      columns: those after the first ones.
      cells: of an episode in these columns.
    """
    starts = ["Start<"] if any("start" in entry for entry in episodes) else []
    rows = (
        [str(entry["seed"]), *(str(entry.get("start", "")) for _ in starts), *cells(entry)]
        for entry in episodes
    )
    return table("Episodes", ["Seed", *starts, *columns], rows)


def facts_of(result: Facts, command: str, others: Iterable[tuple[str, str]] = ()) -> str:
    """The command that was typed, what the numbers depend on, and the model's fingerprint.

    Args:
      result: has 'versions' and 'fingerprint'.
      command: the empty string where none was typed.
      others: more facts, by name.
    """
    entries = [("Command", f"<code>{html.escape(command)}</code>")] if command else []
    entries += [(html.escape(name), html.escape(value)) for name, value in others]
    if result.get("world"):
        world = html.escape(json.dumps(result["world"]))
        entries.append(("World", f"<code>{world}</code>"))
    entries += [(name, html.escape(version)) for name, version in result["versions"].items()]
    fingerprint = html.escape(result["fingerprint"])
    entries.append(
        ("Model", f'<code>{fingerprint}</code><p class="quiet">{html.escape(_FINGERPRINT)}</p>')
    )
    lines = "".join(f"<dt>{name}</dt><dd>{value}</dd>\n" for name, value in entries)
    return card(f'<dl class="facts">\n{lines}</dl>\n')
