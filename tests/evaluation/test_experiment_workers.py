"""Evaluations with workers and shards: the same files, whoever plays and dies."""

import concurrent.futures
import errno
import functools
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from limberjack import suite
from limberjack.evaluation import Evaluation, evaluate
from limberjack.evaluation.experiment import play_unit
from limberjack.evaluation.store import Store
from limberjack.suite.base import kind_of_start
from limberjack.workers import WorkError, prepare
from tests.workers.killing import children, is_alive, wait_for
from tests.workers.playing import TASK

_SEEDS = range(60, 200)  # four units
_POLICIES = "tests.workers.playing"
_evaluate = functools.partial(evaluate, *TASK, seeds=_SEEDS, time_limit=0.1)


def _files(directory: Path) -> tuple[list[bytes], bytes]:
    """The lines of episodes.jsonl in order, and result.json."""
    lines = (directory / "episodes.jsonl").read_bytes().splitlines()
    return [lines[0], *sorted(lines[1:])], (directory / "result.json").read_bytes()


@pytest.fixture(scope="module", autouse=True)
def _no_pictures() -> Iterator[None]:
    """Pictures take longer to draw than these episodes to play."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "matplotlib.figure", None)
        yield


@pytest.fixture(scope="module", params=["Memory", "BatchedMemory", "damped"])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A policy, and the folder of its evaluation in one process, with zero and random actions."""
    policy, directory = f"{_POLICIES}:{request.param}", tmp_path_factory.mktemp("whole")
    _evaluate(policy=policy, out=directory, num_threads=1)
    return policy, directory


@pytest.mark.parametrize("whole", ["Memory"], indirect=True)
def test_two_workers_write_the_same_files(whole: tuple[str, Path], tmp_path: Path) -> None:
    policy, directory = whole
    _evaluate(policy=policy, out=tmp_path, workers=2)
    assert _files(tmp_path) == _files(directory)


@pytest.mark.parametrize("whole", ["BatchedMemory"], indirect=True)
def test_four_units_at_a_time_in_an_executor_write_the_same_files(
    whole: tuple[str, Path], tmp_path: Path
) -> None:
    policy, directory = whole
    with concurrent.futures.ThreadPoolExecutor(4) as executor:
        _evaluate(policy=policy, out=tmp_path, executor=executor)
    assert _files(tmp_path) == _files(directory)


def test_three_shards_are_joined_to_the_same_files(whole: tuple[str, Path], tmp_path: Path) -> None:
    policy, directory = whole
    for number in (3, 1, 2):
        _evaluate(policy=policy, out=tmp_path, shard=(number, 3), num_threads=1)
    assert not (tmp_path / "episodes.jsonl").exists()
    played: list[object] = []
    _evaluate(policy=policy, out=tmp_path, on_progress=lambda *now: played.append(now))
    assert played == []
    assert _files(tmp_path) == _files(directory)


def test_the_planner_is_the_same_on_one_thread_and_on_workers(tmp_path: Path) -> None:
    play = functools.partial(evaluate, "pendulum", "swingup", "planner", range(3), time_limit=0.1)
    play(out=tmp_path / "one", num_threads=2)
    play(out=tmp_path / "workers", workers=2)
    assert _files(tmp_path / "workers") == _files(tmp_path / "one")


def test_a_unit_has_the_kinds_of_starts_of_full_episodes() -> None:
    setup = prepare("manipulator", "bring_ball", "random", time_limit=0.05)
    scores = play_unit(setup, tuple(range(8)))
    environment = suite.load("manipulator", "bring_ball")
    for score in scores:
        environment.reseed(score.seed)
        environment.reset()
        assert score.start == kind_of_start(environment)
        assert score.processor is None
    assert len({score.start for score in scores}) > 1


