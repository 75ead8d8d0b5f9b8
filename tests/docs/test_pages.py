"""The pages are right: their code runs, and their links, names and commands exist.

All ```python blocks of a page form one program; a comment after a `print` is its output. Those
that need PyTorch are part of it where PyTorch is installed.
"""

import importlib
import importlib.util
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from limberjack import suite
from limberjack.cli import app
from limberjack.suite import _entry_points as entry_points
from tests.warm import run

_REPOSITORY = Path(__file__).parents[2]
_DOCS = _REPOSITORY / "docs"
_PAGES = [*sorted(_DOCS.glob("*.md")), _REPOSITORY / "README.md", _REPOSITORY / "CONTRIBUTING.md"]

# Warp's library writes to standard error where there is no driver of NVIDIA.
_WITHOUT_DRIVER = "import os; os.dup2(os.open(os.devnull, os.O_WRONLY), 2)"

_FENCE = re.compile(r"^(```+)(\w*)\n(.*?)^\1$", re.MULTILINE | re.DOTALL)
_PRINTED = re.compile(r"^ *print\(.*\)  # (.*)$", re.MULTILINE)


def _page_name(page: Path) -> str:
    return str(page.relative_to(_REPOSITORY))


every_page = pytest.mark.parametrize("page", _PAGES, ids=_page_name)


def _program(page: Path, with_torch: bool = False) -> str:
    """The page's Python blocks, each line where it stands on the page."""
    text = page.read_text(encoding="utf-8")
    lines = [""] * text.count("\n")
    for block in _FENCE.finditer(text):
        if block[2] == "python" and (with_torch or "from torch." not in block[3]):
            start = text.count("\n", 0, block.start(3))
            code = block[3].splitlines()
            lines[start : start + len(code)] = code
    return "\n".join(lines)


@pytest.mark.parametrize(
    "page", [page for page in _PAGES if _program(page).strip()], ids=_page_name
)
def test_the_code_of_a_page_runs_and_prints_the_output_in_its_comments(page: Path) -> None:
    program = _program(page)
    if ".render(" in program and os.environ.get("MUJOCO_GL") == "disable":
        pytest.skip("MUJOCO_GL turns rendering off")
    if "gpu.load_vector" in program:
        pytest.importorskip("mujoco_warp", reason="needs the extra 'gpu'")
        program = _WITHOUT_DRIVER + program
    assert run(program).splitlines() == _PRINTED.findall(program)


def test_the_code_of_a_page_that_needs_torch_runs_with_the_rest_of_it() -> None:
    pages = [page for page in _PAGES if _program(page) != _program(page, with_torch=True)]
    assert pages
    pytest.importorskip("torch", reason="needs the extra 'torch'")
    for page in pages:
        program = _program(page, with_torch=True)
        # PyTorch warns where a loader has more workers than the machine has cores.
        output = run(program, warnings="ignore")
        assert output.splitlines() == _PRINTED.findall(program)


# Links, names and commands.


def _prose(page: Path) -> str:
    """The page without its fenced blocks."""
    return _FENCE.sub("", page.read_text(encoding="utf-8"))


def _anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives the page's headings."""
    headings = re.findall(r"^#+ +(.*)$", _prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@every_page
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", _prose(page)):
        if re.match(r"\w+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if target.stem in suite.TASKS_BY_DOMAIN and not anchor:
            continue  # a page that the site makes from the registry
        assert target.exists(), f"{_page_name(page)}: {link}"
        assert not anchor or anchor in _anchors(target), f"{_page_name(page)}: {link}"


@every_page
def test_a_page_uses_plain_words(page: Path) -> None:
    found = re.findall(r"\b(?:anew|till|in vain|is said of|are said of)\b", _prose(page))
    assert found == [], "write again, until, without success, is valid for"


_ID = re.compile(r"\blimberjack/(\w+-\w+)-v0\b")


def test_every_id_of_an_environment_is_registered() -> None:
    found = {name for page in _PAGES for name in _ID.findall(page.read_text(encoding="utf-8"))}
    assert len(found) > 10
    known = {f"{domain}-{task}" for domain, task in suite.ALL_TASKS}
    examples = {"DOMAIN-TASK", "swing-swing_up"}
    assert found - known - examples == set()


def test_every_page_is_in_the_index() -> None:
    index = (_DOCS / "README.md").read_text(encoding="utf-8")
    for page in _DOCS.glob("*.md"):
        assert page.name == "README.md" or f"({page.name}" in index, page.name


def _code(page: Path) -> Iterator[str]:
    """Spans and lines of code that are not Python."""
    yield from re.findall(r"`([^`\n]+)`", _prose(page))
    yield from re.findall(r"^ {4}(.*)$", _prose(page), re.MULTILINE)
    for block in _FENCE.finditer(page.read_text(encoding="utf-8")):
        if block[2] != "python":
            yield from block[3].splitlines()


@every_page
def test_every_name_and_path_of_the_project_exists(page: Path) -> None:
    for code in _code(page):
        if re.fullmatch(r"(src|tests|docs|examples)/[\w./-]*", code):
            assert (_REPOSITORY / code).exists(), f"{_page_name(page)}: {code}"
        elif re.fullmatch(r"limberjack(\.\w+)+", code) and code != entry_points.GROUP:
            assert _found(code), f"{_page_name(page)}: {code}"


def _found(name: str) -> bool:
    """Whether a dotted name is a module, also one that needs an extra, or an attribute of one."""
    parent, _, last = name.rpartition(".")
    try:
        if importlib.util.find_spec(name) is not None:
            return True
    except ImportError:  # the parent is no package, or needs an extra
        pass
    if not parent or not _found(parent):
        return False
    spec = importlib.util.find_spec(parent)
    if spec is None or spec.origin is None:
        return False
    # In the text, because the module may need an extra that is not installed here.
    defined = rf"^(class|def) {last}\b"
    if re.search(defined, Path(spec.origin).read_text(encoding="utf-8"), re.MULTILINE):
        return True
    return hasattr(importlib.import_module(parent), last)


@every_page
def test_every_command_exists(page: Path) -> None:
    targets = re.findall(r"^([\w-]+):", (_REPOSITORY / "Makefile").read_text(), re.MULTILINE)
    for code in _code(page):
        program, *arguments = code.split("#")[0].removeprefix("python -m ").split() or [""]
        if program == "make":
            for argument in arguments:
                assert "=" in argument or argument in targets, f"{_page_name(page)}: {code}"
        elif program == "limberjack" and arguments:
            _check_call(arguments, f"{_page_name(page)}: {code}")


def test_the_page_of_commands_names_every_command() -> None:
    text = (_DOCS / "commands.md").read_text(encoding="utf-8")
    commands: Any = typer.main.get_command(app)  # typer's own class
    absent = [
        name for name in commands.commands if not re.search(rf"`(limberjack )?{name}\b", text)
    ]
    assert absent == []


def _check_call(arguments: list[str], where: str) -> None:
    """Fails unless the command line has that command, those options and that task."""
    # Any: typer's own classes of commands.
    commands: Any = typer.main.get_command(app)
    name, *rest = arguments[2:] if arguments[0] == "--import" else arguments
    if name.startswith("-"):
        return
    assert name in commands.commands, where
    known = {option for parameter in commands.commands[name].params for option in parameter.opts}
    for option in re.findall(r"--[\w-]+", " ".join(rest)):
        assert option in known, where
    if name == "run" and len(rest) > 1 and rest[0].islower() and name == arguments[0]:
        assert (rest[0], rest[1]) in suite.ALL_TASKS, where
