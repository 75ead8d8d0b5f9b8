"""Replaying: every bit is compared."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.data import Dataset, Kept, collect, load, replay
from limberjack.episodes.parquet import encode
from limberjack.episodes.recipe import environments_of, other_versions

from .collected import EVERYTHING, copy, path_of, put


def test_an_untouched_dataset_has_no_difference(pendulums: Dataset, arms: Dataset) -> None:
    shown: list[tuple[str, int, float]] = []
    assert replay(pendulums, num_threads=1, on_progress=lambda *what: shown.append(what)) is None
    assert replay(arms, num_threads=1) is None
    assert shown[0] == ("replaying", 0, 6.4)
    assert shown[-1] == ("replaying", 64, 6.0)


def test_reduced_observations_can_be_replayed(tmp_path: Path) -> None:
    collect("reacher", "easy", "random", range(3), out=tmp_path, kept=EVERYTHING, time_limit=0.1)
    assert replay(load(tmp_path), num_threads=1) is None


def test_a_forged_length_takes_no_more_time_and_memory_than_the_episodes(
    pendulums: Dataset, tmp_path: Path
) -> None:
    facts = {**pendulums.recipe.facts, "time_limit": 4e5}
    recipe = dataclasses.replace(pendulums.recipe, facts=facts, file_mb=1e6)
    content = encode(recipe, list(pendulums.shards[0].episodes()))
    put(tmp_path, pendulums.shards[0].path.name, content)
    assert "the episode has 10 steps, and more now" in str(replay(_loaded(tmp_path), num_threads=1))


def _loaded(folder: Path) -> Dataset:
    """The dataset of a folder without a manifest, whose hashes would differ first."""
    return load(folder, allow_gaps=True)


def test_a_changed_file_is_found_by_its_hash(pendulums: Dataset, tmp_path: Path) -> None:
    path = path_of(pendulums.shards[0])
    changed = copy(path.parents[1], tmp_path / "changed") / "episodes" / path.name
    content = bytearray(changed.read_bytes())
    content[len(content) // 3] ^= 1
    changed.write_bytes(content)
    with pytest.raises(
        ValueError, match=f"{changed} has another SHA-256 than in dataset.json: repeat"
    ):
        replay(load(tmp_path / "changed"), num_threads=1)


def _with_one_bit(values: np.ndarray, row: int) -> np.ndarray:
    changed = values.copy()
    changed.reshape(len(changed), -1).view(np.uint8)[row, 0] ^= 1
    return changed


@pytest.mark.parametrize(
    ("name", "row", "message"),
    [
        ("rewards", 3, "reward of row 3 differs"),
        ("states", 5, "state of row 5 differs"),
        ("success", 1, "success of row 1 differs"),
        ("observations", 2, "observation/arm_pos of row 2 differs"),
        ("fields", 4, "field/body_pos of row 4 differs"),
        ("start", 0, "start is 'nowhere', and '"),
    ],
)
def test_one_changed_bit_is_found_with_its_file_seed_and_place(
    name: str, row: int, message: str, arms: Dataset, tmp_path: Path
) -> None:
    episode = arms.episode(64)
    value: Any = getattr(episode, name)
    if isinstance(value, dict):
        first = next(iter(value))
        value = {**value, first: _with_one_bit(value[first], row)}
    else:
        value = "nowhere" if name == "start" else _with_one_bit(value, row)
    content = encode(arms.recipe, [dataclasses.replace(episode, **{name: value})])
    path = put(tmp_path, arms.shards[1].path.name, content)
    difference = replay(_loaded(tmp_path), num_threads=1)
    assert difference is not None
    assert difference.startswith(f"{path}, seed 64: {message}")


def test_a_changed_action_shows_in_what_follows(pendulums: Dataset, tmp_path: Path) -> None:
    episodes = list(pendulums.shards[1].episodes())
    actions = episodes[2].actions.copy()
    actions[4] = -actions[4]
    episodes[2] = dataclasses.replace(episodes[2], actions=actions)
    put(tmp_path, pendulums.shards[1].path.name, encode(pendulums.recipe, episodes))
    assert "seed 66: observation/orientation of row 5 differs" in str(
        replay(_loaded(tmp_path), num_threads=1)
    )


def test_an_episode_of_another_length_is_a_difference(pendulums: Dataset, tmp_path: Path) -> None:
    whole = pendulums.episode(69)
    short = {name: values[:8] for name, values in whole.observations.items()}
    ends = np.array([False] * 6 + [True])
    assert whole.success is not None
    episode = dataclasses.replace(
        whole,
        observations=short,
        actions=whole.actions[:7],
        rewards=whole.rewards[:7],
        terminated=ends,
        truncated=np.zeros(7, bool),
        success=whole.success[:7],
    )
    put(tmp_path, "seeds-0000000069-0000000070.parquet", encode(pendulums.recipe, [episode]))
    assert "seed 69: the episode has 7 steps, and more now" in str(
        replay(_loaded(tmp_path), num_threads=1)
    )


def test_other_versions_and_another_model_are_named(pendulums: Dataset) -> None:
    recipe = pendulums.recipe
    environment, _ = environments_of(recipe)
    assert other_versions(recipe, environment) == ""
    facts = {**recipe.facts, "fingerprint": "other"}
    facts["versions"] = {**facts["versions"], "mujoco": "4.7.0"}
    found = other_versions(dataclasses.replace(recipe, facts=facts), environment)
    assert found.startswith(" It was collected with mujoco 4.7.0, here ")
    assert found.endswith("; a model with another fingerprint.")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"domain": "pendulums"}, "Domain 'pendulums' does not exist"),
        ({"task": "walk"}, "Task 'walk' does not exist"),
        ({"domain": "acrobot"}, "has other episodes here than in the dataset, whose"),
        ({"control_timestep": 0.01}, "has other episodes here"),
    ],
)
def test_a_dataset_of_another_task_than_here_is_refused(
    changes: dict[str, Any], message: str, pendulums: Dataset
) -> None:
    facts = {**pendulums.recipe.facts, **changes}
    with pytest.raises(ValueError, match=message):
        environments_of(dataclasses.replace(pendulums.recipe, facts=facts))


@pytest.mark.parametrize("steps", range(1, 60))
def test_the_length_of_episodes_survives_rounding(steps: int, pendulums: Dataset) -> None:
    facts = {**pendulums.recipe.facts, "time_limit": steps * 0.02}
    environment: Any = environments_of(dataclasses.replace(pendulums.recipe, facts=facts))[0]
    assert environment.step_limit == steps


def test_a_task_without_a_goal_is_replayed_too(tmp_path: Path) -> None:
    collect("lqr", "lqr_2_1", "random", range(2), out=tmp_path, time_limit=0.1, kept=Kept())
    dataset = load(tmp_path)
    assert next(iter(dataset)).success is None
    assert replay(dataset, num_threads=1) is None
