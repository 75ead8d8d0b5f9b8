"""Collecting: the same bytes however often it is interrupted and whoever plays."""

import concurrent.futures
import dataclasses
import errno
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.data import Kept, collect, collect_set, load
from limberjack.episodes.folder import Folder
from limberjack.episodes.manifest import file_name
from limberjack.episodes.places import filling
from limberjack.episodes.player import Player
from limberjack.episodes.writing import Writing
from limberjack.mujoco.fingerprint import versions
from limberjack.policies import PolicyError
from limberjack.utils import files
from limberjack.workers import WorkError
from limberjack.workers.setup import setup_of
from tests.policies import saved_models
from tests.workers.killing import is_alive, kill_workers_of, wait_for

from .collected import ARM, PENDULUM, assert_equal, hashes, made, of_64, recipe_for, whole_hashes

_SAVED = "a saved model"
_STATM = Path("/proc/self/statm")


def _collect(out: Path, seeds: range, policy: object = "random", **kwargs: Any) -> dict[str, str]:
    """The hashes of a collection of pendulums."""
    domain, task, seconds = PENDULUM
    arguments = {
        "num_threads": 1,
        "time_limit": seconds,
        "file_mb": of_64(
            (domain, task, kwargs.get("time_limit", seconds)), kwargs.get("kept", Kept())
        ),
        **kwargs,
    }
    collect(domain, task, policy, seeds, out=out, **arguments)
    return hashes(out)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The hashes of 130 episodes, collected in one go."""
    found = _collect(tmp_path_factory.mktemp("whole"), range(130))
    assert list(found) == [
        "seeds-0000000000-0000000064.parquet",
        "seeds-0000000064-0000000128.parquet",
        "seeds-0000000128-0000000130.parquet",
    ]
    return found


def test_files_are_written_where_they_were_asked_for_though_the_policy_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _collect(Path("out"), range(65), "tests.episodes.policies:moving")
    assert Path.cwd() != tmp_path
    assert len(load(tmp_path / "out")) == 65


def test_an_episode_that_no_reader_accepts_is_refused_before_it_is_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.episodes.recipe.MOST_NBYTES", 2**18 + 100)
    played: list[object] = []
    with pytest.raises(ValueError, match="an episode of 10 steps may take"):
        _collect(tmp_path / "out", range(2), on_progress=lambda *shown: played.append(shown))
    assert played == []
    assert not (tmp_path / "out").exists()


def test_episodes_are_those_of_their_seeds_with_everything_that_was_asked_for(
    tmp_path: Path,
) -> None:
    kept = Kept(states=True)
    domain, task, seconds = ARM
    collect(domain, task, "random", range(62, 66), out=tmp_path, kept=kept, time_limit=seconds)
    dataset = load(tmp_path)
    recipe, first = made(ARM, range(62, 64), kept)
    assert dataset.recipe == recipe
    assert len(dataset.shards) == 1
    for one, other in zip([*first, *made(ARM, range(64, 66), kept)[1]], dataset, strict=True):
        assert_equal(one, other)


def test_a_rerun_gives_equal_bytes(whole: dict[str, str], tmp_path: Path) -> None:
    assert _collect(tmp_path, range(130)) == whole
    times = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert _collect(tmp_path, range(130)) == whole
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == times


def test_two_workers_and_two_shards_give_equal_bytes(whole: dict[str, str], tmp_path: Path) -> None:
    _collect(tmp_path, range(130), workers=2, shard=(1, 2))
    _collect(tmp_path, range(130), shard=(2, 2))
    assert hashes(tmp_path) == whole
    assert not (tmp_path / "dataset.json").exists()
    records = [path.name for path in (tmp_path / "parts").iterdir()]
    assert sorted(records) == ["dataset-1-of-2.json", "dataset-2-of-2.json"]
    assert _collect(tmp_path, range(130)) == whole
    _collect(tmp_path / "one", range(130))
    (tmp_path / "one" / "run.json").unlink()
    one = whole_hashes(tmp_path / "one")
    shutil.rmtree(tmp_path / "one")
    assert whole_hashes(tmp_path) == one


@pytest.mark.parametrize(
    ("policy", "block", "files"),
    [
        ("random", 150, [range(140, 150), range(150, 300), range(300, 310)]),
        ("tests.episodes.policies:Remembering", 5, [range(62, 65), range(65, 69)]),  # one by one
    ],
)
def test_a_file_of_more_episodes_than_are_played_together_has_equal_bytes(
    policy: str, block: int, files: list[range], tmp_path: Path
) -> None:
    domain, task, seconds = PENDULUM
    recipe = recipe_for(PENDULUM, Kept(), policy)
    file_mb = (block + 0.5) * recipe._most_each / 1e6
    seeds = range(files[0].start, files[-1].stop)

    def gather(folder: str, **how: Any) -> None:
        out = tmp_path / folder
        how = {"num_threads": 1, "file_mb": file_mb, **how}
        collect(domain, task, policy, seeds, out=out, time_limit=seconds, **how)

    gather("one")
    assert list(hashes(tmp_path / "one")) == [file_name(one) for one in files]
    assert load(tmp_path / "one").seeds == list(seeds)
    gather("workers", workers=2)
    for k in (3, 1, 2):
        gather("shards", shard=(k, 3))
    # A file has seeds of two shards, which are divided at a multiple of 64.
    assert list((tmp_path / "shards" / "parts").glob("seeds-*.part"))
    gather("shards")
    for name in ("workers", "shards"):
        assert whole_hashes(tmp_path / name) == whole_hashes(tmp_path / "one")


@pytest.mark.parametrize("file_mb", [0, -1.0, float("nan"), "large", None])
def test_the_size_of_a_file_is_a_positive_number(file_mb: Any, tmp_path: Path) -> None:
    with pytest.raises((TypeError, ValueError), match=r"file_mb is .*; expected a"):
        _collect(tmp_path / "new", range(2), file_mb=file_mb)
    assert not (tmp_path / "new").exists()


def test_files_of_another_size_are_another_dataset(tmp_path: Path) -> None:
    _collect(tmp_path, range(2), file_mb=1.0)
    with pytest.raises(
        ValueError, match=r"another dataset .*, whose file_mb is 1.0 and 2.0: choose"
    ):
        _collect(tmp_path, range(4), file_mb=2.0)


def test_seeds_may_follow_others(whole: dict[str, str], tmp_path: Path) -> None:
    first = _collect(tmp_path / "two", range(64))
    assert _collect(tmp_path / "two", range(64, 130)) == whole
    assert first.items() <= whole.items()
    assert len(load(tmp_path / "two")) == 130
    _collect(tmp_path / "one", range(130))
    assert whole_hashes(tmp_path / "two") == whole_hashes(tmp_path / "one")


def test_a_policy_that_plays_one_episode_at_a_time_gives_equal_bytes(tmp_path: Path) -> None:
    alone = _collect(tmp_path / "alone", range(3), "tests.episodes.policies:Remembering")
    assert list(alone) == ["seeds-0000000000-0000000003.parquet"]
    assert not (tmp_path / "alone" / "parts").exists()
    by_workers = _collect(
        tmp_path / "workers", range(3), "tests.episodes.policies:Remembering", workers=2
    )
    assert by_workers == alone


# Policies of all kinds by their names, each with a task and seeds in three files.
_KINDS = {
    "zero": (PENDULUM, range(60, 130)),
    "random": (PENDULUM, range(60, 130)),
    "tests.workers.playing:Memory": (PENDULUM, [63, 64, 128]),  # with a reset
    "tests.workers.playing:BatchedMemory": (PENDULUM, range(60, 130)),  # with act_batch
    "tests.workers.playing:damped": (PENDULUM, range(60, 130)),  # a function
    "planner": (PENDULUM, [63, 64, 128]),
    _SAVED: (("humanoid", "stand", 0.05), range(60, 130)),
}


@pytest.fixture(params=_KINDS)
def of_kind(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[Callable[..., dict[str, str]], dict[str, str]]:
    """A function that collects the episodes of a policy, and their hashes in one process."""
    name, ((domain, task, seconds), seeds) = request.param, _KINDS[request.param]
    if name == _SAVED:
        name = saved_models.install(monkeypatch, tmp_path)

    def gather(folder: str, **how: Any) -> dict[str, str]:
        out = tmp_path / folder
        file_mb = of_64((domain, task, seconds))
        collect(domain, task, name, seeds, out=out, time_limit=seconds, file_mb=file_mb, **how)
        return hashes(out) if "shard" in how else whole_hashes(out)

    expected = gather("one", num_threads=2)
    assert len(expected) == 3 + 2
    return gather, expected


def test_bytes_are_equal_for_each_kind_of_policy_in_shards_and_in_an_executor(
    of_kind: tuple[Callable[..., dict[str, str]], dict[str, str]],
) -> None:
    gather, expected = of_kind
    for number in (3, 1, 2):
        found = gather("shards", shard=(number, 3), num_threads=1)
    assert found.items() < expected.items()
    assert gather("shards", num_threads=1) == expected
    with concurrent.futures.ThreadPoolExecutor(4) as executor:
        assert gather("executor", executor=executor) == expected


@pytest.mark.slow
# In other processes Stable-Baselines3 reads saved models: see evaluation/test_saved_models.py.
@pytest.mark.parametrize("of_kind", [kind for kind in _KINDS if kind != _SAVED], indirect=True)
def test_bytes_are_equal_for_each_kind_of_policy_on_two_and_four_workers(
    of_kind: tuple[Callable[..., dict[str, str]], dict[str, str]],
) -> None:
    gather, expected = of_kind
    for workers in (2, 4):
        assert gather(f"workers-{workers}", workers=workers) == expected
    for number in (1, 2, 3):
        gather("shards", shard=(number, 3), workers=2)
    assert gather("shards", workers=2) == expected


@pytest.fixture
def threads() -> Iterator[concurrent.futures.Executor]:
    """Workers that are threads, which use what a test has patched."""
    with concurrent.futures.ThreadPoolExecutor(2) as executor:
        yield executor


def _gather(out: Path, **how: Any) -> dict[str, str]:
    """The hashes of two files, of 100 and 30 pendulums, each of which is joined from parts."""
    file_mb = of_64(PENDULUM) * 100 / 64
    _collect(out, range(130), file_mb=file_mb, **how)
    assert [*hashes(out)] == [file_name(range(100)), file_name(range(100, 130))]
    return whole_hashes(out)


def test_workers_write_and_join_and_the_process_that_plans_does_neither(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threads: concurrent.futures.Executor
) -> None:
    expected, read, counts = _gather(tmp_path / "one"), list[Path](), list[int]()
    monkeypatch.setattr(Folder, "add", None)
    monkeypatch.setattr(Folder, "join", None)
    monkeypatch.setattr("limberjack.episodes.folder.listed", read.append)
    how = {"executor": threads, "on_progress": lambda what, count, part: counts.append(count)}
    assert _gather(tmp_path / "out", **how) == expected
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, 130)
    # Another call has workers read the files that no manifest lists, and join what was left.
    (tmp_path / "out" / "dataset.json").unlink()
    assert _gather(tmp_path / "out", executor=threads) == expected
    assert read == []


def test_workers_that_do_not_see_the_folder_send_their_bytes_and_one_line_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threads: concurrent.futures.Executor
) -> None:
    expected, notes = _gather(tmp_path / "one"), list[str]()
    monkeypatch.setattr(Writing, "is_seen", lambda writing: writing.probe is None)
    out = tmp_path / "out"
    how = {"executor": threads, "on_state": lambda state: notes.append(state.note)}
    assert _gather(out, **how) == expected
    node = socket.gethostname()
    assert [note for note in notes if note] == [
        f"a worker on node {node} does not see {out}, or may not write to it: this process writes "
        "its files"
    ]


def test_a_worker_that_fails_to_write_ends_the_call_and_the_next_one_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threads: concurrent.futures.Executor
) -> None:
    expected = _gather(tmp_path / "one")

    def full(path: Path, folder: Path) -> Any:
        if path.name.startswith("seeds-0000000000-0000000100"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return filling(path, folder)

    monkeypatch.setattr("limberjack.episodes.writing.filling", full)
    with pytest.raises(WorkError, match=r"No space left .*seeds-0000000000-0000000100.parquet'.*;"):
        _gather(tmp_path / "out", executor=threads)
    monkeypatch.undo()
    assert not list((tmp_path / "out" / "episodes").glob("*100.parquet"))
    assert _gather(tmp_path / "out", executor=threads) == expected


@pytest.mark.parametrize("kills", [4, pytest.param(20, marks=pytest.mark.slow)])
def test_bytes_are_equal_after_workers_were_killed_at_random_moments(
    kills: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, seeds = "tests.workers.playing:Deadly", range(60, 60 + 64 * (4 + kills))
    expected = _collect(tmp_path / "one", seeds, policy)
    monkeypatch.setenv("SLOW", "0.03")  # seconds for each of the 10 steps of a unit
    killed = kill_workers_of(monkeypatch, most=kills)
    assert _collect(tmp_path / "killed", seeds, policy, workers=2) == expected
    assert killed == [kills]
    assert whole_hashes(tmp_path / "killed") == whole_hashes(tmp_path / "one")


def test_a_worker_out_of_memory_is_replaced_twice_and_named_the_third_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, seeds = "tests.workers.playing:Hungry", range(60, 130)
    expected = _collect(tmp_path / "one", seeds, policy)
    left = tmp_path / "left"
    left.write_text("xxxxx")
    monkeypatch.setenv("DEADLY", str(left))
    with pytest.raises(WorkError) as caught:
        _collect(tmp_path / "out", seeds, policy, workers=1)
    assert str(caught.value) == (
        f"policy '{policy}', seeds 64 to 127 lost 3 workers on node {socket.gethostname()}, the "
        "last one by out of memory"
    )
    assert left.read_text() == "xx"
    assert list(hashes(tmp_path / "out")) == ["seeds-0000000060-0000000064.parquet"]
    assert _collect(tmp_path / "out", seeds, policy, workers=1) == expected
    assert left.read_text() == ""


def test_workers_of_another_identity_write_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for field in ("canary", "versions"):

        def other(*given: Any, field: str = field, **how: Any) -> Any:
            setup = setup_of(*given, **how)
            if field == "canary":
                return dataclasses.replace(setup, canary="0")
            versions = {**setup.identity["versions"], "mujoco": "4.7.0"}
            return dataclasses.replace(setup, identity={**setup.identity, "versions": versions})

        monkeypatch.setattr("limberjack.workers.scale.setup_of", other)
        with pytest.raises(WorkError, match=rf"is refused: its {field}.* is '"):
            _collect(tmp_path / field, range(3), workers=1)
        assert hashes(tmp_path / field) == {}


# Kills the process in the reset of the 100th episode, if it has never done so before.
_PROGRAM = """
import sys
from pathlib import Path
from tests.episodes.policies import Killing
from limberjack.data import collect
collect("pendulum", "swingup", "tests.episodes.policies:Killing", range(200), out=Path(sys.argv[1]),
        time_limit=0.2, num_threads=1, file_mb=float(sys.argv[2]))