@pytest.mark.parametrize("whole", ["damped"], indirect=True)
def test_an_interrupted_evaluation_continues_with_workers(
    whole: tuple[str, Path], tmp_path: Path
) -> None:
    policy, directory = whole
    lines = (directory / "episodes.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "episodes.jsonl").write_bytes(b"".join(lines[:100]) + lines[100][:20])
    with concurrent.futures.ThreadPoolExecutor(2) as executor:
        _evaluate(policy=policy, out=tmp_path, executor=executor)
    assert _files(tmp_path) == _files(directory)


def test_the_other_units_are_kept_where_a_policy_fails(tmp_path: Path) -> None:
    with pytest.raises(WorkError) as caught:
        _evaluate(policy=f"{_POLICIES}:Unlucky", out=tmp_path, workers=1)
    text = str(caught.value)
    assert text.startswith(
        f"policy '{_POLICIES}:Unlucky', step 2 of the episode with seed 64: KeyError: "
        "'no such\\nthing' ("
    )
    assert text.endswith(f", in act_batch); on node {socket.gethostname()}")
    lines = (tmp_path / "episodes.jsonl").read_text().splitlines()[1:]
    assert sorted(json.loads(line)["seed"] for line in lines) == [60, 61, 62, 63]
    assert not (tmp_path / "result.json").exists()


def test_a_full_disk_ends_the_evaluation_and_leaves_whole_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, written = Store._write, 0

    def full(store: Store, entry: Any) -> None:
        nonlocal written
        written += 1
        if written == 100:
            raise OSError(errno.ENOSPC, "No space left on device", str(store.path))
        write(store, entry)

    monkeypatch.setattr(Store, "_write", full)
    with (
        concurrent.futures.ThreadPoolExecutor(2) as executor,
        pytest.raises(OSError, match="No space left on device"),
    ):
        _evaluate(out=tmp_path, executor=executor)
    monkeypatch.undo()
    assert [path.name for path in tmp_path.iterdir()] == ["episodes.jsonl"]
    _evaluate(out=tmp_path, num_threads=1)
    _evaluate(out=tmp_path / "whole", num_threads=1)
    assert _files(tmp_path) == _files(tmp_path / "whole")


def test_any_processor_names_the_processor_of_each_episode(tmp_path: Path) -> None:
    evaluation = _evaluate(out=tmp_path, any_processor=True, num_threads=1)
    result = json.loads((tmp_path / "result.json").read_text())
    (processor,) = {episode["processor"] for episode in result["episodes"]}
    assert processor
    assert set(result["floors"]["random"]["processors"]) == {processor}
    with concurrent.futures.ThreadPoolExecutor(2) as executor:
        again = _evaluate(executor=executor, any_processor=True)
    assert again.scores == evaluation.scores


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"shard": (1, 3)}, "a shard needs a folder that all shards write to"),
        ({"shard": (4, 3), "out": "out"}, "shard is 4/3; expected K/N with K from 1 to N"),
        ({"workers": 2, "policy": lambda o: [0.0]}, "other processes cannot import by that name"),
    ],
)
def test_what_cannot_be_shared_out_is_refused(
    arguments: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=message):
        _evaluate(**arguments)
    assert not list(tmp_path.iterdir())


def test_a_shard_without_seeds_writes_no_episode(tmp_path: Path) -> None:
    evaluation = _evaluate(shard=(1, 9), out=tmp_path)
    assert isinstance(evaluation, Evaluation)
    assert evaluation.scores == {"zero": [], "random": []}
    assert len((tmp_path / "episodes-1-of-9.jsonl").read_text().splitlines()) == 1


# As a program, which is killed.


def _begin(out: Path, **variables: str) -> "subprocess.Popen[str]":
    arguments = ["--policy", f"{_POLICIES}:Deadly", "--seeds", "60:200", "--time-limit", "0.1"]
    arguments += ["--workers", "2", "--out", str(out)]
    return subprocess.Popen(
        [sys.executable, "-m", "limberjack", "evaluate", *TASK, *arguments],
        env={name: value for name, value in os.environ.items() if "COLOR" not in name}
        | {"PYTHONPATH": os.pathsep.join(sys.path)}
        | variables,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.fixture(scope="module")
def deadly(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the evaluation of a policy that has not killed its process."""
    directory = tmp_path_factory.mktemp("deadly")
    _evaluate(policy=f"{_POLICIES}:Deadly", out=directory, num_threads=1)
    return directory


@pytest.fixture
def shared_memory() -> Iterator[None]:
    """Fails if something is left in shared memory."""
    folder = Path("/dev/shm")
    before = set(folder.iterdir()) if folder.exists() else set()
    yield
    if folder.exists():
        assert not [path for path in set(folder.iterdir()) - before if "limberjack" in path.name]


@pytest.mark.usefixtures("shared_memory")
def test_after_sigterm_and_a_kill_of_the_driver_the_same_command_finishes(
    deadly: Path, tmp_path: Path
) -> None:
    if not Path("/proc/self/stat").exists():
        pytest.skip("no /proc on this system")
    for number, status in ((signal.SIGTERM, 143), (signal.SIGKILL, -signal.SIGKILL)):
        driver = _begin(tmp_path, SLOW="0.3")
        path, before = tmp_path / "episodes.jsonl", 0
        if path.exists():
            before = path.stat().st_size
        wait_for(lambda path=path, before=before: path.exists() and path.stat().st_size > before)
        wait_for(lambda driver=driver: len(children(driver.pid)) == 2)
        workers = children(driver.pid)
        driver.send_signal(number)
        _, printed = driver.communicate(timeout=300)
        assert driver.returncode == status, printed
        wait_for(lambda workers=workers: not any(map(is_alive, workers)))
        if number == signal.SIGTERM:
            assert printed.startswith("limberjack: interrupted: ")
            assert printed.endswith("the same command continues from there\n")
            assert printed.count("\n") == 1
    deaths = tmp_path / "deaths"
    deaths.write_text("xx")
    driver = _begin(tmp_path, DEADLY=str(deaths))
    _, printed = driver.communicate(timeout=300)
    assert (driver.returncode, printed) == (0, "")
    assert _files(tmp_path) == _files(deadly)


def test_a_policy_that_always_ends_its_process_ends_the_run_in_one_line(tmp_path: Path) -> None:
    deaths = tmp_path / "deaths"
    deaths.write_text("xxxxx")
    driver = _begin(tmp_path / "out", DEADLY=str(deaths))
    _, printed = driver.communicate(timeout=300)
    assert driver.returncode == 1
    assert deaths.read_text() == "xx"
    assert printed.count("\n") == 1
    assert printed.startswith(
        f"limberjack: policy '{_POLICIES}:Deadly', seeds 64 to 127 lost 3 workers on node "
        f"{socket.gethostname()}, the last one by signal SIGKILL; "
    )
    assert "the same command continues from there" in printed
