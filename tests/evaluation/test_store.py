"""The file that keeps finished episodes."""

import dataclasses
import errno
import json
import os
from pathlib import Path
from typing import Any

import pytest

from limberjack.evaluation import Score
from limberjack.evaluation.store import Store
from limberjack.utils import files

_VERSIONS = {"mujoco": "4.0.0", "python": "3.12.3"}
_OURS = {"task": "stand", "versions": _VERSIONS}
_THEIRS = {**_OURS, "task": "walk"}
_SCORE = Score(3, 10.0, 1000, 0.5)


@pytest.mark.parametrize("identity", [_OURS, _THEIRS])
def test_a_second_writer_is_refused_until_the_first_has_closed(
    identity: dict[str, object], tmp_path: Path
) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    first = Store(tmp_path, _OURS)
    with pytest.raises(ValueError, match=r"another process writes to .*: wait for it"):
        Store(tmp_path, identity)
    first.add("zero", [_SCORE])
    first.close()
    second = Store(tmp_path, _OURS)
    assert second.scores["zero"] == {3: _SCORE}
    second.close()


def test_an_episode_that_was_written_in_part_is_an_error_that_names_the_file(
    tmp_path: Path,
) -> None:
    resource = pytest.importorskip("resource", reason="no limits of files on this system")
    store = Store(tmp_path, _OURS)
    path = tmp_path / "episodes.jsonl"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    # As a full disk does: the system takes what there is room for, and refuses what follows.
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 10, limits[1]))
    try:
        with pytest.raises(OSError, match=r"episodes.jsonl") as caught:
            store.add("zero", [_SCORE])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        store.close()
    assert caught.value.errno == errno.EFBIG
    assert not store.scores["zero"]
    again = Store(tmp_path, _OURS)
    again.add("zero", [_SCORE])
    again.close()
    assert path.read_text(encoding="utf-8").count("\n") == 2


def test_what_is_added_is_flushed_to_the_disk_once_for_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(tmp_path, _OURS)
    flushed: list[str] = []
    monkeypatch.setattr(
        os, "fsync", lambda number: flushed.append((tmp_path / "episodes.jsonl").read_text())
    )
    store.add("zero", [_SCORE, dataclasses.replace(_SCORE, seed=4)])
    store.close()
    assert len(flushed) == 1
    assert flushed[0] == (tmp_path / "episodes.jsonl").read_text()
    assert flushed[0].count("\n") == 3


@pytest.mark.parametrize("name", ["mujoco", "python"])
def test_another_patch_version_continues_and_is_recorded(name: str, tmp_path: Path) -> None:
    Store(tmp_path, _OURS).close()
    first = Store(tmp_path, _OURS)
    first.add("zero", [_SCORE])
    first.close()
    patched = {**_VERSIONS, name: _VERSIONS[name] + "7"}
    before = (tmp_path / "episodes.jsonl").read_bytes()
    second = Store(tmp_path, {**_OURS, "versions": patched})
    assert second.scores["zero"] == {3: _SCORE}
    assert second.versions == [_VERSIONS]
    assert (tmp_path / "episodes.jsonl").read_bytes() == before
    second.add("zero", [dataclasses.replace(_SCORE, seed=4)])
    second.add("zero", [dataclasses.replace(_SCORE, seed=5)])
    assert second.versions == [_VERSIONS, patched]
    second.close()
    third = Store(tmp_path, _OURS)
    assert third.versions == [_VERSIONS, patched]
    assert sorted(third.scores["zero"]) == [3, 4, 5]
    third.close()


@pytest.mark.parametrize(
    "other",
    [
        {**_OURS, "versions": {**_VERSIONS, "mujoco": "4.1.0"}},
        {**_OURS, "versions": {**_VERSIONS, "mujoco": "5.0.0"}},
        {**_OURS, "versions": {"mujoco": "4.0.0"}},
        {**_OURS, "fingerprint": "another"},
    ],
)
def test_another_minor_version_or_fingerprint_is_refused(
    other: dict[str, object], tmp_path: Path
) -> None:
    first = Store(tmp_path, {"fingerprint": "ours", **_OURS})
    first.add("zero", [_SCORE])
    first.close()
    with pytest.raises(ValueError, match=r"holds an evaluation with (versions|fingerprint)"):
        Store(tmp_path, {"fingerprint": "ours", **other})