"""


@pytest.mark.parametrize("files", [pytest.param(4, marks=pytest.mark.slow), 1])
def test_a_collection_that_was_killed_continues_to_equal_bytes(files: int, tmp_path: Path) -> None:
    file_mb = str(of_64(PENDULUM) if files == 4 else 100.0)
    root = str(Path(__file__).parents[2])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])

    def run(out: Path, **variables: str) -> int:
        return subprocess.run(
            [sys.executable, "-c", _PROGRAM, str(out), file_mb],
            env={**os.environ, "PYTHONPATH": path, **variables},
            timeout=120,
        ).returncode

    policy = "tests.episodes.policies:Killing"
    _collect(tmp_path / "whole", range(200), policy, file_mb=float(file_mb))
    for seed in ("70", "130"):
        assert run(tmp_path / "killed", KILL_AT_SEED=seed) == -signal.SIGKILL
    assert len(hashes(tmp_path / "killed")) < len(hashes(tmp_path / "whole")) == files
    with pytest.raises(ValueError, match=r"no dataset.json yet: .* repeat the call|no complete fi"):
        load(tmp_path / "killed")
    assert run(tmp_path / "killed") == 0
    assert whole_hashes(tmp_path / "killed") == whole_hashes(tmp_path / "whole")
    calls = json.loads((tmp_path / "killed" / "run.json").read_text())["calls"]
    assert [call["ended"] is None for call in calls] == [True, True, False]


# The same with two workers, which write the parts of 5 files and join them: one collection for
# each line of the input, in a process of its own, which has imported everything.
_OF_WORKERS = """
import os, sys
from pathlib import Path
from limberjack.data import collect
if __name__ == "__main__":
    out, file_mb = Path(sys.argv[1]), float(sys.argv[2])
    for line in sys.stdin:
        number = os.fork()
        if not number:
            collect("pendulum", "swingup", "tests.workers.playing:Deadly", range(640), out=out,
                    time_limit=0.2, workers=2, file_mb=file_mb)
            os._exit(0)
        print(number, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(number, 0)[1]), flush=True)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork processes")
