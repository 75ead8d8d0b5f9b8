"""`limberjack solve`: episodes of the planner, by workers and shards, continued after a kill."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from limberjack import data

from .conftest import invoke, leave_out_films

_TASK = ["manipulator", "bring_ball", "--time-limit", "0.05"]
_SOLVE = ["solve", *_TASK, "--episodes", "3"]
_PLAYED = {"result.json", "return.png", "video.mp4", "report.html"}


@pytest.fixture(scope="module", autouse=True)
def _no_films() -> Iterator[None]:
    """Leaves out the films; test_run.py has some."""
    with pytest.MonkeyPatch.context() as patch:
        leave_out_films(patch)
        yield


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
    """All but the page and the log, which have the command."""
    paths = [path for path in directory.rglob("*") if path.is_file()]
    named = {str(path.relative_to(directory)): path.read_bytes() for path in paths}
    return {name: one for name, one in named.items() if name not in ("report.html", "run.json")}


def _played(directory: Path) -> list[int]:
    """The number of episodes that each call had to play."""
    return [one["episodes"] for one in json.loads((directory / "run.json").read_text())["calls"]]


def _returns(directory: Path) -> dict[int, float]:
    content = json.loads((directory / "result.json").read_text())
    return {episode["seed"]: episode["return"] for episode in content["episodes"]}


def test_solve_keeps_episodes_that_replay_plays_again(tmp_path: Path) -> None:
    arguments = ["solve", *_TASK, "--threads", "1", "--seeds", "3:5", "--out", str(tmp_path)]
    result = invoke(*arguments)
    assert result.exit_code == 0, result.output
    dataset = data.load(tmp_path)
    assert list(dataset.seeds) == [3, 4]
    assert _returns(tmp_path) == {episode.seed: episode.total for episode in dataset}
    facts = dataset.recipe.facts
    assert (facts["task"], facts["policy"], facts["action_repeat"]) == ("bring_ball", "planner", 1)
    assert {"policy_sha256", "fingerprint", "versions"} <= facts.keys()
    for episode in dataset:
        assert f"{episode.total:.3f}" in result.stdout
        assert episode.states is not None
    replayed = invoke("replay", str(tmp_path))
    assert replayed.exit_code == 0, replayed.output
    assert replayed.stdout == f"{tmp_path}: 2 episodes, 10 steps, every bit the same\n"


def test_solve_shows_the_same_numbers_without_files() -> None:
    first, second = (invoke("solve", *_TASK, "--threads", "1") for _ in range(2))
    assert first.exit_code == 0
    assert first.stdout == second.stdout
    assert len(first.stdout.splitlines()) == 3


def test_workers_write_the_same_bytes_as_one_process(whole: Path, tmp_path: Path) -> None:
    result = _solve(tmp_path, "--workers", "2")
    assert _files(tmp_path) == _files(whole)
    assert (tmp_path / "report.html").exists()
    assert result.stdout.splitlines()[-1] == str(tmp_path / "episodes")
    for total in _returns(whole).values():
        assert f" {total:.3f} " in result.stdout


def test_other_seeds_add_to_the_folder_and_only_they_are_played(
    whole: Path, tmp_path: Path
) -> None:
    first = ["solve", *_TASK, "--threads", "1", "--out", str(tmp_path)]
    assert invoke(*first).exit_code == 0
    assert _played(tmp_path) == [1]
    _solve(tmp_path, "--threads", "2")
    assert _played(tmp_path) == [1, 2]
    assert _returns(tmp_path) == _returns(whole)
    assert list(data.load(tmp_path).seeds) == [0, 1, 2]
    before = _files(tmp_path)
    _solve(tmp_path, "--threads", "1")
    assert _played(tmp_path) == [1, 2]
    assert _files(tmp_path) == before


# Ends its process as the second episode begins.
_KILLED = """
import os, signal
from limberjack.cli import main
from limberjack.episodes import collecting

def kill(saving, step, watch=collecting._Saving.on_step):
    if step.actions is None and 1 in step.seeds:
        saving._wait()
        os.kill(os.getpid(), signal.{signal})
    watch(saving, step)

