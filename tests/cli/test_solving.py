"""`limberjack solve` with workers and shards, and continuing what is there."""

import json
from pathlib import Path
from typing import Any

import pytest

from limberjack.recording.episodes import Recording

from .conftest import invoke

_SOLVE = ["solve", "manipulator", "bring_ball", "--time-limit", "0.05", "--episodes", "3"]


def _solve(out: Path, *options: str, status: int = 0) -> Any:
    result = invoke(*_SOLVE, *options, "--out", str(out))
    assert result.exit_code == status, result.output
    return result


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of three episodes that one process has played."""
    directory = tmp_path_factory.mktemp("whole")
    _solve(directory, "--threads", "1")
    return directory


def _files(directory: Path) -> dict[str, bytes]:
    """All but the page, which names the command."""
    return {p.name: p.read_bytes() for p in directory.iterdir() if p.suffix != ".html"}


def test_workers_write_the_same_files(whole: Path, tmp_path: Path) -> None:
    result = _solve(tmp_path, "--workers", "2")
    assert _files(tmp_path) == _files(whole)
    assert (tmp_path / "report.html").exists()
    names = [Path(line).name for line in result.stdout.splitlines() if line.startswith("/")]
    assert names[-3:] == ["episode-0.npz", "episode-1.npz", "episode-2.npz"]


def test_the_same_command_plays_only_what_is_missing(whole: Path, tmp_path: Path) -> None:
    for name in ("episode-0.npz", "episode-2.npz"):
        (tmp_path / name).write_bytes((whole / name).read_bytes())
    before = (tmp_path / "episode-2.npz").stat().st_mtime_ns
    _solve(tmp_path, "--threads", "2")
    assert (tmp_path / "episode-2.npz").stat().st_mtime_ns == before
    assert _files(tmp_path) == _files(whole)


def test_shards_write_recordings_that_the_plain_command_joins(whole: Path, tmp_path: Path) -> None:
    result = _solve(tmp_path, "--shard", "1/1", "--threads", "1")
    assert result.stdout.splitlines()[-1] == (
        f"shard 1/1: 3 recordings are in {tmp_path}; the same command without --shard joins all "
        "shards"
    )
    assert {path.suffix for path in tmp_path.iterdir()} == {".npz"}
    _solve(tmp_path, "--threads", "1")
    assert _files(tmp_path) == _files(whole)


def test_a_shard_without_episodes_writes_nothing(tmp_path: Path) -> None:
    result = _solve(tmp_path / "out", "--shard", "1/2")
    assert result.stdout.startswith("shard 1/2 has no episode")
    assert not (tmp_path / "out").exists()


def test_recordings_name_all_that_they_depend_on(whole: Path) -> None:
    about = Recording.load(whole / "episode-1.npz").about
    assert {"policy_sha256", "canary", "fingerprint", "versions"} <= about.keys()
    assert about["seed"] == 1
    episodes = json.loads((whole / "result.json").read_text())["episodes"]
    assert about["start"] == episodes[1]["start"]
    assert "processor" not in about


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--time-limit", "0.1"], "was recorded with time_limit 0.05, and this call has 0.1: "),
        (["--shard", "2/1"], "--shard is '2/1'; expected K/N with K from 1 to N"),
        # Before a list of them is made, which would fill the memory.
        (["--episodes", "1000000000000"], "the last episode's seed is 999999999999; expected"),
        (["--episodes", "1000000000000", "--shard", "1/2"], "the last episode's seed is"),
        (["--workers", "2", "--time-limit", "0.1"], "was recorded with time_limit 0.05"),
    ],
)
def test_what_cannot_be_joined_is_one_line_and_status_2(
    options: list[str], message: str, whole: Path
) -> None:
    before = _files(whole)
    result = _solve(whole, *options, status=2)
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert _files(whole) == before


def test_a_recording_under_the_name_of_another_seed_is_refused(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "episode-2.npz").write_bytes((whole / "episode-1.npz").read_bytes())
    result = _solve(tmp_path, status=2)
    assert "episode-2.npz was recorded with seed 1, and this call has 2: " in result.stderr


def test_recordings_of_another_planner_or_processor_are_refused_by_name(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = Recording.load(whole / "episode-0.npz")
    for name in ("policy_sha256", "canary"):
        recording.about[name], kept = "0", recording.about[name]
        recording.save(tmp_path / "episode-0.npz")
        result = _solve(tmp_path, status=2)
        assert f"was recorded with {name} '0', and this call has '{kept}'" in result.stderr
        recording.about[name] = kept
    recording.about["canary"] = "0"
    recording.save(tmp_path / "episode-0.npz")
    _solve(tmp_path, "--any-processor", "--threads", "1")
    about = Recording.load(tmp_path / "episode-1.npz").about
    assert about["processor"]
    result = json.loads((tmp_path / "result.json").read_text())
    assert [episode["seed"] for episode in result["episodes"]] == [0, 1, 2]
