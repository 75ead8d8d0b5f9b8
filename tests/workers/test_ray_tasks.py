"""Units as tasks of Ray: on this machine, in a cluster, and where workers and nodes die."""

import functools
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from limberjack.data import collect
from limberjack.evaluation import evaluate
from limberjack.workers import State, Unit, WorkError, open_workers, prepare, units_of
from tests.episodes.collected import hashes, of_64, whole_hashes

from .playing import TASK, pid, seeds_of

pytestmark = [
    pytest.mark.ray,
    # Ray does not wait for the processes that it has ended, and Python warns of each.
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

ray: Any = pytest.importorskip("ray", reason="needs the extra 'ray'")
cluster_utils: Any = pytest.importorskip("ray.cluster_utils")

_SEEDS = range(60, 200)  # four units for each of three policies
_POLICIES = "tests.workers.playing"
_evaluate = functools.partial(evaluate, *TASK, seeds=_SEEDS, time_limit=0.1)


def _files(directory: Path) -> tuple[list[bytes], bytes]:
    """The lines of episodes.jsonl in order, and result.json."""
    lines = (directory / "episodes.jsonl").read_bytes().splitlines()
    return [lines[0], *sorted(lines[1:])], (directory / "result.json").read_bytes()


@pytest.fixture(autouse=True)
def _ray(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Workers import from the folders of this process; Ray ends with the test."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(folder for folder in sys.path if folder))
    yield
    ray.shutdown()


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A cluster of three nodes, each with one core."""
    made = cluster_utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    made.add_node(num_cpus=1)
    made.add_node(num_cpus=1)
    yield made
    ray.shutdown()
    made.shutdown()


@pytest.mark.parametrize("policy", ["zero", f"{_POLICIES}:Memory", f"{_POLICIES}:BatchedMemory"])
def test_local_ray_writes_the_same_files(policy: str, tmp_path: Path) -> None:
    _evaluate(policy=policy, out=tmp_path / "one", num_threads=1)
    _evaluate(policy=policy, out=tmp_path / "ray", ray="local", workers=2)
    assert _files(tmp_path / "ray") == _files(tmp_path / "one")


def test_the_planner_is_the_same_on_ray(tmp_path: Path) -> None:
    play = functools.partial(
        evaluate, "manipulator", "bring_ball", "planner", range(3), time_limit=0.05
    )
    play(out=tmp_path / "one", num_threads=1)
    play(out=tmp_path / "ray", ray="local", workers=2)
    assert _files(tmp_path / "ray") == _files(tmp_path / "one")


def test_a_worker_that_dies_twice_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deaths, policy = tmp_path / "deaths", f"{_POLICIES}:Deadly"
    deaths.write_text("")
    monkeypatch.setenv("DEADLY", str(deaths))
    _evaluate(policy=policy, out=tmp_path / "one", num_threads=1)
    deaths.write_text("xx")
    _evaluate(policy=policy, out=tmp_path / "ray", ray="local", workers=2)
    assert deaths.read_text() == ""
    assert _files(tmp_path / "ray") == _files(tmp_path / "one")


def test_a_unit_that_loses_three_workers_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deaths, policy = tmp_path / "deaths", f"{_POLICIES}:Deadly"
    deaths.write_text("xxxxx")
    monkeypatch.setenv("DEADLY", str(deaths))
    with pytest.raises(WorkError) as caught:
        _evaluate(policy=policy, out=tmp_path / "ray", ray="local", workers=1)
    assert deaths.read_text() == "xx"
    assert str(caught.value).startswith(f"policy '{policy}', seeds 64 to 127 lost 3 workers")
    assert "\n" not in str(caught.value)


def test_a_policys_error_is_not_tried_again(tmp_path: Path) -> None:
    with pytest.raises(WorkError, match="step 2 of the episode with seed 64: KeyError: 'no such"):
        _evaluate(policy=f"{_POLICIES}:Unlucky", ray="local", workers=2)


def test_a_cluster_writes_the_same_files_though_a_node_is_lost(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, seeds = f"{_POLICIES}:Deadly", range(64 * 12)
    _evaluate(policy=policy, out=tmp_path / "one", num_threads=1, seeds=seeds)
    _while_a_node_is_lost(
        cluster, functools.partial(_evaluate, policy=policy, out=tmp_path / "ray", seeds=seeds)
    )
    assert _files(tmp_path / "ray") == _files(tmp_path / "one")


def test_a_dataset_has_equal_bytes_though_a_node_is_lost(cluster: Any, tmp_path: Path) -> None:
    how = {"time_limit": 0.1, "file_mb": 3 * of_64((*TASK, 0.1))}  # files are joined from parts
    gather = functools.partial(collect, *TASK, f"{_POLICIES}:Deadly", range(64 * 12), **how)
    gather(out=tmp_path / "one", num_threads=1)
    _while_a_node_is_lost(cluster, functools.partial(gather, out=tmp_path / "ray"))
    assert whole_hashes(tmp_path / "ray") == whole_hashes(tmp_path / "one")


def _while_a_node_is_lost(cluster: Any, play: Callable[..., object]) -> None:
    """Plays on a cluster, which loses a node once an episode has ended; its note names the node."""
    node = list(cluster.worker_nodes)[-1]
    notes: list[str] = []
    finished = threading.Event()

    def remove() -> None:
        if finished.wait(60):
            cluster.remove_node(node, allow_graceful=False)

    def on_progress(policy: str, episodes: int, part: float) -> None:
        if episodes:
            finished.set()

    def on_state(state: State) -> None:
        if state.note:
            notes.append(state.note)

    remover = threading.Thread(target=remove)
    remover.start()
    play(ray=cluster.address, on_progress=on_progress, on_state=on_state)
    remover.join()
    assert len(notes) <= 1
    assert all(note.endswith("was lost: its units are played again") for note in notes)


def test_units_run_in_several_processes() -> None:
    setup = prepare(*TASK, "random")
    units = [Unit(setup, block) for block in units_of(range(640))]
    with open_workers(2, ray="local") as workers:
        numbers = {number for _, number in workers.results(pid, units)}
    assert os.getpid() not in numbers


def test_results_that_are_given_up_do_not_reach_later_ones() -> None:
    setup = prepare(*TASK, "random")
    first, second, third = (Unit(setup, block) for block in units_of(range(192)))
    with open_workers(1, ray="local") as workers:
        given_up = workers.results(seeds_of, [first, second])
        next(given_up)
        del given_up
        assert list(workers.results(seeds_of, [third])) == [(third, third.seeds)]


@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1", "127.0.0.1:99999"])
def test_an_address_without_a_cluster_is_one_line_at_once(address: str) -> None:
    begun = time.monotonic()
    with (
        pytest.raises(WorkError, match=f"no Ray cluster at '{address}': ") as caught,
        open_workers(ray=address),
    ):
        pass
    assert "\n" not in str(caught.value)
    assert time.monotonic() - begun < 10


def test_a_ray_that_does_not_start_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(**kwargs: object) -> None:
        raise Exception("The current node timed out\nduring startup.")  # as Ray does

    monkeypatch.setattr(ray, "init", slow)
    with (
        pytest.raises(WorkError, match=r"^no Ray cluster at 'local': The current node timed out "),
        open_workers(ray="local"),
    ):
        pass


@pytest.mark.parametrize("policy", ["random", f"{_POLICIES}:Memory", f"{_POLICIES}:BatchedMemory"])
def test_datasets_have_equal_bytes_on_ray(policy: str, tmp_path: Path) -> None:
    how = {"time_limit": 0.1, "file_mb": of_64((*TASK, 0.1))}
    gather = functools.partial(collect, *TASK, policy, range(60, 200), **how)
    gather(out=tmp_path / "one", num_threads=1)
    gather(out=tmp_path / "ray", ray="local", workers=2)
    assert whole_hashes(tmp_path / "ray") == whole_hashes(tmp_path / "one")
    assert len(hashes(tmp_path / "one")) == 4


def test_a_dataset_has_equal_bytes_though_a_worker_dies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deaths = tmp_path / "deaths"
    deaths.write_text("")
    monkeypatch.setenv("DEADLY", str(deaths))
    gather = functools.partial(collect, *TASK, f"{_POLICIES}:Deadly", range(60, 200))
    gather(out=tmp_path / "one", num_threads=1, time_limit=0.1)
    deaths.write_text("xx")
    gather(out=tmp_path / "ray", ray="local", workers=2, time_limit=0.1)
    assert deaths.read_text() == ""
    assert whole_hashes(tmp_path / "ray") == whole_hashes(tmp_path / "one")
