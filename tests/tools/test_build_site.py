"""Pages of the site: which files they come from, and their links and navigation."""

from pathlib import Path

import build_site
import griffe
import pytest
import reference_pages
import reference_properties

from limberjack import suite

_REPOSITORY = Path(__file__).parents[2]
_DOCS = _REPOSITORY / "docs"


@pytest.mark.parametrize(
    ("source", "path"),
    [
        ("docs/index.md", "index.md"),
        ("CHANGELOG.md", "changelog.md"),
        ("docs/README.md", "pages.md"),
        ("docs/humanoid.md", "humanoid.md"),
        ("docs/images/suite.png", "images/suite.png"),
        ("notebooks/first_steps.ipynb", "notebooks/first_steps.ipynb"),
    ],
)
def test_a_file_of_the_repository_has_its_path_on_the_site(source: str, path: str) -> None:
    assert build_site.site_path(_REPOSITORY / source) == path


def test_a_link_to_a_file_outside_of_the_site_is_refused() -> None:
    with pytest.raises(ValueError, match=r"examples/batch\.py is not part of the site"):
        build_site.site_path(_REPOSITORY / "examples" / "batch.py")


def test_links_between_files_become_links_between_pages(tmp_path: Path) -> None:
    page = _DOCS / "index.md"
    text = build_site.with_links_of_the_site(
        page,
        "[a](batches.md#ids), [b](README.md), [c](https://example.org), [d](#use-it)\n"
        "```text\n[e](../README.md)\n```\n[f](../CHANGELOG.md)",
    )
    assert text == (
        "[a](batches.md#ids), [b](pages.md), [c](https://example.org), [d](#use-it)\n"
        "```text\n[e](../README.md)\n```\n[f](changelog.md)"
    )


def test_every_page_and_every_domain_is_in_the_navigation(tmp_path: Path) -> None:
    for name in ("index.md", "extra.md", "swing.md"):
        (tmp_path / name).write_text("# A page\n")
    config = build_site.site_config(tmp_path, tmp_path / "site")
    sections = {name: entries for section in config["nav"] for name, entries in section.items()}
    for page in _DOCS.glob("*.md"):
        assert f"'{build_site.site_path(page)}'" in str(sections), page
    for domain in suite.TASKS_BY_DOMAIN:
        assert f"{domain}.md" in sections["Domains"]
    assert {"extra.md", "swing.md"} <= set(sections["Extend"])
    for name in reference_pages.modules():
        assert f"'reference/{name}.md'" in str(sections["API reference"])


def test_modules_that_begin_with_an_underscore_have_no_page() -> None:
    names = reference_pages.modules()
    assert "limberjack.suite.humanoid" in names
    assert not [name for name in names if "._" in name]


def test_a_public_name_from_another_module_links_to_it() -> None:
    page = reference_pages.pages()["limberjack.gym.md"]
    assert "| `VectorEnv` | [`limberjack.gym.vector`](limberjack.gym.vector.md) |" in page
    assert page.endswith("::: limberjack.gym\n")


def test_the_reference_shows_properties_that_give_way_as_properties() -> None:
    extensions = griffe.load_extensions(f"{reference_properties.__file__}:Properties")
    source = str(_REPOSITORY / "src")
    module = griffe.load("limberjack.rl.control", search_paths=[source], extensions=extensions)
    environment = module["Environment"]
    assert environment["success"].is_attribute
    assert str(environment["success"].annotation) == "bool | None"
    assert "goal" in environment["success"].docstring.value
    assert environment["reset"].is_function
