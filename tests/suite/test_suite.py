"""Tests of limberjack.suite: the list of tasks, and loading."""

import ast
import inspect
from types import ModuleType

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.suite import humanoid, manipulator, stacker

_HUMANOID = ("stand", "walk", "run", "run_pure_state")
_MANIPULATOR = ("bring_ball", "bring_peg", "insert_ball", "insert_peg")
_STACKER = ("stack_2", "stack_4")

# Numbers of lines of the dm_control files that these replace.
_LONGEST = {humanoid: 206, manipulator: 287, stacker: 203}
_NAMES_FOR_OTHERS = 10  # lines around the pictures, figures of starts, the planner's cost

# Control step and default time limit in seconds, and actuators.
_TIMES = {"humanoid": (0.025, 25, 21), "manipulator": (0.01, 10, 5), "stacker": (0.01, 10, 5)}


def test_all_tasks_are_the_ten_in_order() -> None:
    by_domain = {"humanoid": _HUMANOID, "manipulator": _MANIPULATOR, "stacker": _STACKER}
    expected = tuple((domain, task) for domain, tasks in by_domain.items() for task in tasks)
    assert expected == suite.ALL_TASKS
    assert by_domain == suite.TASKS_BY_DOMAIN


def test_tags_are_dm_controls() -> None:
    benchmarking = [("humanoid", task) for task in _HUMANOID[:3]] + [("manipulator", "bring_ball")]
    extra = sorted(set(suite.ALL_TASKS) - set(benchmarking))
    hard = [task for task in suite.ALL_TASKS if task[0] != "humanoid"]
    expected = {"BENCHMARKING": benchmarking, "EXTRA": extra, "EASY": [], "HARD": hard}
    expected |= {"NO_REWARD_VIZ": [], "REWARD_VIZ": sorted(suite.ALL_TASKS)}
    assert {name: list(getattr(suite, name)) for name in expected} == expected
    assert all(type(getattr(suite, name)) is tuple for name in expected)


def test_private_names_that_programs_use_exist() -> None:
    assert dict(suite._DOMAINS) == {
        "humanoid": humanoid,
        "manipulator": manipulator,
        "stacker": stacker,
    }
    assert suite._get_tasks("benchmarking") == suite.BENCHMARKING
    assert suite._get_tasks(None) == suite.ALL_TASKS
    assert suite._get_tasks_by_domain(suite.BENCHMARKING) == {
        "humanoid": _HUMANOID[:3],
        "manipulator": ("bring_ball",),
    }


@pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
def test_a_task_has_its_times_and_actuators(domain: str, task: str) -> None:
    control_timestep, time_limit, actuators = _TIMES[domain]
    env = suite.load(domain, task)
    assert isinstance(env, control.Environment)
    assert env.control_timestep() == control_timestep
    assert env.action_spec().shape == (actuators,)
    factory = suite._DOMAINS[domain].SUITE[task]
    parameters = inspect.signature(factory).parameters
    names = ["time_limit", "random", "environment_kwargs"]
    assert list(parameters) == (["fully_observable"] if domain != "humanoid" else []) + names
    assert parameters["time_limit"].default == time_limit


@pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
def test_keywords_reach_the_factory_and_the_environment(domain: str, task: str) -> None:
    control_timestep, _, _ = _TIMES[domain]
    env = suite.load(
        domain,
        task,
        task_kwargs={"time_limit": 2 * control_timestep, "random": 3},
        environment_kwargs={"flat_observation": True, "legacy_step": False},
        visualize_reward=True,
    )
    assert list(env.reset().observation) == ["observations"]
    assert env.physics.legacy_step is False
    assert env.task.visualize_reward is True
    action = np.zeros(env.action_spec().shape)
    assert env.step(action).mid()
    assert env.step(action).last()
    twin = suite.build_environment(
        domain, task, {"random": 3, "environment_kwargs": {"flat_observation": True}}
    )
    assert twin.task.visualize_reward is False
    np.testing.assert_array_equal(
        twin.reset().observation["observations"],
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
    # Not in dm_control: the kinds of starts, the pictures of the gallery, a line per task, and the
    # meanings of the observations.
    beside = sum(
        len(inspect.getsource(vars(value)["start"]).splitlines())
        for value in vars(module).values()
        if inspect.isclass(value) and value.__module__ == module.__name__ and "start" in vars(value)
    )
    beside += len(module.PICTURES) + _NAMES_FOR_OTHERS
    beside += sum(
        (node.end_lineno or 0) - node.lineno + 1
        for node in ast.parse(inspect.getsource(module)).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "OBSERVATIONS"
    )
    assert lines - beside <= _LONGEST[module]
