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
_OURS = {"task": "stand", "policy": "random", "policy_sha256": "0", "versions": _VERSIONS}
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


# Files that are not a store's.

_FOREIGN = [
    '{"my own": "hours of work"}\n',
    '{"my own": "hours of work"}',
    "hours of work\n",
    "hours of work",
    "one\ntwo\n",
    "\n",
    "{}\n",
    '{"versions": {}}\n',
    '{"versions": "mine", "task": "stand"}\n',
    '{"task": "stand", "mine": {"mujoco"',
]


def _seen(folder: Path) -> dict[str, tuple[bytes, int, str | None]]:
    """Content, time of change and target of links, of everything in a folder."""
    return {
        path.name: (
            path.read_bytes(),
            path.lstat().st_mtime_ns,
            os.readlink(path) if path.is_symlink() else None,
        )
        for path in folder.iterdir()
    }


@pytest.mark.parametrize("text", _FOREIGN)
@pytest.mark.parametrize("shard", [None, (1, 2)])
def test_a_file_of_something_else_is_refused_and_untouched(
    text: str, shard: tuple[int, int] | None, tmp_path: Path
) -> None:
    name = "episodes.jsonl" if shard is None else "episodes-1-of-2.jsonl"
    (tmp_path / name).write_text(text)
    before = _seen(tmp_path)
    with pytest.raises(ValueError, match=rf"{name} does not begin with the line of an evaluation"):
        Store(tmp_path, _OURS, shard=shard)
    assert _seen(tmp_path) == before


@pytest.mark.parametrize("text", _FOREIGN)
def test_a_shards_file_of_something_else_is_refused_before_anything_is_written(
    text: str, tmp_path: Path
) -> None:
    shard = Store(tmp_path, _OURS, shard=(1, 2))
    shard.add("zero", [_SCORE])
    shard.close()
    (tmp_path / "episodes-x-of-y.jsonl").write_text(text)
    before = _seen(tmp_path)
    with pytest.raises(ValueError, match=r"episodes-x-of-y\.jsonl does not begin with the line"):
        Store(tmp_path, _OURS)
    assert _seen(tmp_path) == before


@pytest.mark.skipif(os.name == "nt", reason="Windows links need a privilege")
@pytest.mark.parametrize("text", [*_FOREIGN, "", None])
def test_a_link_is_refused_and_its_file_untouched(text: str | None, tmp_path: Path) -> None:
    victim, folder = tmp_path / "victim", tmp_path / "scores"
    folder.mkdir()
    (folder / "episodes.jsonl").symlink_to(victim)
    if text is not None:
        victim.write_text(text)
    with pytest.raises(ValueError, match=r"episodes\.jsonl is a link, which an evaluation never"):
        Store(folder, _OURS)
    assert victim.exists() == (text is not None)
    assert text is None or victim.read_text() == text
    assert (folder / "episodes.jsonl").is_symlink()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_a_pipe_in_the_place_of_a_store_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "episodes.jsonl")
    with pytest.raises(ValueError, match=r"episodes\.jsonl is a pipe; expected a regular file"):
        Store(tmp_path, _OURS)


def test_a_store_without_episodes_is_begun_again_by_another_evaluation(tmp_path: Path) -> None:
    Store(tmp_path, _THEIRS).close()
    store = Store(tmp_path, _OURS)
    store.add("zero", [_SCORE])
    store.close()
    (first, _) = (tmp_path / "episodes.jsonl").read_text().splitlines()
    assert json.loads(first) == _OURS


def test_a_first_line_that_a_kill_cut_off_is_written_again(tmp_path: Path) -> None:
    Store(tmp_path, _OURS).close()
    path = tmp_path / "episodes.jsonl"
    whole = path.read_bytes()
    for length in (0, 1, len(whole) - 1):
        path.write_bytes(whole[:length])
        Store(tmp_path, _OURS).close()
        assert path.read_bytes() == whole


