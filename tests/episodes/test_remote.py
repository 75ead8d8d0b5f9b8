"""Datasets at URLs are read as local ones: in memory, and from a web server on this machine."""

import json
import pickle
from collections.abc import Iterator
from pathlib import Path

import pytest

from limberjack.data import Dataset, inform, load, replay
from limberjack.episodes.remote import Remote

from .collected import assert_equal, copy, folder_of
from .collected import damaged as damaged_content
from .serving import Files, Unlisted, Whole, serving

fsspec = pytest.importorskip("fsspec", reason="needs the extra 'data'")


@pytest.fixture
def memory(pendulums: Dataset) -> Iterator[str]:
    """The URL of a dataset in memory."""
    files = fsspec.filesystem("memory")
    files.put(str(folder_of(pendulums)), "/walk", recursive=True)
    yield "memory://walk"
    files.rm("/walk", recursive=True)


def _assert_read(url: str, expected: Dataset) -> None:
    found = load(url)
    assert found.seeds == expected.seeds
    for ours, theirs in zip(found, expected, strict=True):
        assert_equal(ours, theirs)
    assert_equal(found[-1], expected[-1])
    assert found.transitions([3]).actions == expected.transitions([3]).actions
    assert sum(map(len, found.batches(64, seed=0))) == expected.steps


def test_a_dataset_in_memory_is_read(memory: str, pendulums: Dataset) -> None:
    _assert_read(memory, pendulums)
    _assert_read(f"{memory}/", pendulums)
    dataset = load(memory)
    assert inform(dataset, verify=True).as_json() == inform(pendulums).as_json()
    assert replay(dataset.part(0, 35), num_threads=1) is None
    assert pickle.loads(pickle.dumps(dataset)).part(0, 70)[0].seed == 0


@pytest.mark.parametrize("handler", [Files, Unlisted, Whole])
def test_a_dataset_on_a_web_server_is_read(handler: type[Whole], pendulums: Dataset) -> None:
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    with serving(folder_of(pendulums), handler) as url:
        _assert_read(url, pendulums)


def test_a_page_of_links_is_no_list_of_what_lies_elsewhere(
    pendulums: Dataset, tmp_path: Path
) -> None:
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    folder = copy(folder_of(pendulums), tmp_path / "data")
    links = ["/other/mine.parquet", "https://example.org/mine.parquet", "../", "?order=name"]
    page = "".join(f'<a href="{link}">link</a>' for link in links)
    (folder / "episodes" / "index.html").write_text(page)
    with serving(folder) as url:
        assert load(url).steps == 700


def test_a_server_that_has_no_dataset_or_does_not_answer_is_named(tmp_path: Path) -> None:
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    with serving(tmp_path) as url:
        with pytest.raises(ValueError, match=f"{url}/a has no complete file of a dataset"):
            load(f"{url}/a")
        with pytest.raises(FileNotFoundError, match="there is no such file"):
            (Remote(url) / "a").open()
    with pytest.raises(OSError, match=r"it cannot be read \(ClientConnectorError") as caught:
        load(url)
    assert url in str(caught.value)


def test_a_server_that_ends_while_it_is_read_is_named(pendulums: Dataset) -> None:
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    with serving(folder_of(pendulums)) as url:
        dataset = load(url)
    with pytest.raises(OSError, match="it cannot be read") as caught:
        list(dataset)
    assert f"{url}/episodes/seeds-0000000000-0000000064.parquet" in str(caught.value)


@pytest.mark.parametrize("change", ["missing", "shorter", "unlisted", "damaged", "unfinished"])
def test_another_file_is_noticed_as_in_a_folder(
    change: str, pendulums: Dataset, memory: str
) -> None:
    files = fsspec.filesystem("memory")
    first = "/walk/episodes/seeds-0000000000-0000000064.parquet"
    content = files.cat_file(first)
    match change:
        case "missing":
            files.rm(first)
        case "shorter":
            files.pipe_file(first, content[:-1])
        case "unlisted":
            files.pipe_file("/walk/episodes/mine.txt", b"mine")
        case "damaged":
            files.pipe_file(first, damaged_content(content))
        case _:
            files.rm("/walk/dataset.json")
    message = {
        "missing": "is missing, which dataset.json lists",
        "shorter": "bytes, and .* in dataset.json: remove it .* repeat the call that collected it",
        "unlisted": "mine.txt is not listed in dataset.json",
        "damaged": "seeds-0000000000-0000000064.parquet is damaged",
        "unfinished": "has no dataset.json yet: to finish",
    }[change]
    with pytest.raises(ValueError, match=f"^memory://walk.*{message}"):
        list(load(memory))
    if change in ("unlisted", "unfinished"):
        assert len(load(memory, allow_gaps=True)) == 70


@pytest.mark.parametrize(
    ("url", "error", "message"),
    [
        ("foo://walk", ValueError, "foo://walk is no URL that fsspec reads"),
        ("memory://none", ValueError, "memory://none has no complete file of a dataset"),
    ],
)
def test_a_url_without_a_dataset_is_refused(url: str, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        load(url)


def test_a_protocol_that_needs_another_package_names_it() -> None:
    for package, url in (("s3fs", "s3://bucket/walk"), ("gcsfs", "gs://bucket/walk")):
        try:
            __import__(package)
        except ImportError:
            with pytest.raises(
                ImportError, match=f"needs another package to read {url} .*{package}"
            ):
                load(url)


def test_names_that_are_no_seeds_lead_nowhere_else(pendulums: Dataset, tmp_path: Path) -> None:
    folder = copy(folder_of(pendulums), tmp_path / "data")
    manifest = json.loads((folder / "dataset.json").read_text())
    manifest["files"][0]["name"] = "../../etc/passwd"
    (folder / "dataset.json").write_text(json.dumps(manifest))
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    with serving(folder) as url, pytest.raises(ValueError, match=r"dataset\.json is damaged"):
        load(url)


def test_places_are_equal_if_their_urls_are() -> None:
    place = Remote("memory://a") / "b.txt"
    assert place == Remote("memory://a/b.txt") == pickle.loads(pickle.dumps(place))
    assert hash(place) == hash(Remote("memory://a/b.txt"))
    assert place != Remote("memory://a")
    assert repr(place) == "Remote('memory://a/b.txt')"
