"""Tracked files are clean text, and there are no lock files."""

import ast
import collections
import itertools
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import LONGEST

from .source import REPOSITORY, SOURCE, modules

_TEXT = {".md", ".py", ".toml", ".txt", ".xml", ".cfg", ".yml", ""}
_LOCK_FILES = re.compile(r"(uv|poetry|yarn)\.lock$|pylock.*\.toml$|package-lock\.json$")
_REGISTRY = re.compile(r"https?://[^ \"]*/(simple|packages)/")


def _tracked() -> list[Path]:
    git = shutil.which("git")
    if git is None or not (REPOSITORY / ".git").exists():
        pytest.skip("not a git checkout")
    listed = subprocess.run(
        [git, "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=REPOSITORY,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    paths = [REPOSITORY / name for name in listed.split("\0") if name]
    return [path for path in paths if path.is_file()]


def test_files_end_in_one_newline_and_have_no_trailing_blanks() -> None:
    for path in _tracked():
        if path.suffix not in _TEXT:
            continue
        text = path.read_text(encoding="utf-8")
        if not text:
            continue
        assert text.endswith("\n"), path
        assert not text.endswith("\n\n"), path
        assert not re.search(r"[ \t]+$", text, re.MULTILINE), path
        assert "\r" not in text, path


def test_no_lock_file_and_no_address_of_a_registry() -> None:
    for path in _tracked():
        assert not _LOCK_FILES.search(path.name), path
        if path.suffix in _TEXT:
            assert not _REGISTRY.search(path.read_text(encoding="utf-8")), path


def test_the_modules_of_tests_that_run_first_exist() -> None:
    assert [name for name in LONGEST if not (REPOSITORY / "tests" / name).is_file()] == []


def test_the_library_prints_nothing() -> None:
    # The command line prints; everything else logs to "limberjack" or returns.
    for path in SOURCE.rglob("*.py"):
        code = re.sub(r'"""(?:.|\n)*?"""', "", path.read_text(encoding="utf-8"))
        assert not re.search(r"^\s*print\(", code, re.MULTILINE), path


def _uses_of_any() -> Iterator[tuple[str, ast.stmt, list[str]]]:
    """Each use in a type: the module, the statement around it, and the module's lines."""
    for module, path in modules().items():
        text = path.read_text(encoding="utf-8")
        owner: dict[ast.AST, ast.stmt] = {}
        for node in ast.walk(ast.parse(text)):  # from the outside in
            for child in ast.iter_child_nodes(node):
                owner[child] = child if isinstance(child, ast.stmt) else owner[node]
            if isinstance(node, ast.Name) and node.id == "Any":
                yield module, owner[node], text.splitlines()


def _reason_for_any(statement: ast.stmt, lines: list[str]) -> str:
    """The comments in a statement or a function's head and above it, its docstring if it has Any.

    Aliases that follow one another share a comment.
    """
    first, last, doc = statement.lineno, statement.end_lineno or 0, ""
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
        first = min([first, *(decorator.lineno for decorator in statement.decorator_list)])
        last, doc = max(first, statement.body[0].lineno - 1), ast.get_docstring(statement) or ""
    above = itertools.takewhile(
        lambda line: re.match(r" *#|\w+ = Any$", line), reversed(lines[: first - 1])
    )
    comments = [line.partition("#")[2] for line in [*above, *lines[first - 1 : last]]]
    told = re.sub(r"\b(noqa|pyright|fmt|type): ?[\w\[\], ]*", "", " ".join(comments))
    return told + (doc if re.search(r"\bAny\b", doc) else "")


def test_any_is_rare_in_types() -> None:
    found = collections.Counter(module for module, _, _ in _uses_of_any())
    assert found.total() <= 150, found.most_common(10)


def test_each_any_has_a_reason() -> None:
    bare = [
        f"{module}:{statement.lineno}: {lines[statement.lineno - 1].strip()}"
        for module, statement, lines in _uses_of_any()
        if not re.search(r"[a-z]{2}", _reason_for_any(statement, lines))
    ]
    assert not bare, "\n".join(bare)
