"""Datasets at URLs are read as local ones: in memory, and from a web server on this machine."""

import io
import json
import pickle
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.data import Dataset, Kept, collect, inform, load, replay
from limberjack.episodes import remote
from limberjack.episodes.remote import Remote
from limberjack.workers import State

from .collected import PENDULUM, assert_equal, copy, folder_of, of_64, whole_hashes
from .collected import damaged as damaged_content
from .ftp import ftp_serving
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


def test_files_that_are_larger_than_a_footer_are_read_from_a_server_without_parts(
    tmp_path: Path,
) -> None:
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    collect(*PENDULUM[:2], "random", range(16), out=tmp_path, time_limit=4.0, num_threads=1)
    expected = load(tmp_path)
    assert inform(expected).nbytes > 2**16  # the most that pyarrow reads for a footer at first
    with serving(tmp_path, Whole) as url:
        _assert_read(url, expected)


def test_parts_of_a_file_on_a_web_server_are_those_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    random = np.random.RandomState(0)
    content, path = random.bytes(5000), tmp_path / "file"
    path.write_bytes(content)
    monkeypatch.setattr(remote, "_BLOCK", 1000)
    with serving(tmp_path) as url:
        place = Remote(url) / "file"
        with place.open() as ours, path.open("rb") as theirs:
            for _ in range(200):
                whence = random.randint(3)
                offset = random.randint(0, 6000) - (0, 3000, 6000)[whence]
                if whence == io.SEEK_CUR:
                    offset = max(offset, -ours.tell())
                if whence == io.SEEK_END:
                    offset = max(offset, -5000)
                assert ours.seek(offset, whence) == theirs.seek(offset, whence)
                size = random.choice([0, 1, 10, 900, 1100])
                assert ours.read(size) == theirs.read(size)
                assert ours.tell() == theirs.tell()
            ours.seek(0)
            assert ours.read() == content
            with pytest.raises(ValueError, match="before start of file"):
                ours.seek(-1)


def test_a_server_is_asked_once_for_the_size_and_then_for_blocks(tmp_path: Path) -> None:
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    asked: list[tuple[str, str]] = []

    class Noting(Files):
        def parse_request(self) -> bool:
            understood = super().parse_request()
            asked.append((self.command, self.headers.get("Range", "")))
            return understood

    (tmp_path / "file").write_bytes(bytes(9_000_000))
    with serving(tmp_path, Noting) as url:
        place = Remote(url) / "file"
        for first in (True, False):
            asked.clear()
            with place.open() as opened:
                while opened.read(100_000):
                    pass
            parts = [("GET", "bytes=0-8488607"), ("GET", "bytes=8488608-8999999")]
            before = [("HEAD", ""), ("GET", "bytes=0-0")] if first else []
            assert asked == before + parts


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
        "unfinished": "has no dataset.json yet; to finish",
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


@pytest.fixture
def out() -> Iterator[str]:
    """A URL in memory to write to."""
    yield "memory://written"
    files = fsspec.filesystem("memory")
    if files.exists("/written"):
        files.rm("/written", recursive=True)


