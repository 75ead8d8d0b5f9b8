"""MODULE:CALLABLE: functions, objects and classes of a user's own."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import policies
from limberjack.policies.named import NOT_RESET, is_stateful_object

_SPEC = specs.BoundedArray((3,), float, [-1.0, 0.5, -3.0], [1.0, 2.0, -1.0])

_MODULE = """
import numpy as np

starts = []

class Counting:
    def __init__(self):
        self.steps = 0
    def reset(self):
        starts.append(self.steps)
    def act(self, observation):
        self.steps += 1
        return np.full(3, self.steps)

class Forgetting:
    def __init__(self):
        self.weights, self.steps = None, 0
    def act(self, observation):
        self.weights = self.weights or [1.0]  # once
        self.steps += self.counts
        return np.full(3, self.steps)
    counts = 1

class Loading(Forgetting):
    counts = 0

class Greedy(Counting):
    def __init__(self, size):
        self.size = size

class Box:
    still = staticmethod(lambda observation: [0, 0, 0])

ready = Counting()
number = 7

def ramp(observation):
    return observation["ramp"]

def ending(observation):
    raise SystemExit(3)

class Unready:
    def reset(self):
        raise KeyError("no weights")
    act = ramp

class Unmade(Counting):
    def __init__(self):
        raise OSError("no weights")
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of an importable module with policies."""
    (tmp_path / "policies_of_a_user.py").write_text(_MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "policies_of_a_user", raising=False)
    return "policies_of_a_user"


def _with(spec: specs.BoundedArray) -> Any:
    """In the place of an environment with these actions."""
    return SimpleNamespace(action_spec=lambda: spec)


def _begun(name: str, spec: specs.BoundedArray, seed: int) -> policies.Act:
    return policies.find(name).begin_alone(_with(spec), seed)


def test_a_function_is_a_policy(module: str) -> None:
    act = _begun(f"{module}:ramp", _SPEC, 0)
    np.testing.assert_array_equal(act({"ramp": np.arange(3)}), [0, 1, 2])


def test_a_dotted_name_is_followed(module: str) -> None:
    act = _begun(f"{module}:Box.still", _SPEC, 0)
    np.testing.assert_array_equal(act({}), [0, 0, 0])


@pytest.mark.parametrize(
    ("name", "attributes"), [("Forgetting", ["steps"]), ("Loading", []), ("Counting", [])]
)
def test_an_object_that_changes_as_it_acts_is_reported_unless_it_has_a_reset(
    module: str, name: str, attributes: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    act = _begun(f"{module}:{name}", _SPEC, 0)
    for _ in range(4):
        act({})
    assert [record.args for record in caplog.records] == [
        (f"{module}:{name}", attribute) for attribute in attributes
    ]
    assert all(record.msg == NOT_RESET for record in caplog.records)


@pytest.mark.parametrize("name", ["Counting", "ready"])
def test_the_reset_of_a_class_or_object_is_called_at_each_start(module: str, name: str) -> None:
    policy = policies.find(f"{module}:{name}")
    assert policy.begin_alone(_with(_SPEC), 0)({}).tolist() == [1, 1, 1]
    assert policy.begin_alone(_with(_SPEC), 1)({}).tolist() == [2, 2, 2]
    assert sys.modules[module].starts == [0, 1]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "zreo",
            "sb3:PATH or MODULE:CALLABLE. Did you mean 'zero'?",
        ),
        (
            "",
            "expected zero, random, planner, pretrained, mlp:PATH, onnx:PATH, sb3:PATH or MODULE:",
        ),
        (
            ":act",
            "expected zero, random, planner, pretrained, mlp:PATH, onnx:PATH, sb3:PATH or MODULE:",
        ),
        (
            "{}:",
            "expected zero, random, planner, pretrained, mlp:PATH, onnx:PATH, sb3:PATH or MODULE:",
        ),
        ("not_a_module:act", "there is no module 'not_a_module'; run from the directory"),
        ("{}.py:act", "is a file; expected the name of its module, 'policies_of_a_user'"),
        ("{}.deeper:act", "there is no module 'policies_of_a_user.deeper'"),
        (".{}:act", "is relative; expected its full name"),
        ("{}:rmap", "'policies_of_a_user' has no 'rmap'. Did you mean 'ramp'?"),
        ("{}:Box.stil", "has no 'Box.stil'. Did you mean 'still'?"),
        ("{}:number", "is of type int; expected a function of an observation"),
        ("{}:Greedy", "is a class that needs arguments"),
    ],
)
def test_the_error_for_an_unknown_name_explains_it(module: str, name: str, message: str) -> None:
    with pytest.raises(policies.PolicyError) as caught:
        policies.find(name.format(module))
    assert message in str(caught.value)


def test_a_module_that_needs_another_says_which(module: str, tmp_path: Path) -> None:
    (tmp_path / "needy.py").write_text("import not_installed_anywhere\n")
    with pytest.raises(policies.PolicyError, match="'needy' needs 'not_installed_anywhere'"):
        policies.find("needy:act")


def test_an_error_in_the_module_is_raised_as_it_is(module: str, tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("1 / 0\n")
    with pytest.raises(ZeroDivisionError):
        policies.find("broken:act")


@pytest.mark.parametrize("source", ["int('x')", "raise SystemExit(0)"])
def test_an_error_in_the_module_names_the_policy(
    source: str, module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ending.py").write_text(source)
    with pytest.raises(ValueError) as caught:  # noqa: PT011 (its note is what counts)
        policies.find("ending:act")
    said = [*getattr(caught.value, "__notes__", []), str(caught.value)]
    assert said[0].startswith("policy 'ending:act', as its module is imported")


def test_an_error_outside_of_a_step_names_the_policy_too(module: str) -> None:
    with pytest.raises(OSError, match="no weights") as caught:
        policies.find(f"{module}:Unmade")
    assert caught.value.__notes__ == [f"policy '{module}:Unmade', as its object is made"]
    policy = policies.find(f"{module}:Unready")
    with pytest.raises(KeyError, match="no weights") as lost:
        policy.begin_alone(_with(_SPEC), 8)
    assert lost.value.__notes__ == [f"policy '{module}:Unready', before the episode with seed 8"]


def test_a_policy_that_ends_the_program_has_failed(module: str) -> None:
    act = _begun(f"{module}:ending", _SPEC, 8)
    message = "'policies_of_a_user:ending', step 0 of the episode with seed 8: raised SystemExit"
    with pytest.raises(policies.PolicyError, match=message):
        act({})


def test_only_an_object_shares_its_state_among_its_uses(module: str) -> None:
    stateful = [f"{module}:ready", policies.find, f"{module}:Counting", f"{module}:ramp", "random"]
    assert [is_stateful_object(policy) for policy in stateful] == [True, False, False, False, False]


@pytest.mark.parametrize("shape", [(), (2, 2)])
def test_an_action_of_any_shape_that_is_not_finite_is_refused(
    module: str, shape: tuple[int, ...]
) -> None:
    spec = specs.BoundedArray(shape, float, -1.0, 1.0)
    act = _begun(f"{module}:ramp", spec, 8)
    with pytest.raises(policies.PolicyError, match=r"returned nan at index \[0"):
        act({"ramp": np.full(shape, np.nan)})


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (np.zeros(4), "and shape (4,); expected numbers of shape (3,)"),
        (0.0, "and shape (); expected numbers of shape (3,)"),
        ([[0, 0, 0]], "and shape (1, 3); expected numbers of shape (3,)"),
        ([0, np.nan, 0], "returned nan at index [1]; expected finite numbers"),
        ([0, 0, -np.inf], "returned -inf at index [2]; expected finite numbers"),
        (None, "returned NoneType of dtype object and shape (); expected numbers of shape (3,)"),
        ("left", "returned str of dtype <U4"),
        ([[0], [0, 0]], "returned something other than an array of numbers"),
    ],
)
def test_an_action_of_another_shape_or_kind_is_refused_with_name_and_step(
    module: str, returned: object, message: str
) -> None:
    act = _begun(f"{module}:ramp", _SPEC, 8)
    act({"ramp": np.zeros(3)})
    with pytest.raises(policies.PolicyError) as caught:
        act({"ramp": returned})  # pyright: ignore[reportArgumentType] (on purpose)
    assert f"policy '{module}:ramp', step 1 of the episode with seed 8" in str(caught.value)
    assert message in str(caught.value)
