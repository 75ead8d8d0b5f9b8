"""Collecting: the same bytes however often it is interrupted and whoever plays."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from limberjack.data import Kept, collect, load
from limberjack.data.collecting import _episodes
from limberjack.policies import PolicyError

from .collected import ARM, PENDULUM, assert_equal, hashes, made

_STATM = Path("/proc/self/statm")


def _collect(out: Path, seeds: range, policy: object = "random", **kwargs: Any) -> dict[str, str]:
    """The hashes of a collection of pendulums."""
    domain, task, seconds = PENDULUM
    arguments = {"num_threads": 1, "time_limit": seconds, **kwargs}
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


def test_episodes_are_those_of_their_seeds_with_everything_that_was_asked_for(
    tmp_path: Path,
) -> None:
    kept = Kept(states=True)
    domain, task, seconds = ARM
    collect(domain, task, "random", range(62, 66), out=tmp_path, kept=kept, time_limit=seconds)
    dataset = load(tmp_path)
    recipe, first = made(ARM, range(62, 64), kept)
    assert dataset.recipe == recipe
    for one, other in zip([*first, *made(ARM, range(64, 66), kept)[1]], dataset, strict=True):
        assert_equal(one, other)


def test_a_rerun_gives_equal_bytes(whole: dict[str, str], tmp_path: Path) -> None:
    assert _collect(tmp_path, range(130)) == whole
    times = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert _collect(tmp_path, range(130)) == whole
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == times


def test_two_workers_and_two_shards_give_equal_bytes(whole: dict[str, str], tmp_path: Path) -> None:
    _collect(tmp_path, range(130), workers=2, shard=(1, 2))
    _collect(tmp_path, range(130), shard=(2, 2))
    assert hashes(tmp_path) == whole
    assert _collect(tmp_path, range(130)) == whole


def test_seeds_may_follow_others(whole: dict[str, str], tmp_path: Path) -> None:
    first = _collect(tmp_path, range(64))
    assert _collect(tmp_path, range(64, 130)) == whole
    assert first.items() <= whole.items()
    assert len(load(tmp_path)) == 130


def test_a_policy_that_plays_one_episode_at_a_time_gives_equal_bytes(tmp_path: Path) -> None:
    alone = _collect(tmp_path / "alone", range(3), "tests.data.policies:Remembering")
    assert list(alone) == ["seeds-0000000000-0000000003.parquet"]
    assert not (tmp_path / "alone" / "parts").exists()
    by_workers = _collect(
        tmp_path / "workers", range(3), "tests.data.policies:Remembering", workers=2
    )
    assert by_workers == alone


# Kills the process in the reset of the 100th episode, if it has never done so before.
_PROGRAM = """
import sys
from pathlib import Path
from tests.data.policies import Killing
from limberjack.data import collect
collect("pendulum", "swingup", "tests.data.policies:Killing", range(200), out=Path(sys.argv[1]),
        time_limit=0.2, num_threads=1)
"""


def test_a_collection_that_was_killed_continues_to_equal_bytes(tmp_path: Path) -> None:
    root = str(Path(__file__).parents[2])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])

    def run(out: Path, **variables: str) -> int:
        return subprocess.run(
            [sys.executable, "-c", _PROGRAM, str(out)],
            env={**os.environ, "PYTHONPATH": path, **variables},
            timeout=120,
        ).returncode

    assert run(tmp_path / "whole") == 0
    for seed in ("70", "130"):
        assert run(tmp_path / "killed", KILL_AT_SEED=seed) == -signal.SIGKILL
    assert len(hashes(tmp_path / "killed")) < len(hashes(tmp_path / "whole")) == 4
    assert run(tmp_path / "killed") == 0
    assert hashes(tmp_path / "killed") == hashes(tmp_path / "whole")
    calls = json.loads((tmp_path / "killed" / "run.json").read_text())["calls"]
    assert [call["ended"] is None for call in calls] == [True, True, False]


def test_a_full_disk_leaves_nothing_half_written(tmp_path: Path, whole: dict[str, str]) -> None:
    resource = pytest.importorskip("resource", reason="no limits of files on this system")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"seeds-0000000000-0000000064.parquet") as caught:
            _collect(tmp_path, range(130))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]
    assert _collect(tmp_path, range(130)) == whole


def test_what_a_failing_policy_has_finished_is_kept(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="episode with seed 70: returned an action of shape"):
        _collect(tmp_path, range(128), "tests.data.policies:Failing")
    assert list(hashes(tmp_path)) == ["seeds-0000000000-0000000064.parquet"]


@pytest.mark.skipif(not _STATM.exists(), reason="needs Linux's /proc")
def test_memory_does_not_grow_with_the_number_of_episodes(tmp_path: Path) -> None:
    resident: dict[int, int] = {}  # bytes, by the number of finished episodes

    def measure(policy: str, finished: int, part: float) -> None:
        resident[finished] = int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    kept = Kept(states=True)
    policy = "tests.data.policies:Killing"  # acts on batches
    _collect(tmp_path, range(320), policy, time_limit=8.0, kept=kept, on_progress=measure)
    unit = 64 * load(tmp_path).recipe.episode_nbytes
    assert unit > 4e6
    assert resident[320] - resident[128] < 1.5 * unit  # three units more


def test_compressing_runs_beside_the_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from limberjack.data import collecting, parquet

    events: list[str] = []
    encode = parquet.encode

    def slow(*arguments: Any) -> bytes:
        events.append("compress")
        time.sleep(0.5)
        events.append("compressed")
        return encode(*arguments)

    def episodes(recipe: Any, setup: Any, seeds: Any, on_steps: Any = None) -> Any:
        events.append("simulate")
        return _episodes(recipe, setup, seeds, on_steps)

    monkeypatch.setattr(collecting, "encode", slow)
    monkeypatch.setattr(collecting, "_episodes", episodes)
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
    [([], "there are no seeds"), ([3, 3], "seed 3 follows 3"), ([5, 4], "seed 4 follows 5")],
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
