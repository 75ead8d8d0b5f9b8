"""Files as workers write them: whole, where they see the folder, and in few bytes of messages."""

import contextlib
import dataclasses
import errno
import hashlib
import os
import pickle
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from limberjack.episodes.manifest import File
from limberjack.episodes.parquet import encode
from limberjack.episodes.places import filling
from limberjack.episodes.player import play_unit
from limberjack.episodes.writing import (
    FILE,
    LIST,
    PART,
    Order,
    Unseen,
    Writing,
    file_of,
    joining,
    work,
)
from limberjack.workers import prepare
from limberjack.workers.attempt import Answer

from .collected import PENDULUM, made

_RECIPE, _EPISODES = made(PENDULUM, range(60, 64))
_SEEDS = range(60, 64)
_CONTENT = encode(_RECIPE, _EPISODES)
_NAME = "seeds-0000000060-0000000064"
_NODE = socket.gethostname()

_Ordered = Callable[[Writing, Order], File | Unseen | None]


@pytest.fixture(scope="module")
def ordered() -> _Ordered:
    """`work` for a folder that is given, with an order."""
    domain, task, seconds = PENDULUM
    setup = prepare(domain, task, "random", time_limit=seconds, num_threads=1)

    def done(writing: Writing, order: Order) -> File | Unseen | None:
        return work(writing, setup, _SEEDS, order)

    return done


def _writing(folder: Path) -> Writing:
    """Of a worker that sees the folder."""
    (folder / "parts").mkdir(parents=True)
    (folder / "parts" / ".probe-1").touch()
    return Writing(folder, _RECIPE, ".probe-1")