def test_a_refusal_names_the_versions_that_differ_and_no_others(tmp_path: Path) -> None:
    first = Store(tmp_path, _OURS)
    first.add("zero", [_SCORE])
    first.close()
    other = {"mujoco": "4.1.0", "python": "3.12.9"}
    with pytest.raises(ValueError, match="evaluation with versions") as caught:
        Store(tmp_path, {**_OURS, "versions": other})
    expected = "with versions {'mujoco': '4.0.0'}, and this one has {'mujoco': '4.1.0'}: choose"
    assert expected in str(caught.value)


def test_the_first_line_of_a_seed_counts(tmp_path: Path) -> None:
    store = Store(tmp_path, _OURS)
    store.add("zero", [_SCORE])
    store.add("zero", [Score(3, 99.0, 1000, 0.5)])
    store.close()
    again = Store(tmp_path, _OURS)
    assert again.scores["zero"] == {3: _SCORE}
    again.close()


def test_episodes_of_earlier_runs_stay_in_the_file(tmp_path: Path) -> None:
    for seed in range(3):
        store = Store(tmp_path, _OURS)
        assert sorted(store.scores["zero"]) == list(range(seed))
        store.add("zero", [Score(seed, 1.0, 10, 0.0)])
        store.close()
    assert (tmp_path / "episodes.jsonl").read_text(encoding="utf-8").count("\n") == 4


def test_a_damaged_line_is_named_by_its_number_in_the_file(tmp_path: Path) -> None:
    store = Store(tmp_path, _OURS)
    store.add("zero", [_SCORE])
    store.close()
    path = tmp_path / "episodes.jsonl"
    with path.open("a", encoding="utf-8") as file:
        file.write("[1, 2]\n")
    with pytest.raises(ValueError, match="line 3 is no episode"):
        Store(tmp_path, _OURS)


_LINE = {"policy": "zero", "seed": 4, "total": 1.0, "length": 10, "final_reward": 0.5}


@pytest.mark.parametrize(
    "line",
    [
        "[" * 100_000,
        json.dumps({**_LINE, "policy": ["zero"]}),
        json.dumps({**_LINE, "seed": "4"}),
        json.dumps({**_LINE, "seed": True}),
        json.dumps({**_LINE, "total": None}),
        json.dumps({**_LINE, "total": float("nan")}),
        json.dumps({**_LINE, "total": 10**400}),
        json.dumps({**_LINE, "diverged": "no"}),
        json.dumps({**_LINE, "start": {}}),
        json.dumps({**_LINE, "more": 1}),
        json.dumps({"policy": "zero"}),
    ],
)
def test_a_forged_line_is_refused_by_its_number(line: str, tmp_path: Path) -> None:
    store = Store(tmp_path, _OURS)
    store.add("zero", [_SCORE])
    store.close()
    with (tmp_path / "episodes.jsonl").open("a", encoding="utf-8") as file:
        file.write(line + "\n")
    with pytest.raises(ValueError, match="line 3 is no episode"):
        Store(tmp_path, _OURS)


def test_a_return_that_is_no_number_is_refused_with_its_seed(tmp_path: Path) -> None:
    store = Store(tmp_path, _OURS)
    with pytest.raises(ValueError, match="'zero': the return of the episode with seed 4 is nan"):
        store.add("zero", [_SCORE, Score(4, float("nan"), 10, 0.0)])
    store.close()
    again = Store(tmp_path, _OURS)
    assert again.scores["zero"] == {3: _SCORE}  # what came before is kept
    again.close()


def test_without_a_folder_episodes_are_kept_in_memory_only(tmp_path: Path) -> None:
    store = Store(None, _OURS)
    store.add("zero", [_SCORE])
    assert store.scores["zero"] == {3: _SCORE}
    store.close()
    assert not list(tmp_path.iterdir())


