"""Build the documentation site: `make docs`.

    python tools/build_site.py              # writes site/; open it with a server, see below
    python tools/build_site.py --out DIR
    python -m http.server --directory site  # then open http://localhost:8000

The pages are those of docs/, CHANGELOG.md, CONTRIBUTING.md and SECURITY.md, with the tables and
pictures of the domains (`domain_pages`) and the API reference (`reference_pages`) added. They are
written into build/site with a complete mkdocs.yml, and MkDocs makes the site of them in strict
mode: a warning is an error. The site asks no other server for anything.
"""

import argparse
import logging
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import domain_pages
import numpy as np
import reference_pages
import reference_properties
import yaml

from limberjack import gallery, suite
from limberjack.mujoco import RenderingError
from limberjack.utils import png

__all__ = ["main", "site_config", "site_path", "with_links_of_the_site", "write_pages"]

_REPOSITORY = Path(__file__).parents[1]
_DOCS = _REPOSITORY / "docs"
_CONFIG = _REPOSITORY / "mkdocs.yml"
_NOTEBOOKS = "notebooks"
_REFERENCE = "reference"
_PICTURE = 240, 320  # pixels
_BOOST = 0.2  # of the API reference in the search, so that pages come before it

# Files outside of docs/ that are pages, and pages with another name on the site.
_PAGES = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "docs/README.md": "pages.md",
}
_FENCE = re.compile(r"^(```+).*?^\1$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(?<=\]\()([^)\s]+)(?=\))")

_log = logging.getLogger(__name__)


def main(arguments: Sequence[str] | None = None) -> int:
    """Builds the site; returns the status of MkDocs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=_REPOSITORY / "site", help="the site's folder")
    parser.add_argument(
        "--work",
        type=Path,
        default=_REPOSITORY / "build" / "site",
        help="for the pages as Markdown",
    )
    given = parser.parse_args(arguments)
    logging.basicConfig(format="%(message)s", level=logging.INFO)
    work = given.work.resolve()
    shutil.rmtree(work, ignore_errors=True)
    write_pages(work / "docs")
    config = site_config(work / "docs", given.out.resolve())
    (work / "mkdocs.yml").write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--clean"]
    # The theme announces the next major version of MkDocs, which the requirements exclude.
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run([*command, "--config-file", work / "mkdocs.yml"], env=environment)
    return done.returncode


def write_pages(folder: Path) -> None:
    """Writes all pages as Markdown, and their pictures."""
    shutil.copytree(_DOCS / "images", folder / "images")
    shutil.copytree(_REPOSITORY / _NOTEBOOKS, folder / _NOTEBOOKS)
    shutil.copy(_DOCS / "site.css", folder)
    words = yaml.safe_load(_CONFIG.read_text(encoding="utf-8"))["extra"]["search_words"]
    for source in _sources():
        text = with_links_of_the_site(source, source.read_text(encoding="utf-8"))
        text = domain_pages.fill(text, source.stem)
        if source.stem in words:
            text = _with_facts(text, tags=words[source.stem])
        (folder / site_path(source)).write_text(text, encoding="utf-8")
    for domain in suite.TASKS_BY_DOMAIN:
        page = folder / f"{domain}.md"
        if not page.exists():
            page.write_text(domain_pages.skeleton(domain), encoding="utf-8")
    reference = folder / _REFERENCE
    reference.mkdir()
    for name, text in reference_pages.pages().items():
        text = _with_facts(text, search={"boost": _BOOST})
        (reference / name).write_text(text, encoding="utf-8")
    _write_pictures(folder)


def _with_facts(text: str, **facts: object) -> str:
    """A page with what the search is to know of it."""
    return f"---\n{yaml.safe_dump(facts)}---\n\n{text}"


def _sources() -> Iterator[Path]:
    """The files of the repository that are pages."""
    yield from sorted(_DOCS.glob("*.md"))
    yield from (path for name in _PAGES if (path := _REPOSITORY / name).parent != _DOCS
                and path.exists())  # fmt: skip


def site_path(source: Path) -> str:
    """The path on the site of a file of the repository.

    Raises:
      ValueError: the file is not part of the site.
    """
    name = source.resolve().relative_to(_REPOSITORY).as_posix()
    if name in _PAGES:
        return _PAGES[name]
    if name.startswith(f"{_NOTEBOOKS}/"):
        return name
    if not name.startswith("docs/"):
        raise ValueError(f"{name} is not part of the site; write its name as code, not as a link")
    return name.removeprefix("docs/")


def with_links_of_the_site(source: Path, text: str) -> str:
    """The text of a page, with its links to other files as links to pages of the site.

    Raises:
      ValueError: a link leads to a file that is not part of the site.
    """

    def link(found: re.Match[str]) -> str:
        path, mark, anchor = found[1].partition("#")
        if not path or re.match(r"\w+:", path):
            return found[1]
        return site_path(source.parent / path) + mark + anchor

    parts, end = [], 0
    for fence in _FENCE.finditer(text):
        parts += [_LINK.sub(link, text[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join([*parts, _LINK.sub(link, text[end:])])


def _write_pictures(folder: Path) -> None:
    """A picture of each task; an empty one where nothing can draw."""
    for domain, task in suite.ALL_TASKS:
        try:
            picture = gallery.draw(domain, task, *_PICTURE)
        except RenderingError as error:
            _log.info("pictures of the tasks are empty: %s", error)
            picture = np.full((*_PICTURE, 3), 128, np.uint8)
        path = folder / domain_pages.picture_name(domain, task)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(png.encode(picture))


# Any: what a YAML file holds.
def site_config(pages: Path, out: Path) -> dict[str, Any]:
    """The configuration of MkDocs, with every page in the navigation."""
    config = yaml.safe_load(_CONFIG.read_text(encoding="utf-8"))
    sections = {name: entries for section in config["nav"] for name, entries in section.items()}
    named = set(re.findall(r"[\w.-]+\.md", yaml.safe_dump(config["nav"])))
    domains = [f"{domain}.md" for domain in suite.TASKS_BY_DOMAIN]
    sections["Domains"] += [page for page in domains if page not in named]
    others = {path.name for path in pages.glob("*.md")} - named - set(domains)
    sections["Extend"] += sorted(others)
    sections["API reference"] = [
        f"{_REFERENCE}/{reference_pages.INDEX}",
        *_by_package(reference_pages.modules()),
    ]
    nav = [{name: entries} for name, entries in sections.items()]
    (reader,) = [p["mkdocstrings"] for p in config["plugins"] if "mkdocstrings" in p]
    extensions = [f"{Path(reference_properties.__file__).resolve()}:Properties"]
    reader["handlers"]["python"]["options"]["extensions"] = extensions
    return {**config, "nav": nav, "docs_dir": str(pages), "site_dir": str(out)}


def _by_package(modules: Iterable[str]) -> list[dict[str, Any]]:
    """The pages of modules, those of a package below its name."""
    groups: dict[str, list[dict[str, str]]] = {}
    for name in modules:
        package = ".".join(name.split(".")[:2])
        groups.setdefault(package, []).append({name: f"{_REFERENCE}/{name}.md"})
    return [
        {package: pages} if len(pages) > 1 else dict(pages[0]) for package, pages in groups.items()
    ]


if __name__ == "__main__":
    sys.exit(main())
