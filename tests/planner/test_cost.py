"""Costs as weighted sums of named terms, the one that a task names, and the files it depends on."""

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import limberjack.planner
from limberjack import suite
from limberjack.planner import Cost, Planner, Settings
from limberjack.planner.cost import FunctionCost, cost_for, sources_for
from limberjack.rl.control import Environment

from .planned import PLANNED, SINGLE_STAGE

_PLANNER = Path(limberjack.planner.__file__).resolve().parent
_SMALL = Settings(samples=4, horizon=0.1, knots=2, timestep=0.0125)


class _Crouch(Cost):
    settings = _SMALL
    weights: ClassVar = {"height": 2.0}

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        return {"height": physics.head_height(), "one": np.ones(np.shape(physics.head_height()))}


class _Alone(Cost):
    settings = _SMALL

    def step_cost(self, physics: Any) -> np.ndarray:
        return physics.head_height()


def _env() -> Environment:
    env = suite.load("humanoid", "stand", {"random": 3})
    env.reset()
    return env


def test_a_cost_is_the_weighted_sum_of_its_terms_and_others_weigh_one() -> None:
    env = _env()
    cost, height = _Crouch(env.task), env.physics.head_height()
    assert cost.weighted_terms(env.physics) == {"height": 2.0 * height, "one": 1.0}
    assert cost.step_cost(env.physics) == 2.0 * height + 1.0


def test_a_weight_is_changed_in_one_cost_only() -> None:
    env = _env()
    cost, height = _Crouch(env.task), env.physics.head_height()
    cost.weigh("one", 0.5)
    assert cost.weighted_terms(env.physics) == {"height": 2.0 * height, "one": 0.5}
    assert _Crouch(env.task).weights == {"height": 2.0}
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match=r"weight of 'one' is .*; expected 0"):
            cost.weigh("one", wrong)


def test_a_weight_that_no_term_has_is_refused() -> None:
    class Misspelt(_Crouch):
        weights: ClassVar = {"one": 1.0, "hight": 2.0}

    env = _env()
    planner = Planner(env, num_threads=1, cost=Misspelt(env.task))
    message = (
        "weights of Misspelt name 'hight', which is none of its terms: height, one. "
        "Did you mean 'height'?"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        planner.act()


def test_a_stage_may_lack_a_term_that_has_a_weight() -> None:
    class Staged(_Crouch):
        weights: ClassVar = {"of another stage": 2.0}

        def stage(self) -> str:
            return "down"

    env = _env()
    assert Staged(env.task).step_cost(env.physics) == env.physics.head_height() + 1.0


def test_a_function_is_a_cost_whose_terms_it_returns() -> None:
    env = _env()
    height = env.physics.head_height()
    named = FunctionCost(lambda physics: {"height": physics.head_height(), "twice": 2 * height})
    assert named.weighted_terms(env.physics) == {"height": height, "twice": 2 * height}
    assert named.step_cost(env.physics) == 3 * height
    assert FunctionCost(lambda physics: physics.head_height()).terms(env.physics) == {
        "cost": height
    }


def test_a_cost_without_terms_says_what_to_define() -> None:
    with pytest.raises(NotImplementedError, match=r"Cost defines neither terms.* nor step_cost"):
        Cost(None).step_cost(None)


def test_the_planner_explains_its_last_plan_by_the_terms_of_its_cost() -> None:
    env = _env()
    planner = Planner(env, num_threads=1, cost=_Crouch(env.task))
    with pytest.raises(RuntimeError, match=r"call planner\.act"):
        planner.explain()
    action = planner.act()
    stage, terms = planner.explain()
    assert stage == ""
    assert terms["one"] == 1.0
    # A body that falls for a tenth of a second: its head is near where it was.
    assert terms["height"] == pytest.approx(2.0 * float(env.physics.head_height()), abs=0.3)
    np.testing.assert_array_equal(planner.act(), action)


def test_a_cost_that_is_one_sum_is_explained_as_one_term() -> None:
    env = _env()
    planner = Planner(env, num_threads=1, cost=_Alone(env.task))
    planner.act()
    assert list(planner.explain().terms) == ["cost"]


def test_the_stage_of_a_task_has_a_name() -> None:
    env = suite.load("stacker", "stack_2", {"random": 0})
    env.reset()
    planner = Planner(env, num_threads=1)
    planner.act()
    stage, terms = planner.explain()
    assert stage
    assert "reward" in terms


@pytest.mark.parametrize(("domain", "task"), PLANNED + SINGLE_STAGE)
def test_every_task_of_the_suite_names_its_cost(domain: str, task: str) -> None:
    named = suite.load(domain, task).task
    cost = cost_for(named)
    assert f"{type(cost).__module__}:{type(cost).__name__}" == named.planner_cost
    assert cost.task is named


def test_the_files_are_those_that_plans_for_the_task_depend_on() -> None:
    shared = {*_PLANNER.glob("*.py"), *_PLANNER.glob("optimisers/[!_]*.py")}
    for domain, task, folders in [
        ("humanoid", "stand", {"humanoid"}),
        ("stacker", "stack_2", {"arm", "stacker"}),
        ("manipulator", "insert_peg", {"arm", "manipulator"}),
    ]:
        files = sources_for(suite.load(domain, task).task)
        assert files == sorted(files)
        assert shared < set(files)
        others = {file for file in files if file not in shared}
        assert {file.parent.name for file in others} == folders
        loaded = {
            Path(str(module.__file__)).resolve()
            for name, module in sys.modules.items()
            if ".planner." in name
        }
        assert others <= loaded


def test_files_of_a_task_include_what_its_cost_imports_indirectly() -> None:
    names = {file.name for file in sources_for(suite.load("manipulator", "bring_ball").task)}
    assert {"bring.py", "fetch.py", "roadmap.py", "geometry.py"} <= names
    assert not {"insert.py", "release.py"} & names  # of insertion alone


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str], Path]]:
    """Writes a module of the user's own, by its name and text, which can be imported."""
    monkeypatch.syspath_prepend(str(tmp_path))
    written: list[Path] = []

    def module(name: str, text: str) -> Path:
        written.append(tmp_path / f"{name}.py")
        written[-1].write_text(text)
        return written[-1]

    yield module
    for file in written:
        sys.modules.pop(file.stem, None)


