"""`limberjack.bench.measure`: columns, threads, EnvPool beside them, and the recommended number."""

import importlib.util
import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from limberjack import bench, policies, suite
from limberjack.policies import mlp
from limberjack.rl import control
from tests import plain_domain

_WITHOUT_A_POLICY = next(
    task
    for task in suite.ALL_TASKS
    if task not in {(one.domain, one.task) for one in policies.bundled()}
)
_FEW: dict[str, Any] = {"num_envs": 4, "seconds": 0.01}


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of few rows are as long as an episode has steps for all rounds: six steps of 60."""
    monkeypatch.setattr("limberjack.bench.contest._EPISODE", 60)


def test_measure_compares_and_tries_numbers_of_threads() -> None:
    reported: list[tuple[str, float]] = []
    result = bench.measure(
        "stacker",
        "stack_2",
        num_threads=[3, 1],
        on_progress=lambda what, share: reported.append((what, share)),
        **_FEW,
    )
    shares = [share for _, share in reported]
    assert shares == sorted(shares)
    assert reported[0] == ("preparing", 0.0)
    assert reported[-1][0] == "measuring"
    assert 0.7 < shares[-1] <= 1.0
    assert [speed.what for speed in result.speeds] == ["physics", "batch", "vector"]
    assert [speed.num_threads for speed in result.speeds] == [3, 3, 3]
    ours = [row for row in result.rows if row.what == bench.OURS]
    assert [row.num_threads for row in ours] == [1, 3]
    assert all(list(row.cells) == ["step", "inference"] for row in ours)
    cells = [cell for row in ours for cell in row.cells.values()]
    assert all(cell.steps_per_second > 0 and cell.seconds_95 > 0 for cell in cells)
    assert result.speeds[0].ratio == 1
    assert [cell.ratio for cell in ours[0].cells.values()] == [1, 1]
    assert set(result.recommended_threads) == {"step", "inference"}
    assert set(result.recommended_threads.values()) <= {1, 3}


def test_without_numbers_powers_of_two_and_all_cores_are_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("limberjack.utils.cores.usable_cores", lambda: 3)
    result = bench.measure("pendulum", "swingup", columns=["step"], **_FEW)
    assert [row.num_threads for row in result.rows if row.what == bench.OURS] == [1, 2, 3]


@pytest.mark.parametrize(
    ("domain", "task", "is_bundled"), [("walker", "walk", True), (*_WITHOUT_A_POLICY, False)]
)
def test_the_forward_pass_is_that_of_the_bundled_policy_or_of_a_network(
    domain: str, task: str, is_bundled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[mlp.Card, np.ndarray]] = []
    plain = mlp.Mlp.actions

    def actions(self: mlp.Mlp, observation: np.ndarray) -> np.ndarray:
        found = plain(self, observation)
        seen.append((self.card, found))
        return found

    monkeypatch.setattr(mlp.Mlp, "actions", actions)
    bench.measure(domain, task, num_threads=[1], columns=["inference"], **_FEW)
    card, found = seen[-1]
    assert (card.domain == domain) is is_bundled
    assert card.sizes[1:-1] == (128, 128)
    assert found.shape == (4, card.sizes[-1])
    # Observations change from step to step, and so do their actions.
    assert len({one.tobytes() for _, one in seen}) > 10


def test_training_is_measured_or_its_packages_are_named() -> None:
    state = np.random.get_state(legacy=False)
    result = bench.measure("cartpole", "balance", num_threads=[1], columns=["training"], **_FEW)
    if importlib.util.find_spec("sbx") is None:
        assert result.missing["training"].startswith("needs the extra 'train': pip install ")
        assert result.rows == ()
        assert result.recommended_threads == {}
        return
    assert result.missing == {}
    assert result.rows[0].cells["training"].steps_per_second > 0
    assert result.recommended_threads == {"training": 1}
    np.testing.assert_equal(np.random.get_state(legacy=False), state)


def test_envpool_steps_beside_the_first_column(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[str, dict[str, int]]] = []
    stepped: list[np.ndarray] = []

    class Made:
        reset = close = staticmethod(lambda: None)
        step = staticmethod(stepped.append)

    def make_gymnasium(name: str, **how: int) -> Made:
        made.append((name, how))
        return Made()

    module = ModuleType("envpool")
    vars(module).update(
        __spec__=importlib.util.spec_from_loader("envpool", loader=None),
        list_all_envs=lambda: ["StackerStack2-v1"],
        make_gymnasium=make_gymnasium,
    )
    monkeypatch.setitem(sys.modules, "envpool", module)
    monkeypatch.setattr("importlib.metadata.version", lambda name: "1.2.3")
    result = bench.measure("stacker", "stack_2", num_threads=[1, 2], **_FEW)
    theirs = [row for row in result.rows if row.what != bench.OURS]
    assert [(row.what, row.num_threads) for row in theirs] == [("EnvPool 1.2.3", n) for n in (1, 2)]
    assert all(list(row.cells) == ["step"] for row in theirs)
    how = {"num_envs": 4, "seed": 0}
    assert made == [("StackerStack2-v1", {**how, "num_threads": n}) for n in (1, 2)]
    assert {action.shape for action in stepped} == {(4, 5)}
    made.clear()
    bench.measure("pendulum", "swingup", num_threads=[1], columns=["step"], **_FEW)
    assert made == []  # a task that it lacks


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("num_envs", 0, "num_envs is 0"),
        ("num_threads", [0], "num_threads is 0"),
        ("num_threads", [], r"num_threads is \[\]; expected numbers from 1 to 4"),
        ("num_threads", [8], r"num_threads is \[8\]; expected numbers from 1 to 4"),
        ("seconds", 0.0, "seconds is 0.0"),
        ("task", "stak_2", "[Dd]id you mean"),
        ("columns", ["inferense"], "no column 'inferense'; .* Did you mean 'inference'"),
        ("columns", [], "columns is empty; expected some of step, inference, training"),
    ],
)
def test_arguments_that_cannot_be_measured_are_refused(name: str, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        bench.measure(**{"domain": "stacker", "task": "stack_2", **_FEW, name: value})


def test_without_observations_there_is_no_policy_to_measure() -> None:
    def make(seed: int) -> control.Environment:
        environment = plain_domain.make(seed)
        environment.task.get_observation = lambda physics: {}
        return environment

    with pytest.raises(ValueError, match=r"observes nothing .* measure the column 'step' alone"):
        bench.measure(make, num_threads=[1], **_FEW)
    assert bench.measure(make, num_threads=[1], columns=["step"], **_FEW).rows
