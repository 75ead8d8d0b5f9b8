"""`limberjack replay`: recorded episodes played again, and files that are not recordings."""

import contextlib
import dataclasses
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
import typer.testing
from limberjack.recording.episodes import Recording, record_episode

from limberjack import data, suite
from limberjack.cli import app
from limberjack.episodes.parquet import encode
from limberjack.mujoco.camera import RenderingError
from limberjack.mujoco.fingerprint import versions

_SOLVE = ["solve", "manipulator", "bring_ball", "--time-limit", "0.1", "--threads", "1"]


def _invoke(*arguments: str) -> Any:
    return typer.testing.CliRunner().invoke(app, list(arguments))


def test_replay_reports_the_first_step_that_differs(tmp_path: Path) -> None:
    _invoke(*_SOLVE, "--out", str(tmp_path))
    path = tmp_path / "episode-0.npz"
    recording = Recording.load(path)
    recording.actions[4] = -recording.actions[4] + 0.1
    recording.about["versions"]["mujoco"] = "3.2.1"
    recording.about["fingerprint"] = "0"
    recording.save(path)
    result = _invoke("replay", str(path), "--out", str(tmp_path / "again"))
    assert result.exit_code == 1
    assert not list((tmp_path / "again").iterdir())
    assert "step 4: the state differs from the recorded one" in result.stderr
    assert "It was recorded with mujoco 3.2.1, here" in result.stderr
    assert "; a model with another fingerprint." in result.stderr


def test_a_recording_of_another_patch_version_is_replayed(tmp_path: Path) -> None:
    _invoke(*_SOLVE, "--out", str(tmp_path))
    path = tmp_path / "episode-0.npz"
    recording = Recording.load(path)
    series, _, patch = recording.about["versions"]["mujoco"].rpartition(".")
    recording.about["versions"]["mujoco"] = f"{series}.{patch}7"
    recording.save(path)
    result = _invoke("replay", str(path), "--out", str(tmp_path / "again"))
    assert result.exit_code == 0, result.stderr
    assert "every bit the same" in result.stdout
    written = json.loads((tmp_path / "again" / "result.json").read_text(encoding="utf-8"))
    assert written["versions"] == versions()


def test_replay_writes_what_a_run_writes_but_not_over_the_recordings_own(tmp_path: Path) -> None:
    _invoke(*_SOLVE, "--out", str(tmp_path))
    before = (tmp_path / "result.json").read_bytes()
    path = tmp_path / "episode-0.npz"
    result = _invoke("replay", str(path), "--out", str(tmp_path))
    assert result.exit_code == 2
    assert (
        "which holds episode-0.npz and the result.json of its run: choose another folder"
        in result.stderr
    )
    assert (tmp_path / "result.json").read_bytes() == before
    assert _invoke("replay", str(path), "--out", str(tmp_path / "again")).exit_code == 0
    found = json.loads((tmp_path / "again" / "result.json").read_text())["episodes"]
    assert found == json.loads(before)["episodes"]


