"""The documentation as a site: it builds, its links lead somewhere, its search finds, alone."""

import ast
import functools
import http.server
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import reference_pages

from limberjack import suite

from .chromium import Chromium, Page

_REPOSITORY = Path(__file__).parents[2]
_LIMIT = 600  # seconds for the build, on the slowest machine too
# Pages that the browser draws: one of each kind.
_DRAWN = ("", "semantics/", "humanoid/", "scores/", "reference/limberjack.rl.batch/")
_QUERY = "bring_ball"

# Follows every link of the site from its first page on, and returns those that fail. `fetch` goes
# through the browser, so that each address is among the page's requests.
_FOLLOW = """
(async () => {
  const first = new URL('.', location.href);
  const pages = new Map(), failed = [], waiting = [[first.href, '']];
  const load = async address => {
    const answer = await fetch(address);
    if (!answer.ok) return null;
    const kind = answer.headers.get('content-type') || '';
    if (!kind.startsWith('text/html')) return {ids: new Set(), links: []};
    const parsed = new DOMParser().parseFromString(await answer.text(), 'text/html');
    const ids = new Set([...parsed.querySelectorAll('[id], a[name]')].map(e => e.id || e.name));
    const named = [['a', 'href'], ['img', 'src'], ['link', 'href'], ['script', 'src']];
    const links = named.flatMap(([tag, name]) => [...parsed.querySelectorAll(`${tag}[${name}]`)]
      .map(e => [tag, new URL(e.getAttribute(name), address)]));
    return {ids, links};
  };
  while (waiting.length) {
    const [address, from] = waiting.pop(), place = new URL(address);
    const anchor = decodeURIComponent(place.hash.slice(1));
    place.hash = '';
    if (!pages.has(place.href)) {
      const page = await load(place.href);
      pages.set(place.href, page);
      for (const [tag, link] of page ? page.links : []) {
        if (link.origin === first.origin) waiting.push([link.href, place.href]);
        else if (tag !== 'a') failed.push(`${place.href} loads ${link.href}`);
      }
    }
    const page = pages.get(place.href);
    if (!page) failed.push(`${from}: ${address} is not there`);
    else if (anchor && !page.ids.has(anchor)) failed.push(`${from}: ${address} has no such anchor`);
  }
  return {failed: [...new Set(failed)], pages: pages.size};
})()
"""


class _Handler(http.server.SimpleHTTPRequestHandler):
    """Serves files without a line on standard error for each."""

    def log_message(self, format: str, *args: object) -> None:
        """Prints nothing."""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The site's folder, and what `make docs` printed while it was built."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, str(_REPOSITORY / "tools" / "build_site.py")]
    done = subprocess.run(
        [*command, "--out", str(folder / "site"), "--work", str(folder / "work")],
        capture_output=True,
        text=True,
        timeout=_LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "site", done.stdout + done.stderr


@pytest.fixture(scope="module")
def address(built: tuple[Path, str]) -> Iterator[str]:
    """The address of the site's first page, served on this machine."""
    handler = functools.partial(_Handler, directory=str(built[0]))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as browser:
        yield browser


def _articles(folder: Path) -> Iterator[tuple[Path, str]]:
    """The HTML of each page's own content, without the site's navigation."""
    for path in sorted(folder.rglob("*.html")):
        text = path.read_text(encoding="utf-8")
        yield path, text.partition("<article")[2].partition("</article")[0]


def test_the_site_is_built_without_a_warning(built: tuple[Path, str]) -> None:
    folder, printed = built
    assert "WARNING" not in printed.upper(), printed
    assert (folder / "index.html").exists()


def test_every_domain_has_a_page_and_every_task_a_picture(built: tuple[Path, str]) -> None:
    folder, _ = built
    for domain, task in suite.ALL_TASKS:
        assert (folder / domain / "index.html").exists()
        assert (folder / "images" / "domains" / f"{domain}-{task}.png").stat().st_size > 100


def test_every_public_name_is_in_the_reference(built: tuple[Path, str]) -> None:
    lacking = []
    for name, path in reference_pages.modules().items():
        page = built[0] / "reference" / name / "index.html"
        text = page.read_text(encoding="utf-8")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        (names,) = [
            ast.literal_eval(node.value)
            for node in tree.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        ]
        shown = re.compile(rf'id="{re.escape(name)}\.(\w+)"|<td><code>(\w+)</code></td>')
        found = {defined or exported for defined, exported in shown.findall(text)}
        lacking += [f"{name}.{public}" for public in names if public not in found]
    assert lacking == []


def test_no_markup_is_left_as_text(built: tuple[Path, str]) -> None:
    for path, article in _articles(built[0]):
        assert "<!-- generated" not in article, path
        prose = re.sub(r"(?s)<(pre|code|script|style)\b.*?</\1>", "", article)
        text = re.sub(r"<[^>]+>", "", prose)
        left = re.findall(r"(?m)^\||^\s*- |^\s*\d+\. |\]\(|:::", text)
        assert not left, f"{path}: {left}"


def test_every_picture_has_words_in_its_place(built: tuple[Path, str]) -> None:
    for path, article in _articles(built[0]):
        for picture in re.findall(r"<img\b[^>]*>", article):
            words = re.search(r'alt="([^"]*)"', picture)
            assert words is not None, f"{path}: {picture}"
            assert len(words[1].split()) >= 5, f"{path}: {picture}"


@pytest.mark.browser
def test_every_link_leads_somewhere_on_the_site(browser: Chromium, address: str) -> None:
    page = browser.open(address)
    found = page.evaluate(_FOLLOW)
    assert found["failed"] == []
    assert found["pages"] > 100
    _assert_alone(page, address)


@pytest.mark.browser
@pytest.mark.parametrize("path", _DRAWN)
def test_a_page_loads_from_the_site_only_and_logs_no_error(
    browser: Chromium, address: str, path: str
) -> None:
    page = browser.open(address + path)
    page.wait_for_frames(5)
    _assert_alone(page, address)
    assert page.evaluate("getComputedStyle(document.body).fontFamily")


@pytest.mark.browser
def test_a_search_finds_a_page_which_a_click_opens(browser: Chromium, address: str) -> None:
    page = browser.open(address)
    page.evaluate("document.querySelector('.md-search__input').focus()")
    page.call("Input.insertText", text=_QUERY)
    links = "document.querySelectorAll('.md-search-result__link')"
    page.wait_for(f"{links}.length > 0")
    texts = page.evaluate(f"[...{links}].map(link => link.innerText)")
    assert any(_QUERY in text for text in texts), texts
    page.evaluate(f"{links}[0].click()")
    page.wait_for(f"location.href !== {address!r} && document.readyState == 'complete'")
    assert page.evaluate(f"document.body.innerText.includes({_QUERY!r})")
    _assert_alone(page, address)


def _assert_alone(page: Page, address: str) -> None:
    """The page has asked no other server for anything, and has complained of nothing."""
    assert [request for request in page.requests if not request.startswith(address)] == []
    assert page.errors == []
