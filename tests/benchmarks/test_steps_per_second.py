"""The benchmark of batches and `limberjack bench` run and report their measurements."""

import importlib.util
import json
import os
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from limberjack import bench
from tests.programs import report_without_places, run_benchmark
from tests.representatives import PAIRS

_BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """The output of a quick run without other packages, and the text of its JSON."""
    file = tmp_path_factory.mktemp("benchmarks") / "results" / "quick.json"
    done = run_benchmark(
        "steps_per_second.py", "--quick", "--without-peers", "--threads", "2", "--json", str(file)
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, file.read_text(encoding="utf-8")


@pytest.mark.slow  # test_suite_speed.py runs the same report and options
def test_one_command_prints_every_measure_with_its_bar(quick: tuple[str, str]) -> None:
    table, text = quick
    bars = {row["measure"]: row["bar"] and row["bar"]["limit"] for row in json.loads(text)["rows"]}
    assert {k: v for k, v in bars.items() if v is not None} == {
        "batch / MuJoCo alone": 0.9,
        "vector / MuJoCo alone": 0.88,
        "reset of all / episode": 2,
        "2 threads / 1": 1.8,
        "memory of one more row": 0.3,
        "two halves / plain loop": 1.6,
    }
    for measure in bars:
        assert measure in table


@pytest.mark.slow  # test_suite_speed.py runs the same report and options
def test_the_json_names_versions_and_machine_but_no_host_or_path(quick: tuple[str, str]) -> None:
    settings = report_without_places(quick[1])["settings"]
    assert settings["threads"] == 2
    assert "step" in settings["load_averages"] or sys.platform == "win32"


@pytest.mark.parametrize(("domain", "task"), PAIRS)
def test_compared_packages_do_the_same_steps(domain: str, task: str) -> None:
    with bench.Contest(domain, task, 3, 2) as contest:
        actions = contest.actions(4)
        for play in (contest.physics, contest.persistent_physics, contest.batch, contest.vector):
            assert play(actions) > 0


def test_different_steps_are_detected() -> None:
    with pytest.raises(RuntimeError, match="stacker stack_2: MuJoCo alone, the batch and"):  # noqa: SIM117
        with bench.Contest("stacker", "stack_2", 3, 2) as contest:
            contest.batch(contest.actions(1))


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be chosen here")
def test_the_bars_beside_envpool_are_held_on_as_many_cores_as_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    allowed: list[set[int]] = []

    class Peer:
        name, mujoco = "a peer", "3.6.0"

        def __init__(self, *args: object, **kwargs: object) -> None:
            allowed.append(os.sched_getaffinity(0))

        def __enter__(self) -> "Peer":
            return self

        def __exit__(self, *error: object) -> None:
            pass

        def play(self, actions: np.ndarray) -> float:
            return 1.0 if len(allowed) == 1 else 0.5

    monkeypatch.syspath_prepend(_BENCHMARKS)
    monkeypatch.setattr("batch_peers.Peer", Peer)
    stepping = importlib.import_module("batch_stepping")
    cells = stepping.Cells([("stacker", "stack_2")], [64], 1, Path())
    before = os.sched_getaffinity(0)
    cells.measure(cells.all[0], seconds=0.0, min_rounds=2, warm_up_steps=1)
    assert [len(cores) for cores in allowed] == [1, len(before)]
    assert os.sched_getaffinity(0) == before
    rows = [row for row in cells.rows() if "EnvPool" in row.measure]
    assert [(row.measure, row.bar and row.bar.limit) for row in rows] == [
        ("vector / EnvPool", 1.2),
        ("vector / EnvPool", 1.35),  # the geometric mean
        ("vector / EnvPool on all cores", None),
    ]
    assert rows[0].theirs == 1024  # steps of all rows together, a block, took a second


def _worker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("batch_worker", _BENCHMARKS / "batch_worker.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("task", "name"),
    [
        (("humanoid", "run_pure_state"), "HumanoidRunPureState-v1"),
        (("manipulator", "bring_ball"), "ManipulatorBringBall-v1"),
        (("stacker", "stack_4"), "StackerStack4-v1"),
    ],
)
def test_envpools_names_of_the_tasks(task: tuple[str, str], name: str) -> None:
    assert _worker().envpool_name(*task) == name