@pytest.mark.parametrize("kills", [2, pytest.param(30, marks=pytest.mark.slow)])
def test_bytes_are_equal_after_the_process_that_plans_was_killed_at_random_moments(
    kills: int, tmp_path: Path
) -> None:
    file_mb = of_64(PENDULUM) * 128 / 64
    seeds, policy = range(640), "tests.workers.playing:Deadly"
    _collect(tmp_path / "one", seeds, policy, file_mb=file_mb)
    whole = whole_hashes(tmp_path / "one")
    root, out = str(Path(__file__).parents[2]), tmp_path / "killed"
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-c", _OF_WORKERS, str(out), str(file_mb)]
    # With a pause in each of the 10 steps of a unit, for kills within units.
    environment = {**os.environ, "PYTHONPATH": path, "SLOW": "0.03"}
    chance, killed = random.Random(kills), 0
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "bufsize": 1}
    with subprocess.Popen(command, env=environment, **pipes) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        while killed < kills:
            began, more = _files_in(out), chance.randrange(9)
            process.stdin.write("collect\n")
            number = int(process.stdout.readline())
            # So that half-written and joined files are met on slow machines as on fast ones.
            wait_for(lambda: len(_files_in(out) - began) >= more or not is_alive(number))  # noqa: B023
            time.sleep(chance.uniform(0.0, 0.4))
            if is_alive(number):
                os.kill(number, signal.SIGKILL)
            status = int(process.stdout.readline())
            if status == -signal.SIGKILL:
                killed += 1
                continue
            assert status == 0
            assert whole_hashes(out) == whole  # it has finished: the next one begins again
            shutil.rmtree(out)
        process.stdin.close()
    _collect(out, seeds, policy, file_mb=file_mb, workers=2)
    assert whole_hashes(out) == whole


