"""Texts that are written to files."""

from limberjack.utils.texts import encodable


def test_a_name_that_is_no_text_is_escaped_and_any_other_is_kept() -> None:
    assert encodable("walk-\udcff.zip, \ud800") == "walk-\\udcff.zip, \\ud800"
    for name in ("walk.zip", "größe \N{GRINNING FACE}", "a\\udcff", ""):
        assert encodable(name) == name