collecting._Saving.on_step = kill
main()
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGKILL"])
def test_the_same_command_plays_only_what_is_missing_after_a_kill(
    name: str, whole: Path, tmp_path: Path
) -> None:
    program = _KILLED.format(signal=name)
    done = subprocess.run(
        [sys.executable, "-c", program, *_SOLVE, "--threads", "1", "--out", tmp_path],
        env={**os.environ, "MUJOCO_GL": "disable"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == (130 if name == "SIGINT" else -signal.SIGKILL), done.stderr
    parts = [path.name for path in (tmp_path / "parts").glob("seeds-*.part")]
    assert parts == ["seeds-0000000000-0000000001.part"]
    if name == "SIGINT":
        assert list(_returns(tmp_path)) == [0]
        assert done.stderr.endswith(
            f"limberjack: interrupted: 1 of 3 episodes finished; what is kept in {tmp_path} is not "
            "played again\n"
        )
    _solve(tmp_path, "--threads", "2")
    assert _played(tmp_path) == [3, 2]
    assert _files(tmp_path) == _files(whole)


def test_shards_keep_steps_that_the_plain_command_joins(tmp_path: Path) -> None:
    joined, alone = tmp_path / "joined", tmp_path / "alone"
    seeds = ["solve", "manipulator", "bring_ball", "--time-limit", "0.02", "--seeds", "63:66"]
    for shard, episodes in (("2/2", 2), ("1/2", 1)):
        result = invoke(*seeds, "--shard", shard, "--threads", "1", "--out", str(joined))
        assert result.exit_code == 0, result.output
        assert result.stdout.splitlines()[-1] == (
            f"shard {shard}: {episodes} episodes are in {joined}; the same command without "
            "--shard joins all shards"
        )
        assert not _PLAYED & {path.name for path in joined.iterdir()}
    for out in (joined, alone):
        assert invoke(*seeds, "--threads", "1", "--out", str(out)).exit_code == 0
    assert _played(alone) == [3]
    assert not (joined / "run.json").exists()  # nothing was missing
    assert _files(joined).keys() - _files(alone).keys() == {"run-1-of-2.json", "run-2-of-2.json"}
    for name, content in _files(alone).items():
        assert (joined / name).read_bytes() == content, name


def test_a_shard_needs_the_extra_that_keeps_steps(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['pyarrow'] = None\n"
        f"sys.argv[1:] = {[*_SOLVE, '--shard', '1/1', '--out', 'out']!r}\n"
        "from limberjack.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 2
    assert done.stderr == (
        "limberjack: a shard keeps steps, which needs the extra 'data': "
        "pip install fsspec pyarrow\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_shard_without_episodes_writes_nothing(tmp_path: Path) -> None:
    result = _solve(tmp_path / "out", "--shard", "1/2")
    assert result.stdout.startswith("shard 1/2 has no episode")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--time-limit", "0.1"], "belongs to another dataset than the one asked for, whose time_"),
        (["--workers", "2", "--time-limit", "0.1"], "whose time_limit is 0.05 and 0.1: choose"),
        (["--time-limit", "inf"], "has no time limit, so an episode might never end"),
        (["--shard", "2/1"], "--shard is '2/1'; expected K/N with K from 1 to N"),
        (["--seeds", "4294967295:4294967297"], "expected numbers up to 4294967295"),
    ],
)
def test_what_cannot_be_played_is_one_line_and_status_2(
    options: list[str], message: str, whole: Path
) -> None:
    before = _files(whole)
    result = _solve(whole, *options, status=2)
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
    assert _files(whole) == before


def test_an_unknown_task_is_status_2_with_a_suggestion() -> None:
    result = invoke("solve", "manipulator", "bring_bal")
    assert result.exit_code == 2
    assert "Did you mean 'bring_ball'?" in result.stderr


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["evaluate", "--seeds", "0:2"], "holds an evaluation: choose another folder"),
        (["run"], "holds results with policy 'zero', and these have 'planner'"),
        (["collect", "--seeds", "0:2"], "belongs to another dataset than the one asked for, whose"),
    ],
)
def test_solve_refuses_the_folder_of_another_command(
    command: list[str], message: str, tmp_path: Path
) -> None:
    done = invoke(command[0], *_TASK, *command[1:], "--out", str(tmp_path))
    assert done.exit_code == 0, done.output
    before = _files(tmp_path)
    result = _solve(tmp_path, status=2)
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert _files(tmp_path) == before


