"""The packages that the benchmark of batches compares do the same steps."""

import os
from pathlib import Path

import batch_stepping
import batch_worker
import numpy as np
import pytest

from limberjack import bench
from tests.representatives import PAIRS


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

    monkeypatch.setattr("batch_peers.Peer", Peer)
    cells = batch_stepping.Cells([("stacker", "stack_2")], [64], 1, Path())
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


@pytest.mark.parametrize(
    ("task", "name"),
    [
        (("humanoid", "run_pure_state"), "HumanoidRunPureState-v1"),
        (("manipulator", "bring_ball"), "ManipulatorBringBall-v1"),
        (("stacker", "stack_4"), "StackerStack4-v1"),
    ],
)
def test_envpools_names_of_the_tasks(task: tuple[str, str], name: str) -> None:
    assert batch_worker.envpool_name(*task) == name