def _files_in(out: Path) -> set[str]:
    """The names of the files of episodes, finished or not, and of the log."""
    return {path.name for path in out.rglob("*") if path.is_file()}


@pytest.mark.parametrize("seeds", [range(64), range(130)], ids=["in the last file", "before it"])
def test_a_full_disk_leaves_nothing_half_written(
    seeds: range, tmp_path: Path, whole: dict[str, str]
) -> None:
    resource = pytest.importorskip("resource", reason="no limits of files on this system")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"seeds-0000000000-0000000064.parquet") as caught:
            _collect(tmp_path, seeds)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    left = [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")]
    assert sorted(left) == ["episodes", "parts", "run.json"]
    assert _collect(tmp_path, range(130)) == whole


@pytest.mark.parametrize("has_workers", [False, True])
def test_two_drivers_without_locks_end_in_a_line_or_in_equal_bytes(
    has_workers: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    threads: concurrent.futures.Executor,
) -> None:
    monkeypatch.setattr(files, "fcntl", None)
    seeds, out = range(320), tmp_path / "out"  # four units at most are in the executor at a time
    whole = _collect(tmp_path / "one", seeds)
    how: dict[str, Any] = {"executor": threads, "workers": 2} if has_workers else {}
    began: list[int] = []

    def second(policy: str, finished: int, part: float) -> None:
        if finished and not began:
            began.append(finished)
            assert _collect(out, seeds, **how) == whole

    with pytest.raises(OSError, match=f"another process writes to {out}: end one of the two"):
        _collect(out, seeds, on_progress=second, **how)
    assert hashes(out) == whole
    assert _collect(out, seeds) == whole
    assert whole_hashes(out) == whole_hashes(tmp_path / "one")


def test_a_driver_whose_unfinished_file_is_removed_by_another_one_says_so(
    whole: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "fcntl", None)
    finish, ran = files.Partial.finish, []

    def late(partial: files.Partial) -> None:
        if partial.path.name.startswith(".seeds-") and not ran:
            ran.append(partial)
            assert _collect(tmp_path, range(130)) == whole
        finish(partial)

    monkeypatch.setattr(files.Partial, "finish", late)
    with pytest.raises(OSError, match=f"another process writes to {tmp_path}: end one of the two"):
        _collect(tmp_path, range(130))
    assert hashes(tmp_path) == whole


def test_a_set_of_tasks_has_the_dataset_of_each(tmp_path: Path) -> None:
    tasks, how = ["pendulum:swingup", "point_mass:easy"], {"num_threads": 1, "time_limit": 0.2}
    seen: list[int] = []
    folders = collect_set(
        tasks,
        "random",
        range(3),
        out=tmp_path / "set",
        on_progress=lambda what, finished, part: seen.append(finished),
        **how,
    )
    assert [*folders] == [("pendulum", "swingup"), ("point_mass", "easy")]
    for (domain, task), folder in folders.items():
        assert isinstance(folder, Path)
        assert folder == tmp_path / "set" / f"{domain}-{task}"
        collect(domain, task, "random", range(3), out=tmp_path / task, **how)
        assert hashes(folder) == hashes(tmp_path / task)
    assert seen[-1] == 6
    assert collect_set(tasks, "random", range(3), out=tmp_path / "set", **how) == folders


@pytest.mark.parametrize(
    ("tasks", "policy", "message"),
    [
        (["pendulum:swingup", "point_mass:esay"], "zero", "'esay' does not exist"),
        ("dmc27", "zero", "no set of tasks 'dmc27'"),
        (["pendulum:swingup", "finger:spin"], "mlp:{domain}.safetensors", "pendulum.safetensors"),
        (["pendulum:swingup", "finger:spin"], {("pendulum", "swingup"): "zero"}, "finger spin"),
        (
            ["pendulum:swingup", "finger:spin"],
            {("pendulum", "swingup"): "zero", ("finger", "spin"): "radnom"},
            "policy is 'radnom'",
        ),
    ],
)
def test_a_set_that_cannot_be_collected_plays_nothing(
    tasks: Any, policy: Any, message: str, tmp_path: Path
) -> None:
    with pytest.raises((ValueError, PolicyError), match=message):
        collect_set(tasks, policy, range(2), out=tmp_path / "set")
    assert not (tmp_path / "set").exists()


def test_episodes_of_other_versions_are_not_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _collect(tmp_path, range(2))
    before, actual = hashes(tmp_path), versions()
    monkeypatch.setattr(
        "limberjack.workers.identity.versions", lambda: {**actual, "mujoco": "4.7.0"}
    )
    here = actual["mujoco"]
    message = rf"another dataset .*, whose versions.mujoco is '{here}' and '4.7.0': choose another"
    with pytest.raises(ValueError, match=message):
        _collect(tmp_path, range(4))
    assert hashes(tmp_path) == before


@pytest.mark.parametrize("log", ["run.json", "run-1-of-2.json"])
def test_episodes_of_a_processor_that_rounds_differently_are_not_continued(
    log: str, whole: dict[str, str], tmp_path: Path
) -> None:
    _collect(tmp_path, range(130), shard=None if log == "run.json" else (1, 2))
    content = json.loads((tmp_path / log).read_text())
    content["calls"][0]["canary"] = "0"
    (tmp_path / log).write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"with canary '0', and this call has '.*--any-processor"):
        _collect(tmp_path, range(128, 192))
    for path in tmp_path.glob("episodes/seeds-0000000064-*"):
        path.unlink()
    assert _collect(tmp_path, range(130), any_processor=True) == whole