def test_a_recording_that_a_program_made_can_be_filmed(tmp_path: Path) -> None:
    env = suite.load("stacker", "stack_2", {"random": 1, "time_limit": 0.1})
    about = {"domain": "stacker", "task": "stack_2", "time_limit": 0.1}
    record_episode(env, lambda: np.zeros(5), about).save(tmp_path / "mine.npz")
    result = _invoke("replay", str(tmp_path / "mine.npz"), "--out", str(tmp_path / "out"))
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["solve", "manipulator", "bring_bal"], "Did you mean 'bring_ball'?"),
        ([*_SOLVE, "--time-limit", "inf"], "--time-limit is inf; expected a number of seconds"),
        ([*_SOLVE, "--seed", str(2**32 - 1), "--episodes", "2"], "the last episode's seed is"),
        (["replay", "nothing.npz"], "nothing.npz"),
    ],
)
def test_arguments_that_cannot_be_played_are_refused(arguments: list[str], message: str) -> None:
    result = _invoke(*arguments)
    assert result.exit_code == 2
    assert message in result.stderr


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ({"domain": ["stacker"]}, "cannot be played: its domain is ['stacker']"),
        ({"task": None}, "cannot be played: its task is None"),
        ({"task": "stack_3"}, "Did you mean"),
        ({"time_limit": None}, "cannot be played: its time_limit is None"),
        ({"time_limit": True}, "cannot be played: its time_limit is True"),
        ({"time_limit": float("nan")}, "cannot be played: its time_limit is nan; expected seconds"),
        ({"time_limit": float("inf")}, "cannot be played: its time_limit is inf; expected seconds"),
        ({"time_limit": -1}, "cannot be played: its time_limit is -1; expected seconds"),
        ({"time_limit": 10**400}, "expected seconds"),
        ({"seed": "3"}, "cannot be played: its seed is '3'"),
        ({"versions": ["4.0.0"]}, "cannot be played: its versions is ['4.0.0']"),
        ({"fingerprint": 7}, "cannot be played: its fingerprint is 7"),
        ({"domain": "humanoid", "task": "stand"}, "it is of another task or model"),
    ],
)
def test_a_forged_recording_is_one_line_and_status_2(
    about: dict[str, Any], message: str, tmp_path: Path
) -> None:
    env = suite.load("stacker", "stack_2", {"random": 1, "time_limit": 0.05})
    facts = {"domain": "stacker", "task": "stack_2", "time_limit": 0.05, **about}
    path = tmp_path / "forged.npz"
    record_episode(env, lambda: np.zeros(5), facts).save(path)
    result = _invoke("replay", str(path), "--out", str(tmp_path / "out"))
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("limberjack: ")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("name", ["actions", "rewards", "states"])
def test_arrays_of_other_shapes_are_one_line(name: str, tmp_path: Path) -> None:
    env = suite.load("stacker", "stack_2", {"random": 1, "time_limit": 0.05})
    about = {"domain": "stacker", "task": "stack_2", "time_limit": 0.05}
    recording = record_episode(env, lambda: np.zeros(5), about)
    wide = np.repeat(getattr(recording, name)[:, None], 2, axis=1)
    path = tmp_path / "forged.npz"
    dataclasses.replace(recording, **{name: wide}).save(path)
    result = _invoke("replay", str(path))
    assert result.exit_code == (1 if name == "states" else 2), result.output
    assert result.stderr.count("\n") == 1


def test_a_damaged_file_is_one_line_and_status_2(tmp_path: Path) -> None:
    path = tmp_path / "damaged.npz"
    for content in (b"", b"PK\x03\x04", b"\x93NUMPY", bytes(1000)):
        path.write_bytes(content)
        result = _invoke("replay", str(path))
        assert result.exit_code == 2, result.output
        assert result.stderr.startswith(f"limberjack: {path} is no recording of an episode")
        assert result.stderr.count("\n") == 1


def test_a_recording_that_lacks_its_task_is_refused(tmp_path: Path) -> None:
    states = np.zeros((2, 5))
    Recording({}, {}, states[:1], np.zeros(1), states, {}).save(tmp_path / "bare.npz")
    result = _invoke("replay", str(tmp_path / "bare.npz"))
    assert result.exit_code == 2
    assert "cannot be played: it lacks its domain, task, time_limit" in result.stderr


def test_other_files_and_folders_are_one_line_and_status_2(tmp_path: Path) -> None:
    np.savez(tmp_path / "arrays.npz", actions=np.zeros(3))
    np.save(tmp_path / "objects.npy", np.array([{}]), allow_pickle=True)
    (tmp_path / "result.json").write_text("{}")
    (tmp_path / "folder").mkdir()
    for name in ("arrays.npz", "objects.npy", "result.json", "folder", "missing.npz"):
        result = _invoke("replay", str(tmp_path / name), "--out", str(tmp_path / "out"))
        assert result.exit_code == 2, result.output
        assert result.stderr.startswith("limberjack: ")
        assert name in result.stderr
        assert "pickle" not in result.stderr
        assert result.stderr.count("\n") == 1
        assert result.stdout == ""
    assert not (tmp_path / "out").exists()


