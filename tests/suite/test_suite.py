"""Tests of limberjack.suite: the list of tasks, and loading."""

import ast
import importlib
import inspect
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.suite import humanoid, manipulator, stacker

# dm_control's tasks, in its order: domain, task, tags (benchmarking, easy, hard, no reward
# visualization), control step and default time limit in seconds, number of actuators.
_TABLE = """
acrobot       swingup         B   0.01   10   1
acrobot       swingup_sparse  B   0.01   10   1
ball_in_cup   catch           BE  0.02   20   2
cartpole      balance         B   0.01   10   1
cartpole      balance_sparse  B   0.01   10   1
cartpole      swingup         B   0.01   10   1
cartpole      swingup_sparse  B   0.01   10   1
cartpole      two_poles       -   0.01   10   1
cartpole      three_poles     -   0.01   10   1
cheetah       run             B   0.01   10   6
dog           stand           N   0.015  15   38
dog           walk            N   0.015  15   38
dog           trot            N   0.015  15   38
dog           run             N   0.015  15   38
dog           fetch           HN  0.015  15   38
finger        spin            B   0.02   20   2
finger        turn_easy       B   0.02   20   2
finger        turn_hard       B   0.02   20   2
fish          upright         B   0.04   40   5
fish          swim            B   0.04   40   5
hopper        stand           B   0.02   20   4
hopper        hop             B   0.02   20   4
humanoid      stand           B   0.025  25   21
humanoid      walk            B   0.025  25   21
humanoid      run             B   0.025  25   21
humanoid      run_pure_state  -   0.025  25   21
humanoid_CMU  stand           -   0.02   20   56
humanoid_CMU  walk            -   0.02   20   56
humanoid_CMU  run             -   0.02   20   56
lqr           lqr_2_1         -   0.03   inf  1
lqr           lqr_6_2         -   0.03   inf  2
manipulator   bring_ball      BH  0.01   10   5
manipulator   bring_peg       H   0.01   10   5
manipulator   insert_ball     H   0.01   10   5
manipulator   insert_peg      H   0.01   10   5
pendulum      swingup         B   0.02   20   1
point_mass    easy            BE  0.02   20   2
point_mass    hard            -   0.02   20   2
quadruped     walk            -   0.02   20   12
quadruped     run             -   0.02   20   12
quadruped     escape          -   0.02   20   12
quadruped     fetch           -   0.02   20   12
reacher       easy            BE  0.02   20   2
reacher       hard            B   0.02   20   2
stacker       stack_2         H   0.01   10   5
stacker       stack_4         H   0.01   10   5
swimmer       swimmer6        B   0.03   30   5
swimmer       swimmer15       B   0.03   30   14
walker        stand           B   0.025  25   6
walker        walk            B   0.025  25   6
walker        run             B   0.025  25   6
"""


class _Fact(NamedTuple):
    domain: str
    task: str
    tags: str
    control_timestep: float
    time_limit: float
    actuators: int


def _fact(line: str) -> _Fact:
    domain, task, tags, control_timestep, time_limit, actuators = line.split()
    times = float(control_timestep), float(time_limit)
    return _Fact(domain, task, tags, *times, int(actuators))


_FACTS = [_fact(line) for line in _TABLE.strip().splitlines()]
_DOMAINS = list(dict.fromkeys(fact.domain for fact in _FACTS))
every_task = pytest.mark.parametrize("fact", _FACTS, ids=lambda fact: f"{fact.domain}:{fact.task}")

# Arguments of the factories, in dm_control's order, by task or domain.
_BASIC = ["time_limit", "random", "environment_kwargs"]
_ARGUMENTS = {
    "manipulator": ["fully_observable", *_BASIC],
    "stacker": ["fully_observable", *_BASIC],
    "three_poles": ["time_limit", "random", "num_poles", "sparse", "environment_kwargs"],
}

_MANIPULATOR = ("bring_ball", "bring_peg", "insert_ball", "insert_peg")
_STACKER = ("stack_2", "stack_4")

# Numbers of lines of the dm_control files that these replace.
_LONGEST = {humanoid: 206, manipulator: 287, stacker: 203}
_NAMES_FOR_OTHERS = 10  # lines around the pictures, figures of starts, the planner's cost
_FIRST = ("humanoid", "manipulator", "stacker")
# Of the other sixteen domains; the list of public names, one to a line, does not count.
_MOST_LINES, _MOST_LINES_OF_MODELS = 2_630, 2_000