def test_the_file_of_a_cost_outside_the_planner_comes_last(
    write: Callable[[str, str], Path],
) -> None:
    file = write(
        "cost_of_mine",
        "import limberjack.planner.arm.path\n"
        "from limberjack.planner.stacker import tower\n"
        "class Still(limberjack.planner.Cost): pass\n",
    )
    task = SimpleNamespace(planner_cost="cost_of_mine:Still")
    assert isinstance(cost_for(task), Cost)
    *others, own = sources_for(task)
    assert own == file
    shared = _PLANNER, _PLANNER / "optimisers"
    imported = {file for file in others if file.parent not in shared}
    of_arm = {_PLANNER / "arm" / name for name in ("path.py", "watchdog.py")}
    assert imported == {*of_arm, _PLANNER / "stacker" / "tower.py"}


_LOW = "def low(physics):\n    return {'height': physics.head_height()}\n"


def test_a_task_may_name_a_function_whose_file_it_depends_on(
    write: Callable[[str, str], Path],
) -> None:
    file = write("function_of_mine", _LOW)
    task = SimpleNamespace(planner_cost="function_of_mine:low")
    assert list(cost_for(task).terms(_env().physics)) == ["height"]
    assert sources_for(task)[-1] == file


def test_a_task_depends_on_the_file_of_a_decorated_cost_and_on_that_of_its_decorator(
    write: Callable[[str, str], Path],
) -> None:
    halves = write(
        "halves",
        "import functools\n"
        "def halved(cost):\n"
        "    @functools.wraps(cost)\n"
        "    def half(physics):\n"
        "        return {name: term / 2 for name, term in cost(physics).items()}\n"
        "    return half\n",
    )
    decorated = write("decorated", f"from halves import halved\n@halved\n{_LOW}")
    files = sources_for(SimpleNamespace(planner_cost="decorated:low"))
    assert files[-2:] == [decorated, halves]


def test_a_task_without_a_cost_is_told_what_to_write() -> None:
    for find in (cost_for, sources_for):
        with pytest.raises(ValueError, match="write a subclass of limberjack"):
            find(SimpleNamespace())


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no_such_module:Cost", "No module named 'no_such_module'"),
        ("limberjack.planner.cost:Cots", "no attribute 'Cots'"),
        ("limberjack.planner.cost", "expected 'module:Class'"),
        ("limberjack.planner.cost:Settings", "not a subclass of limberjack.planner.Cost"),
    ],
)
def test_a_cost_that_cannot_be_found_is_one_sentence(name: str, message: str) -> None:
    with pytest.raises(ValueError, match="planner_cost of SimpleNamespace is") as error:
        cost_for(SimpleNamespace(planner_cost=name))
    assert message in str(error.value)
