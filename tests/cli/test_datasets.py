"""`limberjack info`, `replay` and `convert`, and errors that all commands on datasets report."""

import dataclasses
import io
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import typer

from limberjack import data
from limberjack.cli.datasets import reading_reported
from limberjack.data import Kept, collect
from limberjack.episodes.parquet import encode
from limberjack.mujoco.fingerprint import versions
from tests.episodes.collected import copy, damaged, hashes, path_of

from .conftest import invoke

_SHORT = ["pendulum", "swingup", "--time-limit", "0.1"]


def _shorter(content: bytes) -> bytes:
    return content[:-1]


def _as_a_pickle(content: bytes) -> bytes:
    return b"\x80\x04cos\nsystem\n(X\x04\x00\x00\x00exittR."


def _with_a_forged_recipe(content: bytes) -> bytes:
    table = pq.read_table(io.BytesIO(content))
    recipe = table.schema.metadata[b"limberjack"].replace(b'"int64",[]', b'"int64",{}')
    file = io.BytesIO()
    pq.write_table(table.replace_schema_metadata({b"limberjack": recipe}), file)
    return file.getvalue()


def test_a_dataset_at_a_url_is_shown_and_played(tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec", reason="needs the extra 'data'")
    folder = _collected(tmp_path)
    files = fsspec.filesystem("memory")
    files.put(str(folder), "/swing", recursive=True)
    try:
        url, here = (
            invoke("info", "memory://swing", "--json"),
            invoke("info", str(folder), "--json"),
        )
        assert url.exit_code == 0
        assert url.stdout == here.stdout
        result = invoke("replay", "memory://swing")
        assert result.exit_code == 0
        assert result.stdout.startswith("memory://swing: ")
        result = invoke("convert", "memory://swing", "--to", "minari")
        assert result.exit_code == 2
        assert "memory://swing is a URL: name the folder to write to with --out" in result.stderr
    finally:
        files.rm("/swing", recursive=True)


@pytest.mark.parametrize(
    "command",
    [["info"], ["replay"], ["record", "--out", "film.gif", "--from"]],
)
def test_a_folder_without_a_dataset_is_one_line_and_status_2(
    command: list[str], tmp_path: Path
) -> None:
    result = invoke(*command, str(tmp_path))
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert f"{tmp_path} has no complete file of a dataset" in result.stderr


@pytest.mark.parametrize(
    "command",
    [
        ["info"],
        ["replay"],
        ["record", "--out", "film.gif", "--from"],
        ["collect", "pendulum", "swingup", "--time-limit", "0.1", "--seeds", "0:2", "--out"],
    ],
)
@pytest.mark.parametrize("forge", [_shorter, damaged, _as_a_pickle, _with_a_forged_recipe])
def test_a_forged_file_is_one_line_and_status_2(
    forge: Callable[[bytes], bytes],
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "data"
    collect("pendulum", "swingup", "zero", range(2), out=folder, time_limit=0.1)
    (path,) = folder.glob("episodes/*")
    content = path.read_bytes()
    path.write_bytes(forge(content))
    result = invoke(*command, str(folder))
    assert result.exit_code == 2
    assert result.stdout == ""
    expected = f"limberjack: {path} (is damaged or no file of a dataset|has)"
    assert re.match(expected, result.stderr), result.stderr
    assert result.stderr.count("\n") == 1
    assert not Path("film.gif").exists()


@pytest.mark.parametrize("text", ["", "[]", "[" * 100_000, '{"format": 2, "recipe": 1}'])
@pytest.mark.parametrize(
    "command",
    [
        ["info"],
        ["replay"],
        ["convert", "--to", "minari"],
        ["record", "--out", "film.gif", "--from"],
        ["collect", "pendulum", "swingup", "--time-limit", "0.1", "--seeds", "0:2", "--out"],
    ],
)
def test_a_forged_manifest_is_one_line_and_status_2(
    command: list[str], text: str, tmp_path: Path
) -> None:
    if command[0] == "convert":
        pytest.importorskip("minari", reason="needs the extra 'minari'")
    path = tmp_path / "dataset.json"
    path.write_text(text)
    result = invoke(*command, str(tmp_path))
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (2, "", 1)
    assert result.stderr.startswith(f"limberjack: {path} is damaged or no list of a dataset's")


def test_a_missing_extra_is_one_line_and_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as caught, reading_reported("info"):
        raise ImportError("needs the extra 'data': pip install fsspec pyarrow")
    assert caught.value.exit_code == 1
    expected = "limberjack: limberjack info needs the extra 'data': pip install fsspec pyarrow\n"
    assert capsys.readouterr().err == expected


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset with kinds of starts."""
    folder = tmp_path_factory.mktemp("info")
    kept = Kept(states=True)
    collect("stacker", "stack_2", "zero", range(3), out=folder, kept=kept, time_limit=0.05)
    return folder


def test_returns_sizes_versions_and_recipe_are_printed(folder: Path) -> None:
    result = invoke("info", str(folder))
    assert result.exit_code == 0, result.stderr
    for text in ("level_0", "stacker stack_2: 3 episodes of seeds 0 to 2", "pyarrow ", "states"):
        assert text in result.stdout


def test_json_has_the_hashes(folder: Path) -> None:
    found = json.loads(invoke("info", str(folder), "--json").stdout)
    assert found["sha256"] == hashes(folder)
    assert found["seeds"] == [0, 1, 2]
    assert found["returns"]["episodes"] == 3


def test_info_names_a_forged_file_in_one_line(folder: Path, tmp_path: Path) -> None:
    (path,) = copy(folder, tmp_path / "forged").glob("episodes/*")
    path.write_bytes(damaged(path.read_bytes()))
    for options, message in (([], "is damaged"), (["--verify"], "has another SHA-256 than in")):
        result = invoke("info", str(tmp_path / "forged"), *options)
        assert result.exit_code == 2
        assert result.stdout == ""
        assert result.stderr.startswith(f"limberjack: {path} {message}")
        assert result.stderr.count("\n") == 1


def test_hashes_are_compared_if_that_is_wanted(folder: Path) -> None:
    assert invoke("info", str(folder), "--verify").exit_code == 0


@pytest.mark.parametrize(
    ("command", "episodes"),
    [
        (["run", *_SHORT, "--policy", "random", "--episodes", "2"], 2),
        (["run", *_SHORT, "--policy", "random", "--action-repeat", "2"], 1),
        (["solve", "manipulator", "bring_ball", "--time-limit", "0.05", "--threads", "1"], 1),
        (["collect", *_SHORT, "--policy", "random", "--episodes", "3", "--action-repeat", "3"], 3),
    ],
)
def test_the_datasets_of_all_commands_are_replayed(
    command: list[str], episodes: int, tmp_path: Path
) -> None:
    made = invoke(*command, "--out", str(tmp_path))
    assert made.exit_code == 0, made.output
    result = invoke("replay", str(tmp_path))
    steps = 5 * episodes
    expected = f"{tmp_path}: {episodes} episodes, {steps} steps, every bit the same\n"
    assert (result.exit_code, result.stdout, result.stderr) == (0, expected, "")


def _changed(folder: Path, row: int, **facts: object) -> Path:
    """Changes the reward of a step of a dataset's episode, and the recipe's facts."""
    data.collect("pendulum", "swingup", "random", [0], out=folder, time_limit=0.1)
    (shard,) = data.load(folder).shards
    (episode,) = shard.episodes()
    rewards = episode.rewards.copy()
    rewards[row] = np.nextafter(rewards[row], 1)
    recipe = dataclasses.replace(shard.recipe, facts={**shard.recipe.facts, **facts})
    path = path_of(shard)
    path.write_bytes(encode(recipe, [dataclasses.replace(episode, rewards=rewards)]))
    return path


def test_a_changed_bit_is_one_line_and_status_1(tmp_path: Path) -> None:
    path = _changed(tmp_path, 3)
    refused = invoke("replay", str(tmp_path))
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert re.search(f"{path} has (another SHA-256|.* bytes)", refused.stderr)
    (tmp_path / "dataset.json").unlink()
    data.collect("pendulum", "swingup", "random", [0], out=tmp_path, time_limit=0.1)  # lists it
    result = invoke("replay", str(tmp_path))
    assert (result.exit_code, result.stdout) == (1, "")
    assert f"{path}, seed 0: reward of row 3 differs" in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_difference_names_other_versions_and_another_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = _changed(tmp_path, 2, versions={**versions(), "mujoco": "3.2.1"}, fingerprint="0")
    (tmp_path / "dataset.json").unlink()
    monkeypatch.setattr(
        "limberjack.data.load", lambda folder, load=data.load: load(folder, allow_gaps=True)
    )
    result = invoke("replay", str(tmp_path))
    assert result.exit_code == 1
    assert f"{path}, seed 0: reward of row 2 differs" in result.stderr
    assert "It was collected with mujoco 3.2.1, here " in result.stderr
    assert result.stderr.endswith("; a model with another fingerprint.\n")


def test_a_dataset_of_a_users_environment_needs_its_function(tmp_path: Path) -> None:
    own = ["--env", "tests.cli.environments:remembering"]
    made = invoke("collect", *own, "--policy", "random", "--episodes", "2", "--out", str(tmp_path))
    assert made.exit_code == 0, made.output
    assert invoke("replay", str(tmp_path), *own).exit_code == 0
    for arguments, message in (
        ([], "tests.cli.environments:remembering"),
        (["--env", "tests.cli.environments:delayed"], "tests.cli.environments:delayed"),
        (["--env", "tests.cli.environments:remembred"], "Did you mean 'remembering'?"),
    ):
        result = invoke("replay", str(tmp_path), *arguments)
        assert (result.exit_code, result.stdout) == (2, "")
        assert message in result.stderr
        assert result.stderr.count("\n") == 1


def test_a_recording_of_an_earlier_version_names_the_last_one_that_reads_it(tmp_path: Path) -> None:
    np.savez(tmp_path / "episode-0.npz", actions=np.zeros(3))
    for name in ("episode-0.npz", "missing.npz"):
        result = invoke("replay", str(tmp_path / name))
        assert (result.exit_code, result.stdout) == (2, "")
        assert result.stderr == (
            f"limberjack: {tmp_path / name} is a recording of an earlier version; limberjack 0.1.0 "
            "is the last one that reads it. `limberjack solve --out DIR` now writes a dataset: "
            "replay DIR\n"
        )


def test_other_files_and_folders_are_one_line_and_status_2(tmp_path: Path) -> None:
    np.save(tmp_path / "objects.npy", np.array([{}]), allow_pickle=True)
    (tmp_path / "result.json").write_text("{}")
    (tmp_path / "folder").mkdir()
    for name in ("objects.npy", "result.json", "folder", "missing"):
        result = invoke("replay", str(tmp_path / name))
        assert result.exit_code == 2, result.output
        assert result.stderr.startswith("limberjack: ")
        assert name in result.stderr
        assert "pickle" not in result.stderr
        assert result.stderr.count("\n") == 1
        assert result.stdout == ""


def test_progress_is_shown_over_all_episodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data.collect("pendulum", "swingup", "random", range(2), out=tmp_path, time_limit=0.1)
    shown: list[tuple[str, int, float]] = []

    def show(self: object, what: str, finished: int, part: float = 0.0) -> None:
        shown.append((what, finished, part))

    monkeypatch.setattr("limberjack.cli.progress.Units.show", show)
    assert invoke("replay", str(tmp_path)).exit_code == 0
    assert shown == [("replaying", 0, 2 * step / 5) for step in range(1, 6)]


def _collected(folder: Path) -> Path:
    collect("pendulum", "swingup", "zero", range(2), out=folder, time_limit=0.1)
    return folder


def test_the_place_and_the_id_are_printed(tmp_path: Path) -> None:
    pytest.importorskip("minari", reason="needs the extra 'minari'")
    folder = _collected(tmp_path / "zero")
    result = invoke("convert", str(folder), "--to", "minari")
    name = "limberjack/pendulum-swingup/zero-v0"
    expected = f'MINARI_DATASETS_PATH={folder}/minari: minari.load_dataset("{name}")\n'
    assert (result.exit_code, result.stdout) == (0, expected)
    arguments = ["--to", "minari", "--out", str(tmp_path / "root"), "--id", "mine-v1"]
    assert invoke("convert", str(folder), *arguments).exit_code == 0
    assert (tmp_path / "root" / "mine-v1" / "data" / "metadata.json").exists()


def test_a_dataset_is_converted_to_lerobots_format(tmp_path: Path) -> None:
    folder = _collected(tmp_path / "zero")
    result = invoke("convert", str(folder), "--to", "lerobot")
    expected = f'LeRobotDataset("limberjack/lerobot", root="{folder}/lerobot")\n'
    assert (result.exit_code, result.stdout) == (0, expected)
    assert (folder / "lerobot" / "meta" / "info.json").exists()
    assert len(data.load(folder)) == 2
    result = invoke("convert", str(folder), "--to", "lerobot", "--id", "mine-v1")
    assert result.exit_code == 2
    assert result.stderr == (
        "limberjack: --id names a Minari dataset, and --to is lerobot: leave it out\n"
    )


def test_without_minari_the_packages_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "minari", None)
    monkeypatch.delitem(sys.modules, "limberjack.episodes.to_minari", raising=False)
    result = invoke("convert", str(_collected(tmp_path)), "--to", "minari")
    assert result.exit_code == 1
    assert result.stderr.endswith("'minari': pip install fsspec minari pillow pyarrow\n")


def test_another_format_is_refused(tmp_path: Path) -> None:
    assert invoke("convert", str(tmp_path), "--to", "hdf5").exit_code == 2
