"""Policies by name."""

import sys
from pathlib import Path

import numpy as np
import pytest
from dm_env import specs

from limberjack import policies

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

class Greedy(Counting):
    def __init__(self, size):
        self.size = size

class Box:
    still = staticmethod(lambda observation: [0, 0, 0])

ready = Counting()
number = 7

def ramp(observation):
    return observation["ramp"]
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of an importable module with policies."""
    (tmp_path / "policies_of_a_user.py").write_text(_MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "policies_of_a_user", raising=False)
    return "policies_of_a_user"


def test_zero_is_the_action_nearest_to_zero() -> None:
    act = policies.find("zero")(_SPEC, 0)
    np.testing.assert_array_equal(act({}), [0.0, 0.5, -1.0])


def test_random_actions_fill_the_bounds() -> None:
    act = policies.find("random")(_SPEC, 0)
    actions = np.array([act({}) for _ in range(2000)])
    assert (actions >= _SPEC.minimum).all()
    assert (actions <= _SPEC.maximum).all()
    # 2,000 uniform draws leave a gap of 1 % at an end with a probability of 2e-9.
    np.testing.assert_allclose(actions.min(axis=0), _SPEC.minimum, atol=0.02)
    np.testing.assert_allclose(actions.max(axis=0), _SPEC.maximum, atol=0.02)


def test_random_actions_depend_on_the_seed_alone() -> None:
    def draw(seed: int) -> list[list[float]]:
        act = policies.find("random")(_SPEC, seed)
        return [act({}).tolist() for _ in range(3)]

    assert draw(5) == draw(5)
    assert draw(5) != draw(6)


def test_random_actions_are_not_the_stream_that_starts_are_drawn_from() -> None:
    first = policies.find("random")(_SPEC, 5)({})
    assert first.tolist() != np.random.RandomState(5).uniform(_SPEC.minimum, _SPEC.maximum).tolist()


def test_a_function_is_a_policy(module: str) -> None:
    act = policies.find(f"{module}:ramp")(_SPEC, 0)
    np.testing.assert_array_equal(act({"ramp": np.arange(3)}), [0, 1, 2])


def test_a_dotted_name_is_followed(module: str) -> None:
    act = policies.find(f"{module}:Box.still")(_SPEC, 0)
    np.testing.assert_array_equal(act({}), [0, 0, 0])


@pytest.mark.parametrize("name", ["Counting", "ready"])
def test_a_class_or_object_is_told_of_each_start(module: str, name: str) -> None:
    policy = policies.find(f"{module}:{name}")
    assert policy(_SPEC, 0)({}).tolist() == [1, 1, 1]
    assert policy(_SPEC, 1)({}).tolist() == [2, 2, 2]
    assert sys.modules[module].starts == [0, 1]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("zreo", "none of zero, random, planner and MODULE:CALLABLE. Did you mean 'zero'?"),
        ("", "none of zero, random, planner and MODULE:CALLABLE"),
        (":act", "none of zero, random, planner and MODULE:CALLABLE"),
        ("{}:", "none of zero, random, planner and MODULE:CALLABLE"),
        ("not_a_module:act", "there is no module 'not_a_module'; run from the directory"),
        ("{}.deeper:act", "there is no module 'policies_of_a_user.deeper'"),
        (".{}:act", "is relative; name it from the top"),
        ("{}:rmap", "'policies_of_a_user' has no 'rmap'. Did you mean 'ramp'?"),
        ("{}:Box.stil", "has no 'Box.stil'. Did you mean 'still'?"),
        ("{}:number", "is of type int; expected a function of an observation"),
        ("{}:Greedy", "is a class that needs arguments"),
    ],
)
def test_a_name_that_leads_nowhere_is_explained(module: str, name: str, message: str) -> None:
    with pytest.raises(policies.PolicyError) as caught:
        policies.find(name.format(module))
    assert message in str(caught.value)


def test_a_module_that_needs_another_says_which(module: str, tmp_path: Path) -> None:
    (tmp_path / "needy.py").write_text("import not_installed_anywhere\n")
    with pytest.raises(policies.PolicyError, match="'needy' needs 'not_installed_anywhere'"):
        policies.find("needy:act")


def test_an_error_in_the_module_is_the_users_to_see(module: str, tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("1 / 0\n")
    with pytest.raises(ZeroDivisionError):
        policies.find("broken:act")


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (np.zeros(4), "returned an action of shape (4,); expected (3,)"),
        (0.0, "returned an action of shape (); expected (3,)"),
        ([[0, 0, 0]], "returned an action of shape (1, 3); expected (3,)"),
        ([0, np.nan, 0], "returned nan at index [1]; expected finite numbers"),
        ([0, 0, -np.inf], "returned -inf at index [2]; expected finite numbers"),
        (None, "returned NoneType of dtype object; expected numbers of shape (3,)"),
        ("left", "returned str of dtype <U4"),
        ([[0], [0, 0]], "returned what is no array of numbers"),
    ],
)
def test_what_is_no_action_is_refused_by_name_and_step(
    module: str, returned: object, message: str
) -> None:
    act = policies.find(f"{module}:ramp")(_SPEC, 8)
    act({"ramp": np.zeros(3)})
    with pytest.raises(policies.PolicyError) as caught:
        act({"ramp": returned})  # pyright: ignore[reportArgumentType] (on purpose)
    assert f"policy '{module}:ramp', step 1 of the episode with seed 8" in str(caught.value)
    assert message in str(caught.value)