# Shards, and file systems without locks.


def test_shards_have_files_of_their_own_that_are_joined_in_the_plain_one(tmp_path: Path) -> None:
    for number in (1, 2):
        shard = Store(tmp_path, _OURS, shard=(number, 2))
        assert shard.path == tmp_path / f"episodes-{number}-of-2.jsonl"
        shard.add("zero", [dataclasses.replace(_SCORE, seed=number)])
        shard.close()
    with (tmp_path / "episodes-2-of-2.jsonl").open("a") as file:
        file.write('{"policy": "zero"')  # as a kill leaves it
    before = (tmp_path / "episodes-2-of-2.jsonl").read_bytes()
    for _ in range(2):
        store = Store(tmp_path, _OURS)
        assert sorted(store.scores["zero"]) == [1, 2]
        store.close()
        assert (tmp_path / "episodes.jsonl").read_text().count("\n") == 3
    assert (tmp_path / "episodes-2-of-2.jsonl").read_bytes() == before


def test_a_shard_continues_and_excludes_a_second_writer_of_the_same_one(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    first = Store(tmp_path, _OURS, shard=(1, 2))
    with pytest.raises(ValueError, match=r"another process writes to .*episodes-1-of-2.jsonl"):
        Store(tmp_path, _OURS, shard=(1, 2))
    Store(tmp_path, _OURS, shard=(2, 2)).close()
    first.add("zero", [_SCORE])
    first.close()
    again = Store(tmp_path, _OURS, shard=(1, 2))
    assert again.scores["zero"] == {3: _SCORE}
    again.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "episodes-1-of-2.jsonl",
        "episodes-2-of-2.jsonl",
    ]


@pytest.mark.parametrize(
    ("theirs", "field"),
    [({"canary": "b"}, "canary"), ({"identity": _THEIRS, "canary": "a"}, "task")],
)
def test_a_shard_of_another_processor_or_task_is_refused_by_name(
    theirs: dict[str, Any], field: str, tmp_path: Path
) -> None:
    shard = Store(tmp_path, **{"identity": _OURS, **theirs}, shard=(1, 2))
    shard.add("zero", [_SCORE])
    shard.close()
    with pytest.raises(ValueError, match=f"holds an evaluation with {field} '"):
        Store(tmp_path, _OURS, canary="a")
    if field == "canary":
        store = Store(tmp_path, _OURS, canary="a", any_processor=True)
        assert store.scores["zero"] == {3: _SCORE}
        store.close()


def test_episodes_of_shards_keep_the_versions_that_played_them(tmp_path: Path) -> None:
    patched = {**_VERSIONS, "mujoco": "4.0.9"}
    shard = Store(tmp_path, {**_OURS, "versions": patched}, shard=(1, 1))
    shard.add("zero", [_SCORE])
    shard.close()
    store = Store(tmp_path, _OURS)
    assert store.versions == [_VERSIONS, patched]
    store.close()


def test_without_locks_a_second_writer_is_noticed_before_anything_is_mixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "fcntl", None)
    first, second = Store(tmp_path, _OURS), Store(tmp_path, _OURS)
    first.add("zero", [_SCORE])
    with pytest.raises(OSError, match=r"another process writes to .*episodes.jsonl: end one of"):
        second.add("zero", [dataclasses.replace(_SCORE, seed=4)])
    first.add("zero", [dataclasses.replace(_SCORE, seed=5)])
    for store in (first, second):
        store.close()
    again = Store(tmp_path, _OURS)
    assert sorted(again.scores["zero"]) == [3, 5]
    again.close()


def test_a_processor_is_kept_with_its_episode(tmp_path: Path) -> None:
    score = dataclasses.replace(_SCORE, processor="one")
    store = Store(tmp_path, _OURS)
    store.add("zero", [_SCORE, dataclasses.replace(score, seed=4)])
    store.close()
    lines = (tmp_path / "episodes.jsonl").read_text().splitlines()
    assert "processor" not in lines[1]
    again = Store(tmp_path, _OURS)
    assert again.scores["zero"][4].processor == "one"
    again.close()