def test_solve_refuses_other_results_and_they_refuse_it(whole: Path) -> None:
    before = _files(whole)
    other = invoke("solve", "stacker", "stack_2", "--time-limit", "0.05", "--out", str(whole))
    assert other.exit_code == 2
    assert "holds results with domain 'manipulator', and these have 'stacker'" in other.stderr
    run = invoke("run", *_TASK, "--policy", "random", "--out", str(whole))
    assert run.exit_code == 2
    evaluated = invoke("evaluate", *_TASK, "--seeds", "0:2", "--out", str(whole))
    assert evaluated.exit_code == 2
    assert _files(whole) == before


def test_episodes_of_another_planner_or_processor_are_refused_by_name(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = ["solve", *_TASK, "--threads", "1", "--out", str(tmp_path)]
    assert invoke(*first).exit_code == 0
    with monkeypatch.context() as patch:
        patch.setattr("limberjack.policies.built_in.hash_of_files", lambda files: "0" * 64)
        result = _solve(tmp_path, "--threads", "1", status=2)
    assert "belongs to another dataset than the one asked for, whose policy_sha256 is" in (
        result.stderr
    )
    run = tmp_path / "run.json"
    log = json.loads(run.read_text())
    kept, log["calls"][0]["canary"] = log["calls"][0]["canary"], "0"
    run.write_text(json.dumps(log))
    result = _solve(tmp_path, "--threads", "1", status=2)
    expected = f"collected with canary '0', and this call has '{kept}': choose another folder"
    assert expected in result.stderr
    assert _played(tmp_path) == [1]
    _solve(tmp_path, "--threads", "1", "--any-processor")
    assert _returns(tmp_path) == _returns(whole)
    assert all(one["processor"] for one in json.loads(run.read_text())["calls"])


def test_solve_explains_its_plans_by_stage_and_terms(tmp_path: Path) -> None:
    tower = ["solve", "stacker", "stack_2", "--time-limit", "0.03", "--threads", "1", "--explain"]
    result = invoke(*tower, "--out", str(tmp_path))
    assert result.exit_code == 0, result.output
    first = result.stdout.splitlines()[0]
    assert first.startswith("  0.00 s  wait beside falling boxes: reward ")
    assert "falling boxes" in first.split(": ", 1)[1]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    plans = page.partition("Plans of the first episode")[2]
    assert "falling boxes" in plans
    assert "wait beside falling boxes</td>" in plans
    silent = invoke(*tower[:-1], "--out", str(tmp_path / "silent"))
    assert silent.exit_code == 0, silent.output
    assert _returns(tmp_path / "silent") == _returns(tmp_path)


def test_solve_plays_with_faults_and_an_appearance_as_part_of_the_identity(tmp_path: Path) -> None:
    short = ["solve", "cartpole", "balance", "--time-limit", "0.03", "--threads", "1"]
    short += ["--out", str(tmp_path), "--explain"]
    result = invoke(*short, "--faults", "easy", "--appearance", '{"colors": "easy"}')
    assert result.exit_code == 0, result.output
    world = json.loads((tmp_path / "result.json").read_text())["world"]
    assert world["faults"]["delay"]["actions"] == 3
    assert world["appearance"] == {"colors": 0.1}
    other = invoke(*short, "--faults", "medium")
    assert other.exit_code == 2
    assert "world" in other.stderr
    assert len(other.stderr.splitlines()) == 1


@pytest.mark.parametrize("command", ["run", "solve"])
def test_the_options_say_who_plays(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: dict[str, Any] = {}

    def refuse(*arguments: object, **options: object) -> None:
        taken.update(options)
        raise ValueError("enough")

    monkeypatch.setattr("limberjack.episodes.running.Run", refuse)
    more = ["--workers", "3", "--ray", "--any-processor"] if command == "solve" else []
    assert invoke(command, *_TASK, "--threads", "2", *more).exit_code == 2
    scale = taken["scale"]
    assert (scale.num_threads, scale.executor) == (2, None)
    expected = (3, "local", True) if command == "solve" else (None, None, False)
    assert (scale.workers, scale.ray, scale.any_processor) == expected
    assert scale.on_state is not None
