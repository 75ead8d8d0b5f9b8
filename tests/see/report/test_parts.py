"""Parts of pages: text is escaped, tables and facts are complete."""

from pathlib import Path
from typing import cast

import pytest

from limberjack.see.report import parts
from limberjack.utils.facts import Facts

_RESULT = cast(Facts, {"versions": {"mujoco": "4.0.0"}, "fingerprint": "abc"})
_HOSTILE = "<b>&\"'"
_TEXT = "&lt;b&gt;&amp;&quot;&#x27;"


def test_text_is_escaped_wherever_it_is_given() -> None:
    pieces = [
        parts.header(_HOSTILE, _HOSTILE),
        parts.section(_HOSTILE, ""),
        parts.figures([(_HOSTILE, _HOSTILE)]),
        parts.table(_HOSTILE, [_HOSTILE], [[_HOSTILE]]),
        parts.facts_of(_RESULT, _HOSTILE, [(_HOSTILE, _HOSTILE)]),
    ]
    for piece in pieces:
        assert _TEXT in piece
        assert "<b>" not in piece


def test_a_table_aligns_words_to_the_left_and_heads_its_rows() -> None:
    table = parts.table("x", ["Seed", "Start<"], [["4", "in_hand"]])
    assert '<th scope="col">Seed</th><th scope="col" class="word">Start</th>' in table
    assert '<tr><th scope="row">4</th><td class="word">in_hand</td></tr>' in table
    with pytest.raises(ValueError, match="zip"):
        parts.table("x", ["Seed", "Start<"], [["4"]])


def test_without_a_command_none_is_shown() -> None:
    assert "Command" in parts.facts_of(_RESULT, "limberjack list")
    assert "Command" not in parts.facts_of(_RESULT, "")


def test_the_document_has_the_result_as_data(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    parts.write_document(path, _HOSTILE, "<p>body</p>", {"policy": "</script>"})
    text = path.read_text(encoding="utf-8")
    assert f"<title>{_TEXT}</title>" in text
    assert "<main>\n<p>body</p></main>" in text
    assert '{"policy": "\\u003c/script>"}' in text
    assert "$" not in text