def test_replay_shows_each_step_and_times_its_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _invoke(*_SOLVE, "--out", str(tmp_path))
    shown: list[tuple[int, int, int]] = []
    drawn: list[int] = []

    class Progress:
        def show(self, finished: int, steps: int, step_limit: int, total: float) -> None:
            shown.append((finished, steps, step_limit))

        @contextlib.contextmanager
        def drawing(self) -> Iterator[None]:
            yield
            drawn.append(shown[-1][1])

    @contextlib.contextmanager
    def show_episodes(episodes: int, filmed: bool) -> Iterator[Progress]:
        assert (episodes, filmed) == (1, True)
        yield Progress()

    monkeypatch.setattr("limberjack.cli.replay.show_episodes", show_episodes)
    result = _invoke("replay", str(tmp_path / "episode-0.npz"), "--out", str(tmp_path / "again"))
    assert result.exit_code == 0, result.output
    assert shown == [(0, step, 10) for step in range(11)]
    assert drawn == list(range(11))


def test_the_first_frame_of_a_replayed_film_shows_the_start(tmp_path: Path) -> None:
    env = suite.load("manipulator", "bring_ball", {"random": 0})
    env.reset()
    try:
        picture = env.physics.render(480, 640, camera_id=0)
    except RenderingError as error:
        pytest.skip(f"no OpenGL here: {error}")
    _invoke(*_SOLVE, "--out", str(tmp_path))
    _invoke("replay", str(tmp_path / "episode-0.npz"), "--out", str(tmp_path / "again"))
    raw = ["-frames:v", "1", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-i", tmp_path / "again" / "video.mp4", *raw],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=True,
    )
    frame = np.frombuffer(done.stdout, np.uint8).reshape(480, 640, 3)
    assert np.abs(frame.astype(int) - picture.astype(int)).mean() < 8  # H.264 loses detail


def test_the_episodes_of_a_dataset_are_replayed(tmp_path: Path) -> None:
    data.collect("pendulum", "swingup", "random", range(2), out=tmp_path, time_limit=0.1)
    result = _invoke("replay", str(tmp_path))
    expected = f"{tmp_path}: 2 episodes, 10 steps, every bit the same\n"
    assert (result.exit_code, result.stdout) == (0, expected)
    refused = _invoke("replay", str(tmp_path), "--out", str(tmp_path / "again"))
    assert refused.exit_code == 2
    assert "`limberjack record --from" in refused.stderr


def test_a_changed_bit_of_a_dataset_is_one_line_and_status_1(tmp_path: Path) -> None:
    data.collect("pendulum", "swingup", "random", [0], out=tmp_path, time_limit=0.1)
    (shard,) = data.load(tmp_path).shards
    (episode,) = shard.episodes()
    rewards = episode.rewards.copy()
    rewards[3] = np.nextafter(rewards[3], 1)
    shard.path.write_bytes(encode(shard.recipe, [dataclasses.replace(episode, rewards=rewards)]))
    refused = _invoke("replay", str(tmp_path))
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert re.search(f"{shard.path} has (another SHA-256|.* bytes)", refused.stderr)
    (tmp_path / "dataset.json").unlink()
    data.collect("pendulum", "swingup", "random", [0], out=tmp_path, time_limit=0.1)  # lists it
    result = _invoke("replay", str(tmp_path))
    assert (result.exit_code, result.stdout) == (1, "")
    assert f"{shard.path}, seed 0: reward of row 3 differs" in result.stderr
    assert result.stderr.count("\n") == 1
