"""The command line as it was typed."""

import sys

import pytest

from limberjack.cli.typed import command_line


def test_the_command_is_quoted_for_a_shell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/usr/bin/limberjack", "run", "humanoid", "--out", "a b"])
    assert command_line() == "limberjack run humanoid --out 'a b'"


def test_bytes_that_are_no_text_can_be_written_to_a_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["limberjack", "run", "--out", "a\udcff"])
    assert command_line() == "limberjack run --out 'a\N{REPLACEMENT CHARACTER}'"