def test_what_a_failing_policy_has_finished_is_kept(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match=r"episode with seed 70: returned .* shape"):
        _collect(tmp_path, range(128), "tests.episodes.policies:Failing")
    assert list(hashes(tmp_path)) == ["seeds-0000000000-0000000064.parquet"]


def test_a_policy_whose_source_is_unknown_is_refused_before_anything_is_written(
    tmp_path: Path,
) -> None:
    typed_in: dict[str, Any] = {"__name__": "typed_in"}
    sys.modules["typed_in"] = types.ModuleType("typed_in")
    try:
        exec("def act(observation):\n    return [0.0]\n", typed_in)
        with pytest.raises(PolicyError, match="policy 'typed_in:act' has no source file"):
            _collect(tmp_path / "out", range(2), typed_in["act"])
    finally:
        del sys.modules["typed_in"]
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not _STATM.exists(), reason="needs Linux's /proc")
def test_memory_does_not_grow_with_the_number_of_episodes(tmp_path: Path) -> None:
    resident: dict[int, int] = {}  # bytes, by the number of finished episodes

    def measure(policy: str, finished: int, part: float) -> None:
        resident[finished] = int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    kept = Kept(states=True)
    policy = "tests.episodes.policies:Killing"  # acts on batches
    _collect(tmp_path, range(320), policy, time_limit=8.0, kept=kept, on_progress=measure)
    unit = 64 * load(tmp_path).recipe.episode_nbytes
    assert unit > 4e6
    assert resident[320] - resident[128] < 1.5 * unit  # three units more