def _collect(out: "str | Path", **how: Any) -> None:
    """Collects 130 episodes in two files, each of which is joined from parts."""
    domain, task, seconds = PENDULUM
    how = {"num_threads": 1, "file_mb": of_64(PENDULUM) * 100 / 64, **how}
    collect(domain, task, "random", range(130), out=out, time_limit=seconds, **how)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The hashes of that dataset in a folder."""
    folder = tmp_path_factory.mktemp("whole")
    _collect(folder)
    return whole_hashes(folder)


def _downloaded(out: str, folder: Path) -> dict[str, str]:
    """The hashes of a dataset in memory, after it was copied into a folder."""
    files = fsspec.filesystem("memory")
    files.get(out.removeprefix("memory:/"), str(folder), recursive=True)
    return whole_hashes(folder)


def test_a_dataset_is_collected_to_a_url_and_continued_there(
    out: str, whole: dict[str, str], tmp_path: Path
) -> None:
    for number in (2, 1):
        _collect(out, shard=(number, 2))
    with pytest.raises(ValueError, match=f"{out} has no dataset.json yet"):
        load(out)
    _collect(out)
    assert _downloaded(out, tmp_path / "first") == whole
    fsspec.filesystem("memory").rm("/written/episodes/seeds-0000000000-0000000100.parquet")
    _collect(out)
    assert _downloaded(out, tmp_path / "second") == whole
    with pytest.raises(ValueError, match=f"{out}/dataset.json belongs to another dataset"):
        _collect(out, kept=Kept(flat=True))


def test_another_process_does_not_see_this_memory_and_sends_its_bytes(
    out: str, whole: dict[str, str], tmp_path: Path
) -> None:
    notes: set[str] = set()
    _collect(out, workers=1, on_state=lambda state: notes.add(state.note))
    assert _downloaded(out, tmp_path / "folder") == whole
    (note,) = notes - {""}
    assert f"does not see {out}, or may not write to it: this process writes its files" in note


def test_workers_write_to_a_server_under_another_name_until_a_file_is_whole(
    whole: dict[str, str], tmp_path: Path
) -> None:
    (tmp_path / "root").mkdir()
    with ftp_serving(tmp_path / "root") as url, ThreadPoolExecutor(2) as executor:
        _collect(f"{url}/deep/walk", executor=executor, on_state=_fail_on_note)
        _assert_read(f"{url}/deep/walk", load(tmp_path / "root" / "deep" / "walk"))
    assert whole_hashes(tmp_path / "root" / "deep" / "walk") == whole


def _fail_on_note(state: State) -> None:
    assert not state.note


def test_a_write_that_ends_early_leaves_no_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "root").mkdir()
    (tmp_path / "content").write_bytes(bytes(10**6))
    with ftp_serving(tmp_path / "root") as url:
        folder = Remote(url)
        (folder / "file").put(tmp_path / "content", folder)
        monkeypatch.setattr(type(folder._found()[0]), "mv", _broken)
        with pytest.raises(OSError, match=r"cannot be written \(ConnectionError: .*/other"):
            (folder / "other").put(tmp_path / "content", folder)
        monkeypatch.undo()
        (tmp_path / "content").write_bytes(b"more")
        (folder / "file").put(tmp_path / "content", folder)
    assert [path.name for path in (tmp_path / "root").iterdir()] == ["file"]
    assert (tmp_path / "root" / "file").read_bytes() == b"more"


def _broken(*arguments: object) -> None:
    raise ConnectionError("the server has gone")


def test_a_server_that_takes_no_files_is_named(tmp_path: Path) -> None:
    pytest.importorskip("aiohttp", reason="needs aiohttp")
    with serving(tmp_path) as url, pytest.raises(OSError, match="it cannot be written") as caught:
        _collect(f"{url}/walk")
    assert f"{url}/walk/run.json" in str(caught.value)


def test_folders_of_this_machine_are_made_for_a_url_of_fsspec(
    whole: dict[str, str], tmp_path: Path
) -> None:
    _collect(f"local://{tmp_path}/deep/out")
    assert whole_hashes(tmp_path / "deep" / "out") == whole


def test_a_place_is_made_moved_and_removed_as_a_path_is(tmp_path: Path) -> None:
    (tmp_path / "root").mkdir()
    (tmp_path / "content").write_bytes(b"content")
    with ftp_serving(tmp_path / "root") as url:
        folder = Remote(url) / "a"
        for _ in range(2):
            (folder / "b").mkdir()
        (folder / "file").put(tmp_path / "content", folder)
        (folder / "file").rename(folder / "b" / "file")
        with pytest.raises(OSError, match="cannot be removed"):
            (folder / "b").rmdir()
        assert (tmp_path / "root" / "a" / "b" / "file").read_bytes() == b"content"
        for _ in range(2):
            (folder / "b" / "file").unlink(missing_ok=True)
        (folder / "b").rmdir()
    assert list((tmp_path / "root" / "a").iterdir()) == []
