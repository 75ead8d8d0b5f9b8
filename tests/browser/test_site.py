"""The documentation as a site: it builds, its links lead somewhere, its search finds, alone."""

import ast
import functools
import http.server
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import reference_pages
import yaml

from limberjack import suite

from .chromium import Chromium, Page

_REPOSITORY = Path(__file__).parents[2]
_LIMIT = 600  # seconds for the build, on the slowest machine too
# Pages that the browser draws: one of each kind.
_DRAWN = ("", "semantics/", "humanoid/", "scores/", "reference/limberjack.rl.batch/")
_QUERY = "bring_ball"
_WIDTHS = (390, 1280)  # CSS pixels: of a phone and of a laptop
_SCHEMES = ("default", "slate")  # the theme's names of light and dark
_SWITCH = "document.querySelector('form[data-md-component=palette] label:not([hidden])').click()"

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

# What of a page does not fit into a window: what is beyond an edge where nothing scrolls, what is
# cut off, and tables that scroll without a sign of it.
_UNFITTING = """
(width => {
  const found = [], whole = document.documentElement.scrollWidth;
  if (whole > width) found.push(`the page is ${whole} wide`);
  const said = e => `${e.tagName} ${e.textContent.trim().slice(0, 40)}`;
  const is = (e, ...kinds) => kinds.includes(getComputedStyle(e).overflowX);
  const within = box => box.left >= -1 && box.right <= width + 1;
  const shows = e => is(e, 'auto', 'scroll') && within(e.getBoundingClientRect());
  for (const e of document.querySelectorAll('.md-content *')) {
    const box = e.getBoundingClientRect();
    if (!box.width || !box.height) continue;
    let scroller = within(box) ? null : e.parentElement;
    while (scroller && !shows(scroller)) scroller = scroller.parentElement;
    if (!within(box) && !scroller) found.push(`${said(e)}: from ${box.left} to ${box.right}`);
    if (is(e, 'hidden', 'clip') && e.scrollWidth > e.clientWidth + 1)
      found.push(`${said(e)}: cut off at ${e.clientWidth} of ${e.scrollWidth}`);
    const scrolls = e.scrollWidth > e.clientWidth + 1 && is(e, 'auto', 'scroll');
    if (scrolls && e.querySelector('table:not([class])')
        && !getComputedStyle(e).backgroundImage.includes('gradient'))
      found.push(`${said(e)}: scrolls without a sign of it`);
  }
  return found;
})
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
        env={**os.environ, "MUJOCO_GL": "disable"},  # tests/test_gallery.py draws the pictures
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
def test_a_page_loads_from_the_site_only_logs_no_error_and_fits(
    browser: Chromium, address: str, path: str
) -> None:
    page = browser.open(address + path)
    page.wait_for_frames(5)
    _assert_alone(page, address)
    assert page.evaluate("getComputedStyle(document.body).fontFamily")
    assert _unfitting(page) == []


@pytest.mark.slow
@pytest.mark.browser
def test_every_page_fits_a_phone_and_a_laptop_light_and_dark(
    browser: Chromium, address: str, built: tuple[Path, str]
) -> None:
    page = browser.open(address)
    paths = [path.relative_to(built[0]).as_posix() for path in built[0].rglob("index.html")]
    assert len(paths) > 100
    found = []
    for path in sorted(paths):
        page.call("Page.navigate", url=address + path)
        page.wait_for(f"location.pathname == '/{path}' && document.readyState == 'complete'")
        found += [f"{path}: {what}" for what in _unfitting(page)]
    assert found == []


def _unfitting(page: Page) -> list[str]:
    """Faults in the layout of a page, at each width and in both colour schemes."""
    page.prefer(prefers_reduced_motion="reduce")  # nothing is on its way to its place
    found = []
    for scheme in _SCHEMES:
        if page.evaluate("document.body.dataset.mdColorScheme") != scheme:
            page.evaluate(_SWITCH)
        page.wait_for(f"document.body.dataset.mdColorScheme == '{scheme}'")
        for width in _WIDTHS:
            page.resize(width, 900)
            page.wait_for(f"innerWidth == {width}")
            lacking = page.evaluate(f"{_UNFITTING.strip()}({width})")
            found += [f"{width} pixels, {scheme}: {what}" for what in lacking]
    return found


@pytest.mark.browser
def test_a_search_finds_a_page_which_a_click_opens(browser: Chromium, address: str) -> None:
    page = browser.open(address)
    links = _searched(page, _QUERY)
    texts = page.evaluate(f"[...{links}].map(link => link.innerText)")
    assert any(_QUERY in text for text in texts), texts
    page.evaluate(f"{links}[0].click()")
    page.wait_for(f"location.href !== {address!r} && document.readyState == 'complete'")
    assert page.evaluate(f"document.body.innerText.includes({_QUERY!r})")
    _assert_alone(page, address)


def _searched(page: Page, words: str) -> str:
    """Types into the search, and waits; the expression for the links that it finds."""
    field = "document.querySelector('.md-search__input')"
    page.evaluate(f"{field}.focus(), {field}.select()")
    page.call("Input.insertText", text=words)
    page.evaluate(f"{field}.dispatchEvent(new Event('keyup'))")  # the theme waits for a key
    links = "document.querySelectorAll('.md-search-result__link')"
    # A link carries the words that its page is to highlight.
    last = words.lower().split()[-1]
    page.wait_for(f"[...{links}].some(e => new URL(e).searchParams.get('h')?.includes('{last}'))")
    return links


@pytest.mark.browser
def test_a_search_for_the_words_of_users_finds_their_page(browser: Chromium, address: str) -> None:
    config = yaml.safe_load((_REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8"))
    wanted = [(word, name) for name, words in config["extra"]["search_words"].items()
              for word in words]  # fmt: skip
    assert len(wanted) > 10
    page = browser.open(address)
    for word, name in [("domain randomization", "randomisation"), *wanted]:
        links = _searched(page, word)
        paths = page.evaluate(f"[...{links}].map(link => new URL(link).pathname)")
        first_three = list(dict.fromkeys(paths))[:3]
        assert f"/{name}/" in first_three, word


def _assert_alone(page: Page, address: str) -> None:
    """The page has asked no other server for anything, and has complained of nothing."""
    assert [request for request in page.requests if not request.startswith(address)] == []
    assert page.errors == []