def _left(folder: Path) -> list[str]:
    """The files in a folder but the probe."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return sorted(path.relative_to(folder).as_posix() for path in paths if "probe" not in path.name)


@pytest.mark.parametrize(
    ("parts", "runs"),
    [
        ([range(k, k + 1) for k in range(10_000)], ((0, 10_000, 1),)),
        ([range(64, 128), range(64), range(128, 140)], ((0, 128, 64), (128, 140, 12))),
        ([range(60, 62), range(60, 70), range(64, 66)], ((60, 70, 10),)),
        ([range(60, 70), range(62, 70)], ((60, 70, 10),)),
        ([range(60, 63), range(61, 62), range(62, 70)], ((60, 63, 3), (62, 70, 8))),
    ],
)
def test_parts_are_named_in_runs_without_those_whose_episodes_others_have(
    parts: list[range], runs: tuple[tuple[int, int, int], ...]
) -> None:
    order = joining(parts)
    assert order.parts == runs
    assert set(order.named()) <= set(parts)
    assert {seed for part in order.named() for seed in part} == {s for one in parts for s in one}


def test_a_unit_costs_the_driver_less_than_2_kb() -> None:
    key = "0" * 64
    orders = (FILE, PART, LIST, joining(range(k, k + 1) for k in range(10_000)))
    answer = File(range(10**9, 10**9 + 10**4), 10**9, 10**9, key)
    for order in orders:
        message = pickle.dumps(({}, key, key, range(10**9, 10**9 + 10**4), (order,)))
        assert len(message) + len(pickle.dumps(Answer(answer))) < 1000


def test_a_worker_writes_a_file_or_a_part_and_answers_with_the_entry_of_a_file(
    ordered: _Ordered, tmp_path: Path
) -> None:
    writing = _writing(tmp_path)
    expected = File(_SEEDS, 4 * 11, len(_CONTENT), hashlib.sha256(_CONTENT).hexdigest())
    assert ordered(writing, PART) is None
    assert _left(tmp_path) == [f"parts/{_NAME}.part"]
    assert ordered(writing, joining([_SEEDS])) == expected
    assert _left(tmp_path) == [f"episodes/{_NAME}.parquet"]
    path = tmp_path / "episodes" / f"{_NAME}.parquet"
    assert path.read_bytes() == _CONTENT
    assert ordered(writing, LIST) == file_of(path) == expected
    path.unlink()
    assert ordered(writing, FILE) == expected
    assert path.read_bytes() == _CONTENT


def test_a_file_has_the_order_of_the_seeds_in_whichever_order_episodes_end(
    ordered: _Ordered, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "limberjack.episodes.writing.play_unit", lambda *given: [*reversed(play_unit(*given))]
    )
    ordered(_writing(tmp_path), PART)
    assert (tmp_path / "parts" / f"{_NAME}.part").read_bytes() == _CONTENT


def test_a_part_that_has_episodes_of_another_file_stays(tmp_path: Path) -> None:
    writing = _writing(tmp_path)
    writing.write(_SEEDS, _CONTENT, PART)
    for seeds in (range(60, 62), range(62, 64)):
        writing.join(seeds, [_SEEDS])
        assert f"parts/{_NAME}.part" in _left(tmp_path)
    assert [path.name for path in sorted((tmp_path / "episodes").iterdir())] == [
        "seeds-0000000060-0000000062.parquet",
        "seeds-0000000062-0000000064.parquet",
    ]


def test_a_worker_without_the_probe_returns_the_bytes_and_reads_nothing(
    ordered: _Ordered, tmp_path: Path
) -> None:
    writing = dataclasses.replace(_writing(tmp_path), probe=".probe-2")
    for order in (FILE, PART):
        assert ordered(writing, order) == Unseen(_NODE, _CONTENT)
    for order in (LIST, joining([_SEEDS])):
        assert ordered(writing, order) == Unseen(_NODE)
    assert _left(tmp_path) == []


def test_a_worker_that_does_not_reach_the_server_of_the_folder_returns_the_bytes(
    ordered: _Ordered, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreached(place: object) -> bool:
        raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")

    monkeypatch.setattr("limberjack.episodes.writing.exists", unreached)
    assert ordered(_writing(tmp_path), FILE) == Unseen(_NODE, _CONTENT)


def test_a_file_is_written_while_another_process_removes_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    removals = 2

    def removing(path: Path, folder: Path) -> Any:
        nonlocal removals
        if removals:
            removals -= 1
            folder.rmdir()
        return filling(path, folder)

    monkeypatch.setattr("limberjack.episodes.writing.filling", removing)
    Writing(tmp_path, _RECIPE).write(_SEEDS, _CONTENT, PART)
    assert (tmp_path / "parts" / f"{_NAME}.part").read_bytes() == _CONTENT
    removals = 10
    (tmp_path / "parts" / f"{_NAME}.part").unlink()
    with pytest.raises(FileNotFoundError):
        Writing(tmp_path, _RECIPE).write(_SEEDS, _CONTENT, PART)


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOSPC])
def test_a_worker_returns_the_bytes_if_it_may_not_write_but_not_if_the_disk_is_full(
    number: int,
    ordered: _Ordered,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    writing = _writing(tmp_path)

    @contextlib.contextmanager
    def refusing(path: Path, beside: Path) -> Iterator[Path]:
        with filling(path, beside) as partial:
            yield partial
            raise OSError(number, os.strerror(number), str(path))

    monkeypatch.setattr("limberjack.episodes.writing.filling", refusing)
    if number == errno.ENOSPC:
        with pytest.raises(OSError, match="No space left"):
            ordered(writing, FILE)
    else:
        assert ordered(writing, FILE) == Unseen(_NODE, _CONTENT)
    assert _left(tmp_path) == []


def test_a_damaged_part_is_refused_by_name_and_the_others_stay(tmp_path: Path) -> None:
    writing = _writing(tmp_path)
    for first, end in ((60, 62), (62, 64)):
        content = encode(_RECIPE, _EPISODES[first - 60 : end - 60])
        writing.write(range(first, end), content, PART)
    path = tmp_path / "parts" / "seeds-0000000062-0000000064.part"
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ValueError, match=f"{path} is damaged"):
        writing.join(_SEEDS, [range(60, 62), range(62, 64)])
    assert _left(tmp_path) == [
        "parts/seeds-0000000060-0000000062.part",
        "parts/seeds-0000000062-0000000064.part",
    ]


def test_a_worker_with_another_pyarrow_writes_nothing(
    ordered: _Ordered,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("limberjack.episodes.writing.PYARROW", "1.0")
    with pytest.raises(ValueError, match=r"pyarrow is 1.0 in a worker, and .*: install the same"):
        ordered(_writing(tmp_path), FILE)
    assert _left(tmp_path) == []