def _lines_of(module: ModuleType, name: str) -> int:
    """The number of lines that assign a name in a module."""
    return sum(
        (node.end_lineno or 0) - node.lineno + 1
        for node in ast.parse(inspect.getsource(module)).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name
    )


def _lines_of_perturbations(module: ModuleType) -> int:
    """The number of lines that perturb a model, as the Real World RL suite does, not dm_control."""
    functions, tables = [], []
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.FunctionDef) and node.name.startswith("_set_"):
            functions.append(node)
        elif isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "PERTURBATIONS":
            tables.append(node)
    lines = sum((node.end_lineno or 0) - node.lineno + 1 for node in (*functions, *tables))
    return lines + 2 * len(functions)  # and the blank lines between functions


def _tagged(letter: str) -> tuple[tuple[str, str], ...]:
    return tuple((fact.domain, fact.task) for fact in _FACTS if letter in fact.tags)


def test_all_tasks_are_dm_controls_in_its_order() -> None:
    assert tuple((fact.domain, fact.task) for fact in _FACTS) == suite.ALL_TASKS
    assert {
        domain: tuple(fact.task for fact in _FACTS if fact.domain == domain) for domain in _DOMAINS
    } == suite.TASKS_BY_DOMAIN


def test_tags_are_dm_controls() -> None:
    every, benchmarking, hidden = set(suite.ALL_TASKS), _tagged("B"), _tagged("N")
    expected = {"BENCHMARKING": benchmarking, "EASY": _tagged("E"), "HARD": _tagged("H")}
    expected |= {"EXTRA": tuple(sorted(every - set(benchmarking))), "NO_REWARD_VIZ": hidden}
    expected |= {"REWARD_VIZ": tuple(sorted(every - set(hidden)))}
    assert {name: getattr(suite, name) for name in expected} == expected
    assert [len(expected[name]) for name in ("BENCHMARKING", "EASY", "HARD")] == [28, 3, 7]


def test_private_names_that_programs_use_exist() -> None:
    assert list(suite._DOMAINS) == list(_DOMAINS)
    assert suite._DOMAINS["humanoid"] is humanoid
    assert suite._get_tasks("benchmarking") == suite.BENCHMARKING
    assert suite._get_tasks(None) == suite.ALL_TASKS
    easy = suite._get_tasks_by_domain(suite.EASY)
    assert easy == {"ball_in_cup": ("catch",), "point_mass": ("easy",), "reacher": ("easy",)}


@every_task
def test_a_task_has_its_times_and_actuators(fact: _Fact) -> None:
    env = suite.load(fact.domain, fact.task)
    assert isinstance(env, control.Environment)
    assert env.control_timestep() == pytest.approx(fact.control_timestep, rel=1e-12)
    assert env.action_spec().shape == (fact.actuators,)
    factory = suite._DOMAINS[fact.domain].SUITE[fact.task]
    parameters = inspect.signature(factory).parameters
    expected = _ARGUMENTS.get(fact.task, _ARGUMENTS.get(fact.domain, _BASIC))
    assert list(parameters) == expected
    assert parameters["time_limit"].default == fact.time_limit


def test_environment_kwargs_in_those_of_the_task_are_kept_beside_others() -> None:
    of_task = {"environment_kwargs": {"flat_observation": True, "n_sub_steps": 2}}
    env = suite.load("cartpole", "swingup", of_task, {"n_sub_steps": 3})
    assert list(env.reset().observation) == ["observations"]
    assert env._n_sub_steps == 3  # the last one, as in dm_control
    env = suite.load("cartpole", "swingup", of_task, faults="easy")
    assert list(env.observation_spec()) == ["observations"]


@pytest.mark.parametrize("name", ["physics", "task", "flat"])
def test_unknown_environment_kwargs_are_named_with_those_that_there_are(name: str) -> None:
    with pytest.raises(TypeError, match=f"in environment_kwargs '{name}'") as caught:
        suite.load("cartpole", "swingup", environment_kwargs={name: 1})
    assert "flat_observation" in str(caught.value)
    assert "time_limit" not in str(caught.value)


def test_a_domain_that_is_no_text_is_refused() -> None:
    domain: object = ["walker"]
    with pytest.raises(ValueError, match=r"Domain \['walker'\] does not exist"):
        suite.load(domain, "walk")  # pyright: ignore[reportArgumentType]


