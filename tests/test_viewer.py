"""`viewer.launch` with functions that make environments."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack import suite, viewer
from limberjack.policies import PolicyError
from limberjack.rl.control import Environment
from limberjack.viewer.session import Session
from tests import plain_domain


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Records of the sessions shown instead of opening a window: seed, state and session."""
    seen: list[dict[str, Any]] = []

    def show(session: Session) -> None:
        place = session.data.qpos.copy()
        seen.append({"seed": session.status().seed, "place": place, "session": session})

    monkeypatch.setattr(viewer, "in_window", lambda: show)
    return seen


def _place(environment: Environment) -> list[float]:
    environment.reset()
    return environment.physics.data.qpos.tolist()


@pytest.mark.parametrize("seed", [None, 0, 5])
def test_a_function_that_needs_a_seed_is_given_it(
    seed: int | None, shown: list[dict[str, Any]]
) -> None:
    given: list[int] = []

    def make(seed: int) -> Environment:
        given.append(seed)
        return plain_domain.make(seed)

    viewer.launch(make, native=True, seed=seed)
    assert given == [seed or 0]
    assert shown[0]["seed"] == seed
    assert shown[0]["place"].tolist() == _place(plain_domain.make(seed or 0))


def test_a_function_that_makes_no_environment_is_told_what_is_expected() -> None:
    with pytest.raises(TypeError, match="NoneType has no MuJoCo simulation to show; expected"):
        viewer.launch(lambda: None, native=True)


def test_a_function_that_can_do_without_is_called_without(shown: list[dict[str, Any]]) -> None:
    given: list[object] = []

    def make(seed: int | None = None) -> Environment:
        given.append(seed)
        return plain_domain.push(random=seed)

    viewer.launch(make, native=True, seed=5)
    assert given == [None]
    assert shown[0]["place"].tolist() == _place(plain_domain.make(5))


@pytest.mark.parametrize("make", [plain_domain.make, lambda: plain_domain.make(0)])
def test_what_launch_made_it_closes(
    make: Callable[..., Environment], shown: list[dict[str, Any]]
) -> None:
    viewer.launch(make, native=True)
    with pytest.raises(RuntimeError, match="this environment is closed"):
        shown[0]["session"].reset()
    environment = suite.load("humanoid", "stand")
    viewer.launch(environment, native=True)
    environment.reset()


def test_an_environment_without_end_and_without_terms_is_viewed(
    shown: list[dict[str, Any]],
) -> None:
    viewer.launch(plain_domain.endless(3), native=True)
    status = shown[0]["session"].status()
    assert (status.step_limit, status.terms, status.success, status.start) == (None, {}, None, None)


def test_the_panel_offers_what_is_given_and_the_built_in_policies(
    shown: list[dict[str, Any]],
) -> None:
    environment = suite.load("cartpole", "balance", {"random": 0})
    built_in = ["zero", "random", "planner", "pretrained"]

    def push(time_step: Any) -> np.ndarray:
        return np.ones(1)

    for given, names in (
        (None, ["none"]),
        ("random", ["random", "none"]),
        (push, ["policy", "none"]),
        (["random", push, lambda time_step: -push(time_step)], ["random", "policy", "policy 2"]),
    ):
        viewer.launch(environment, given, native=True, seed=3)
        session = shown.pop()["session"]
        assert session.status().policy == names[0]
        assert list(session.policies) == list(dict.fromkeys([*names, "none", *built_in]))
    session.choose("policy 2")
    session.step()
    assert session.data.ctrl.tolist() == [-1.0]


def test_the_planner_is_offered_where_its_plans_are_shown(shown: list[dict[str, Any]]) -> None:
    environment = suite.load("cartpole", "balance", {"random": 0})
    viewer.launch(environment, native=True, seed=3, explain=True)
    session = shown[0]["session"]
    assert session.status().policy == "none"
    session.choose("planner")
    session.step()
    assert session.status().plan is not None
    with pytest.raises(PolicyError, match="planner"):
        viewer.launch(plain_domain.endless(3), native=True, explain=True)


def test_what_is_no_policy_is_refused(shown: list[dict[str, Any]]) -> None:
    with pytest.raises(PolicyError, match="nowhere"):
        viewer.launch(plain_domain.make, "nowhere:policy", native=True)
    wrong: Any
    for wrong in (3, [3]):
        with pytest.raises(TypeError, match="expected a function"):
            viewer.launch(plain_domain.make, wrong, native=True)
    assert shown == []


@pytest.mark.parametrize("seed", [True, 1.5])
def test_a_seed_that_is_none_is_refused(seed: Any, shown: list[dict[str, Any]]) -> None:
    for loader in (plain_domain.make, plain_domain.make(0)):
        with pytest.raises(TypeError, match=f"seed is {seed}; expected a whole number"):
            viewer.launch(loader, native=True, seed=seed)
    assert shown == []