def test_compressing_runs_beside_the_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from limberjack.episodes import collecting, parquet

    events: list[str] = []
    encode = parquet.encode

    def slow(*arguments: Any) -> bytes:
        events.append("compress")
        time.sleep(0.5)
        events.append("compressed")
        return encode(*arguments)

    play = Player.play

    def simulate(*arguments: Any, **kwargs: Any) -> Any:
        events.append("simulate")
        return play(*arguments, **kwargs)

    monkeypatch.setattr(collecting, "encode", slow)
    monkeypatch.setattr(Player, "play", simulate)
    _collect(tmp_path, range(128))
    assert events.index("compressed") > [i for i, e in enumerate(events) if e == "simulate"][1]


def test_progress_counts_the_episodes_that_are_there(tmp_path: Path) -> None:
    _collect(tmp_path, range(64))
    shown: list[tuple[str, int, float]] = []
    _collect(tmp_path, range(70), on_progress=lambda *what: shown.append(what))
    assert shown[0] == ("random", 64, 0.0)
    assert shown[-1] == ("random", 70, 0.0)
    assert max(part for _, _, part in shown) == 6.0


@pytest.mark.parametrize(
    ("seeds", "message"),
    [([], "there are no seeds"), ([3, 3], "a seed occurs twice"), ([5, 4], "seed 4 follows 5")],
)
def test_seeds_must_increase(seeds: list[int], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        collect(*PENDULUM[:2], seeds=seeds, out=tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_another_policy_file_of_the_same_name_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    for number in (1, 2):
        (tmp_path / "changing.py").write_text(
            f"import numpy as np\ndef act(observation):\n    return np.full(1, 0.{number})\n"
        )
        sys.modules.pop("changing", None)
        if number == 1:
            _collect(tmp_path / "out", range(2), "changing:act")
            continue
        with pytest.raises(ValueError, match="whose policy_sha256 is"):
            _collect(tmp_path / "out", range(4), "changing:act")
    sys.modules.pop("changing", None)


def test_a_set_is_collected_in_a_world(tmp_path: Path) -> None:
    how: dict[str, Any] = {"out": tmp_path, "time_limit": 0.1, "num_threads": 1}
    world = {"faults": {"dummies": 2}}
    collect_set(["pendulum:swingup"], "random", range(2), world=world, **how)
    recorded: Any = load(tmp_path / "pendulum-swingup").recipe.facts["world"]
    assert recorded["faults"]["dummies"] == 2


def test_datasets_of_a_set_stay_in_their_folder_if_a_policy_changes_to_another(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)

    def leave(observation: Any) -> np.ndarray:
        os.chdir(tmp_path / "elsewhere")
        return np.zeros(1)

    tasks = ["cartpole:balance", "pendulum:swingup"]
    folders = collect_set(tasks, leave, range(1), out="set", time_limit=0.1, num_threads=1)
    assert sorted(path.name for path in (tmp_path / "set").iterdir()) == [
        "cartpole-balance",
        "pendulum-swingup",
    ]
    assert [len(load(str(folder))) for folder in folders.values()] == [1, 1]


def test_a_task_of_a_set_that_never_ends_is_refused_before_another_is_played(
    tmp_path: Path,
) -> None:
    with pytest.raises(ValueError, match="lqr lqr_2_1 has no time limit"):
        collect_set(["cartpole:balance", "lqr:lqr_2_1"], "zero", range(1), out=tmp_path)
    assert not list(tmp_path.iterdir())