@every_task
def test_keywords_reach_the_factory_and_the_environment(fact: _Fact) -> None:
    domain, task = fact.domain, fact.task
    env = suite.load(
        domain,
        task,
        task_kwargs={"time_limit": 2 * fact.control_timestep, "random": 3},
        environment_kwargs={"flat_observation": True, "legacy_step": False},
        visualize_reward=True,
    )
    assert list(env.reset().observation) == ["observations"]
    assert env.physics.legacy_step is False
    assert env.task.visualize_reward is True
    action = np.zeros(env.action_spec().shape)
    assert env.step(action).mid()
    assert env.step(action).last()
    other = suite.build_environment(
        domain, task, {"random": 3, "environment_kwargs": {"flat_observation": True}}
    )
    assert other.task.visualize_reward is False
    np.testing.assert_array_equal(
        other.reset().observation["observations"],
        suite.load(domain, task, {"random": 3}, {"flat_observation": True})
        .reset()
        .observation["observations"],
    )


@pytest.mark.parametrize("task", [*_MANIPULATOR, *_STACKER])
def test_partly_observable_tasks_show_the_arm_alone(task: str) -> None:
    domain = "stacker" if task in _STACKER else "manipulator"
    whole = suite.load(domain, task, {"random": 0}).reset().observation
    part = suite.load(domain, task, {"random": 0, "fully_observable": False}).reset().observation
    assert list(part) == ["arm_pos", "arm_vel", "touch"] == list(whole)[:3]
    for name, value in part.items():
        np.testing.assert_array_equal(value, whole[name])


@pytest.mark.parametrize(
    ("domain", "task", "shapes"),
    [
        (
            "humanoid",
            "run",
            {
                "joint_angles": (21,),
                "head_height": (),
                "extremities": (12,),
                "torso_vertical": (3,),
                "com_velocity": (3,),
                "velocity": (27,),
            },
        ),
        ("humanoid", "run_pure_state", {"position": (28,), "velocity": (27,)}),
        (
            "manipulator",
            "bring_peg",
            {
                "arm_pos": (8, 2),
                "arm_vel": (8,),
                "touch": (5,),
                "hand_pos": (4,),
                "object_pos": (4,),
                "object_vel": (3,),
                "target_pos": (4,),
            },
        ),
        (
            "stacker",
            "stack_4",
            {
                "arm_pos": (8, 2),
                "arm_vel": (8,),
                "touch": (5,),
                "hand_pos": (4,),
                "box_pos": (4, 4),
                "box_vel": (12,),
                "target_pos": (2,),
            },
        ),
    ],
)
def test_the_layout_of_an_observation(domain: str, task: str, shapes: dict) -> None:
    spec = suite.load(domain, task).observation_spec()
    assert {name: part.shape for name, part in spec.items()} == shapes
    assert list(spec) == list(shapes)
    assert all(part.dtype == float for part in spec.values())


@pytest.mark.parametrize("module", _LONGEST, ids=lambda module: module.__name__)
def test_a_domain_is_shorter_than_dm_controls(module: ModuleType) -> None:
    lines = len(inspect.getsource(module).splitlines())
    # Not in dm_control: the kinds of starts, the pictures of the gallery, a line per task, the
    # meanings of the observations, and perturbations.
    beside = sum(
        len(inspect.getsource(vars(value)["start"]).splitlines())
        for value in vars(module).values()
        if inspect.isclass(value) and value.__module__ == module.__name__ and "start" in vars(value)
    )
    beside += len(module.PICTURES) + _NAMES_FOR_OTHERS
    beside += _lines_of(module, "OBSERVATIONS") + _lines_of_perturbations(module)
    assert lines - beside <= _LONGEST[module]


def test_the_other_domains_are_short() -> None:
    names = {*_DOMAINS, "lqr_solver"} - set(_FIRST)
    modules = [importlib.import_module(f"limberjack.suite.{name}") for name in names]
    lines = {
        module.__name__: inspect.getsource(module).count("\n")
        - _lines_of(module, "__all__")
        - _lines_of_perturbations(module)
        for module in modules
    }
    assert sum(lines.values()) <= _MOST_LINES, lines


def test_the_models_of_the_other_domains_are_short() -> None:
    folder = Path(suite.__file__).parent
    names = set(_DOMAINS) - set(_FIRST)
    lines = {name: (folder / f"{name}.xml").read_text().count("\n") for name in names}
    assert sum(lines.values()) <= _MOST_LINES_OF_MODELS, lines
