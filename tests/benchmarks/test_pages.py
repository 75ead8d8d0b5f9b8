"""Sections of pages are replaced between their marks."""

from pathlib import Path

import pages
import pytest


def test_a_section_is_replaced_and_the_rest_stays(tmp_path: Path) -> None:
    page, name = tmp_path / "page.md", ("speed", "speed.py")
    text = "# Speed\n\n<!-- speed: written by benchmarks/speed.py -->\n{}<!-- end -->\n\nMore.\n"
    page.write_text(text.format("old\n"))
    assert pages.section_of(page, *name) == "old\n"
    made = "\n".join([*pages.table(["task", "mean"], [["walk", "1"], ["run", "2"]]), ""])
    pages.write_section(page, *name, made)
    table = "| task | mean |\n|---|---|\n| walk | 1 |\n| run | 2 |\n"
    assert page.read_text() == text.format(table)


def test_a_page_without_the_marks_is_refused_and_stays(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- speed: written by benchmarks/speed.py -->\nold\n")
    for name in ("speed", "memory"):
        with pytest.raises(ValueError, match=r"page\.md has no section between <!-- \w+: written"):
            pages.write_section(page, name, "speed.py", "new")
    assert "old" in page.read_text()
