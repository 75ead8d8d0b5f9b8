"""The prose of the source follows the style: how docstrings begin, and words that are avoided."""

import ast
import io
import re
import tokenize
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

from .source import REPOSITORY, modules

_BEGINNING = re.compile(r"(What|Who|How|Where|When|As for)\b")
_AVOIDED = re.compile(r"\b(till|anew|in\s+vain|is\s+said\s+of)\b", re.IGNORECASE)
_DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def _bad_docstrings(source: str) -> Iterator[str]:
    """The first line of each docstring that begins with one of the words to avoid there."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, _DOCUMENTED):
            docstring = ast.get_docstring(node) or ""
            if _BEGINNING.match(docstring):
                yield docstring.splitlines()[0]


def _prose(source: str) -> Iterator[str]:
    """All comments and texts, docstrings included."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def _bad_words(source: str) -> list[str]:
    return [match[0] for text in _prose(source) for match in _AVOIDED.finditer(text)]


def _found(search: Callable[[str], Iterable[str]], files: Iterable[Path]) -> dict[str, list[str]]:
    """The findings of a search in each file that has any."""
    found = {str(file): list(search(file.read_text(encoding="utf-8"))) for file in files}
    return {file: findings for file, findings in found.items() if findings}


def test_docstrings_begin_with_a_noun_phrase_or_a_verb() -> None:
    assert not _found(_bad_docstrings, modules().values())


def test_texts_and_comments_use_current_words() -> None:
    assert not _found(_bad_words, modules().values())


@pytest.mark.parametrize("folder", ["benchmarks", "tests", "tools"])
def test_docstrings_outside_the_package_begin_so_too(folder: str) -> None:
    planner = REPOSITORY / "tests" / "planner"  # as above
    files = [file for file in (REPOSITORY / folder).rglob("*.py") if planner not in file.parents]
    assert not _found(_bad_docstrings, files)


def test_the_search_finds_what_it_looks_for() -> None:
    source = (
        '"""Where it is."""\n\n\ndef f(x):\n    """How far."""\n    # not in\n    return "Till"\n'
    )
    assert list(_bad_docstrings(source)) == ["Where it is.", "How far."]
    assert _bad_words(source) == ["Till"]
    assert _bad_words('x = f"{1} begins anew"  # in vain') == ["in vain", "anew"]
    assert not list(_bad_docstrings('"""Whatever works, until `howto` is written."""'))