def test_a_refused_folder_keeps_an_unfinished_line(tmp_path: Path) -> None:
    store = Store(tmp_path, _OURS)
    store.add("zero", [_SCORE])
    store.close()
    with (tmp_path / "episodes.jsonl").open("a") as file:
        file.write('{"policy": "zero"')
    (tmp_path / "episodes-1-of-1.jsonl").write_text("mine\n")
    before = _seen(tmp_path)
    with pytest.raises(ValueError, match="does not begin with the line"):
        Store(tmp_path, _OURS)
    assert _seen(tmp_path) == before


def test_a_set_a_dataset_and_a_file_are_refused_as_the_folder(tmp_path: Path) -> None:
    for name, message in (("set.json", "the results of a set"), ("dataset.json", "a dataset")):
        folder = tmp_path / name.partition(".")[0]
        folder.mkdir()
        (folder / name).write_text("{}")
        with pytest.raises(ValueError, match=rf"holds {message}, {name}: choose another folder"):
            Store(folder, _OURS)
        assert [one.name for one in folder.iterdir()] == [name]
        with pytest.raises(ValueError, match="is no folder: choose another name"):
            Store(folder / name, _OURS)


_LIMITED = {**_OURS, "time_limit": 25.0, "control_timestep": 0.025}


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"length": -3}, "length is -3; expected a whole number from 0 on"),
        ({"length": 0}, "length is 0; expected from 1 to 1000, the steps of the time limit"),
        ({"length": 1001}, "length is 1001; expected from 1 to 1000"),
        ({"length": 10**9}, "length is 1000000000; expected from 1 to 1000"),
        ({"length": 10**400}, "length is 1000000"),
        ({"length": 10.0}, "length is 10.0; expected a whole number"),
        ({"seed": -1}, "seed is -1; expected a whole number from 0 on"),
        ({"seed": 2**32}, "seed is 4294967296; expected"),
        ({"total": float("inf")}, "total is inf; expected a finite number"),
        ({"final_reward": float("nan")}, "final_reward is nan; expected a finite number"),
        ({"policy": "x" * 5000, "total": "x" * 5000}, "total is 'xxx"),
        ({"more": 1}, "entries ['more'] are missing or unknown"),
    ],
)
def test_a_value_that_no_episode_has_is_refused_with_file_line_and_value(
    entry: dict[str, Any], message: str, tmp_path: Path
) -> None:
    store = Store(tmp_path, _LIMITED)
    store.add("zero", [_SCORE])
    store.close()
    path = tmp_path / "episodes.jsonl"
    line = {**json.loads(path.read_text().splitlines()[1]), **entry}
    with path.open("a") as file:
        file.write(json.dumps(line) + "\n")
    before = _seen(tmp_path)
    with pytest.raises(ValueError, match="line 3 is no episode") as caught:
        Store(tmp_path, _LIMITED)
    text = str(caught.value)
    assert text.startswith(f"{path}: line 3 is no episode: remove that line")
    assert message in text
    assert len(text) < 500
    assert _seen(tmp_path) == before


@pytest.mark.parametrize("versions", [-3, "4.0.0", ["4.0.0"], {"mujoco": 4}, None])
def test_versions_of_another_form_are_refused_with_the_line(versions: Any, tmp_path: Path) -> None:
    store = Store(tmp_path, _OURS)
    store.add("zero", [_SCORE])
    store.close()
    with (tmp_path / "episodes.jsonl").open("a") as file:
        file.write(json.dumps({"versions": versions}) + "\n")
    with pytest.raises(ValueError, match=r"line 3 is no episode: .* \(versions is "):
        Store(tmp_path, _OURS)


def test_episodes_of_another_minor_version_are_refused_later_in_the_file_too(
    tmp_path: Path,
) -> None:
    store = Store(tmp_path, _OURS)
    store.add("zero", [_SCORE])
    store.close()
    with (tmp_path / "episodes.jsonl").open("a") as file:
        file.write(json.dumps({"versions": {**_VERSIONS, "mujoco": "4.7.0"}}) + "\n")
    with pytest.raises(ValueError, match=r"evaluation with versions {'mujoco': '4\.7\.0'}"):
        Store(tmp_path, _OURS)


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
