"""`limberjack replay`: the episodes of a dataset played again, and other files and folders."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from limberjack import data
from limberjack.episodes.parquet import encode
from limberjack.mujoco.fingerprint import versions

from .conftest import invoke

_SHORT = ["pendulum", "swingup", "--time-limit", "0.1"]


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
    shard.path.write_bytes(encode(recipe, [dataclasses.replace(episode, rewards=rewards)]))
    return shard.path


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
