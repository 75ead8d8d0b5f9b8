"""Datasets in LeRobot's format, read with pandas, and with lerobot: `make test-lerobot`."""

import io
import json
import os
import subprocess
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from dm_env import specs
from PIL import Image

from limberjack.data import Dataset, collect, load
from limberjack.episodes.to_lerobot import to_lerobot
from tests.rl import odd_environments as odd

# The Python of an environment that has lerobot, whose requirements exclude those of the tests.
_PYTHON = os.environ.get("LEROBOT_PYTHON")

# Opens a dataset without the network, and prints an item, and windows of two frames.
_PROGRAM = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
name, root = "limberjack/arms", sys.argv[1]
whole = LeRobotDataset(name, root=root)
item = {key: value.tolist() for key, value in whole[7].items() if key != "task"}
deltas = {"observation.state": [-whole.meta.fps**-1, 0], "action": [0, whole.meta.fps**-1]}
windows = LeRobotDataset(name, root=root, delta_timestamps=deltas)[9]
print(json.dumps({
    "frames": len(whole), "episodes": whole.num_episodes, "fps": whole.meta.fps, "item": item,
    "task": whole[7]["task"], "size": len(whole.meta.stats["observation.state"]["mean"]),
    "padding": windows["action_is_pad"].tolist(), "windows": windows["observation.state"].tolist(),
}))
"""


class _Pictured(odd.Pole):
    """Observes three pictures of 2 by 4 pixels, whose numbers depend on the channel."""

    def get_observation(self, physics: Any) -> Any:
        place = np.abs(physics.position())[..., None, None, :] * np.arange(1, 10)
        shape = (*place.shape[:-3], 2, 4, 9)
        return {"pixels": np.broadcast_to(place * 20, shape).astype(np.uint8)}


class _Still(_Pictured):
    """Observes an array without numbers, and has no actions."""

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        return specs.BoundedArray((0,), float, -1.0, 1.0)

    def before_step(self, action: Any, physics: Any) -> None:
        pass

    def get_observation(self, physics: Any) -> Any:
        return {"nothing": physics.position()[..., :0].copy()}


def _pictured(seed: int) -> Any:
    return odd.of_task(_Pictured, seed)


def _still(seed: int) -> Any:
    return odd.of_task(_Still, seed)


def _states(dataset: Dataset) -> np.ndarray:
    """The observations before each step, joined."""
    parts = [
        np.concatenate([v[:-1].reshape(e.length, -1) for v in e.observations.values()], axis=1)
        for e in dataset
    ]
    return np.concatenate(parts).astype(np.float32)


def _frames(folder: Path) -> Any:
    files = sorted((folder / "data").rglob("*.parquet"))
    return pa.concat_tables([pq.read_table(file) for file in files]).to_pandas()


def _meta(folder: Path) -> tuple[Any, Any]:
    """The contents of info.json and stats.json."""
    info, stats = (json.loads((folder / f"meta/{n}.json").read_text()) for n in ("info", "stats"))
    return info, stats


def test_the_frames_are_the_steps(arms: Dataset, tmp_path: Path) -> None:
    to_lerobot(arms, tmp_path / "out")
    frames = _frames(tmp_path / "out")
    np.testing.assert_array_equal(np.stack(frames["observation.state"]), _states(arms))
    actions = np.concatenate([episode.actions for episode in arms]).astype(np.float32)
    np.testing.assert_array_equal(np.stack(frames["action"]), actions)
    rewards = np.concatenate([episode.rewards for episode in arms]).astype(np.float32)
    np.testing.assert_array_equal(frames["next.reward"], rewards)
    assert frames["next.done"].tolist() == [False] * 4 + [True] + [False] * 4 + [True]
    assert not frames["next.terminated"].any()
    assert "next.success" in frames
    # Times are of single precision, as in LeRobot's own datasets.
    np.testing.assert_allclose(frames["timestamp"], [*np.arange(5) * 0.01] * 2, rtol=1e-6)
    assert frames["frame_index"].tolist() == [*range(5)] * 2
    assert frames["episode_index"].tolist() == [0] * 5 + [1] * 5
    assert frames["index"].tolist() == [*range(10)]


def test_the_files_say_where_each_episode_is(pendulums: Dataset, tmp_path: Path) -> None:
    shown: list[object] = []
    to_lerobot(pendulums, tmp_path / "out", lambda *told: shown.append(told))
    assert shown == [("converting", number, 0.0) for number in range(1, 71)]
    found = pq.read_table(tmp_path / "out" / "meta" / "episodes").to_pandas()
    assert found["data/file_index"].tolist() == [0] * 64 + [1] * 6
    for _, episode in found.iterrows():
        name = f"chunk-000/file-{episode['data/file_index']:03d}.parquet"
        frames = pq.read_table(tmp_path / "out" / "data" / name).to_pandas()
        here = frames["index"][frames["episode_index"] == episode["episode_index"]].tolist()
        first, end = (int(cast(int, episode[f"dataset_{name}_index"])) for name in ("from", "to"))
        assert here == [*range(first, end)]
        assert len(here) == episode["length"] == 10
        assert list(episode["tasks"]) == ["pendulum swingup"]
    tasks = pq.read_table(tmp_path / "out" / "meta" / "tasks.parquet").to_pandas()
    assert tasks.loc["pendulum swingup", "task_index"] == 0


def test_files_beyond_those_of_a_folder_are_in_the_next_one(
    arms: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.episodes.to_lerobot._PER_CHUNK", 1)
    to_lerobot(arms, tmp_path / "out")
    found = pq.read_table(tmp_path / "out" / "meta" / "episodes").to_pandas()
    for number in range(2):
        assert found[["data/chunk_index", "data/file_index"]].iloc[number].tolist() == [number, 0]
        frames = pq.read_table(
            tmp_path / "out" / f"data/chunk-00{number}/file-000.parquet"
        ).to_pandas()
        assert frames["episode_index"].tolist() == [number] * 5


def test_info_and_statistics_are_those_of_the_dataset(arms: Dataset, tmp_path: Path) -> None:
    to_lerobot(arms, tmp_path / "out")
    meta = tmp_path / "out" / "meta"
    info, stats = _meta(tmp_path / "out")
    frames = _frames(tmp_path / "out")
    assert sorted(info["features"]) == sorted(frames.columns)
    size = len(frames["observation.state"].iloc[0])
    names = info["features"]["observation.state"]["names"]
    assert len(set(names)) == size
    assert names[0] == f"{next(iter(arms[0].observations))}.0"
    counts = ("total_episodes", "total_frames", "fps", "codebase_version")
    assert [info[name] for name in counts] == [2, 10, 100, "v3.0"]
    statistics = arms.statistics()
    assert stats["action"]["std"] == statistics.actions.std.tolist()
    assert stats["action"]["q99"] == statistics.actions.quantiles[0.99].tolist()
    assert {len(stats["observation.state"][name]) for name in ("min", "max", "q01")} == {size}
    assert json.loads((meta / "limberjack.json").read_text()) == arms.recipe.as_json()


def test_chosen_observations_alone_are_converted(arms: Dataset, tmp_path: Path) -> None:
    name = list(arms[0].observations)[1]
    to_lerobot(arms.select([name]), tmp_path / "out")
    expected = np.concatenate([one.observations[name][:-1].reshape(5, -1) for one in arms])
    frames, (info, stats) = _frames(tmp_path / "out"), _meta(tmp_path / "out")
    found = np.stack(frames["observation.state"])
    np.testing.assert_array_equal(found, expected.astype(np.float32))
    state = info["features"]["observation.state"]
    size = expected.shape[1]
    assert (state["shape"], state["names"]) == ([size], [f"{name}.{n}" for n in range(size)])
    spread = arms.statistics().observations[name]
    assert stats["observation.state"]["mean"] == spread.mean.ravel().tolist()


def test_where_only_pictures_are_observed_frames_have_the_last_of_each_stack(
    tmp_path: Path,
) -> None:
    collect(_pictured, None, "random", range(2), out=tmp_path / "in", num_threads=1)
    dataset = load(tmp_path / "in")
    to_lerobot(dataset, tmp_path / "out")
    frames, (info, stats) = _frames(tmp_path / "out"), _meta(tmp_path / "out")
    contents = frames["observation.images.pixels"]
    found = [np.asarray(Image.open(io.BytesIO(one["bytes"]))) for one in contents]
    seen = np.concatenate([episode.observations["pixels"][:-1] for episode in dataset])
    assert seen.any()
    np.testing.assert_array_equal(found, seen[..., -3:])
    assert sorted(info["features"]) == sorted(frames.columns)
    assert "observation.state" not in frames
    assert info["features"]["observation.images.pixels"]["shape"] == [2, 4, 3]
    assert sorted(stats) == ["action", "next.reward"]


def test_columns_without_numbers_are_left_out(tmp_path: Path) -> None:
    collect(_still, None, "zero", range(2), out=tmp_path / "in", num_threads=1)
    to_lerobot(load(tmp_path / "in"), tmp_path / "out")
    frames, (info, stats) = _frames(tmp_path / "out"), _meta(tmp_path / "out")
    assert sorted(info["features"]) == sorted(frames.columns)
    assert not {"action", "observation.state"} & {*frames.columns}
    assert sorted(stats) == ["next.reward"]


def test_an_earlier_conversion_is_replaced_and_nothing_else(
    arms: Dataset, pendulums: Dataset, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    for dataset in (arms, pendulums):
        to_lerobot(dataset, out)
    assert len(_frames(out)) == 700
    (out / "notes").write_text("mine")
    with pytest.raises(ValueError, match="out exists: remove it, or choose another folder"):
        to_lerobot(arms, out)
    assert (out / "notes").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_damaged_file_leaves_nothing_behind(
    damaged: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    root = tmp_path_factory.mktemp("root")
    with pytest.raises(ValueError, match="is damaged"):
        to_lerobot(load(damaged), root / "out")
    assert list(root.iterdir()) == []


@pytest.mark.skipif(_PYTHON is None, reason="needs LEROBOT_PYTHON: make test-lerobot")
def test_lerobot_opens_a_dataset(arms: Dataset, tmp_path: Path) -> None:
    assert _PYTHON is not None
    to_lerobot(arms, tmp_path / "out")
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [_PYTHON, "-c", _PROGRAM, str(tmp_path / "out")],
        env={**kept, "HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    states = _states(arms)
    assert (found["frames"], found["episodes"], found["fps"]) == (10, 2, 100)
    assert (found["task"], found["size"]) == ("manipulator bring_ball", states.shape[1])
    assert found["item"]["observation.state"] == states[7].tolist()
    assert found["item"]["action"] == arms[1].actions[2].astype(np.float32).tolist()
    assert found["item"]["episode_index"] == 1
    assert found["padding"] == [False, True]
    assert found["windows"] == states[8:10].tolist()
