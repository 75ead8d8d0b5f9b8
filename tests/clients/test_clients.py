"""Programs written for dm_control run on Limberjack as they stand, with dm_control's numbers."""

import functools
import importlib.util
import json
import math
import os
from pathlib import Path
from typing import Any

import pytest

from tests.programs import INSTALL
from tests.warm import DM_CONTROL, run

_HERE = Path(__file__).parent
_LINES = {  # what each program prints
    "gym_bridge": 6,
    "model_based": 10,
    "own_domain": 20,
    "planner": 9,
    "spec_driven": 8,
    "dreamer": 12,
    "pixel_learner": 2,
    "background": 6,
    "custom_tasks": 264,
}
_CAN_DRAW = os.environ.get("MUJOCO_GL") != "disable"
_NO_OPENGL = "" if _CAN_DRAW else "there is no off-screen OpenGL"
_NO_LXML = "" if importlib.util.find_spec("lxml") else "lxml is not installed"
_CANNOT_RUN = {
    **dict.fromkeys(("background", "dreamer", "pixel_learner"), _NO_OPENGL),
    "custom_tasks": _NO_LXML,
}
_CLIENTS = [
    pytest.param(client, marks=pytest.mark.skipif(bool(reason), reason=reason))
    for client in _LINES
    for reason in [_CANNOT_RUN.get(client, "")]
]
_PLAY = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='__main__')"


@functools.cache
def play(client: str) -> str:
    """The output of a program on Limberjack, which every test of the program reads."""
    return run(f"{INSTALL}; {_PLAY}", str(_HERE / f"{client}.py"))


def play_on_dm_control(client: str) -> str:
    """The output of a program on the real dm_control."""
    # dm_control logs to standard error, and loads on this MuJoCo with the oracle's help.
    patch = "import logging; logging.disable(); import tests.oracle.oracle"
    file = str(_HERE / f"{client}.py")
    return run(
        f"{patch}; {_PLAY}", file, path=_HERE.parents[1], warnings="ignore", imports=DM_CONTROL
    )


def numbers(value: Any) -> list[float]:
    """All numbers in what JSON can hold."""
    if isinstance(value, dict):
        return [n for item in value.values() for n in numbers(item)]
    if isinstance(value, list):
        return [n for item in value for n in numbers(item)]
    return [] if isinstance(value, str | None) else [value]


@pytest.mark.parametrize("client", _CLIENTS)
def test_a_program_runs_and_prints_what_makes_sense(client: str) -> None:
    results = [json.loads(line) for line in play(client).splitlines()]
    assert len(results) >= _LINES[client]
    for result in results:
        values = numbers(result)
        assert len(values) > 0
        assert all(math.isfinite(value) for value in values)
        assert 0.0 <= result.get("reward", 0.0) <= 2.0  # one step's, or that of two


@pytest.mark.oracle
@pytest.mark.parametrize("client", _CLIENTS)
def test_a_program_prints_the_same_as_on_dm_control(client: str) -> None:
    if importlib.util.find_spec("dm_control") is None:
        pytest.skip("dm_control is not installed")
    expected = play_on_dm_control(client).splitlines()
    assert play(client).splitlines() == expected


def test_the_manipulators_documented_examples_run() -> None:
    program = f"""
    {INSTALL}
    from dm_control import suite

    env = suite.load(domain_name="manipulator", task_name="bring_ball")
    time_step, steps = env.reset(), 0
    while not time_step.last():
        time_step = env.step(env.action_spec().generate_value())
        steps += 1
    assert steps == 1000
    keys = ["arm_pos", "arm_vel", "touch"]
    state = ["hand_pos", "object_pos", "object_vel", "target_pos"]
    assert list(time_step.observation) == keys + state
    assert [time_step.observation[key].shape for key in keys] == [(8, 2), (8,), (5,)]
    assert [time_step.observation[key].shape for key in state] == [(4,), (4,), (3,), (4,)]

    insert = suite.load(domain_name="manipulator", task_name="insert_peg")
    assert 0 <= insert.step(insert.reset() and insert.action_spec().generate_value()).reward <= 1

    partial = suite.load(
        domain_name="manipulator",
        task_name="bring_ball",
        task_kwargs={{"fully_observable": False}},
    )
    assert list(partial.reset().observation) == keys
    """
    run(program)


def test_the_stackers_documented_examples_run() -> None:
    program = f"""
    {INSTALL}
    from dm_control import suite
    from dm_control.suite import stacker

    for task, boxes in (("stack_2", 2), ("stack_4", 4)):
        env = suite.load("stacker", task)
        time_step, steps = env.reset(), 0
        while not time_step.last():
            time_step = env.step(env.action_spec().generate_value())
            print("Reward:", time_step.reward)
            steps += 1
        assert steps == 1000
        assert time_step.observation["box_pos"].shape == (boxes, 4)
    xml, assets = stacker.make_model(2)
    assert b"box1" in xml and b"box2" not in xml and isinstance(assets, dict)
    assert isinstance(stacker.stack_2(time_limit=1).physics, stacker.Physics)
    """
    assert run(program).count("Reward:") == 2000


def test_the_humanoids_documented_examples_run() -> None:
    program = f"""
    {INSTALL}
    from dm_control import suite
    import dm_control.rl.control

    env = suite.load(domain_name="humanoid", task_name="walk")
    assert isinstance(env, dm_control.rl.control.Environment)
    time_step, steps = env.reset(), 0
    while not time_step.last():
        time_step = env.step(env.action_spec().generate_value())
        steps += 1
    assert steps == 1000
    assert list(time_step.observation) == [
        "joint_angles", "head_height", "extremities", "torso_vertical", "com_velocity", "velocity"
    ]
    assert suite.load(domain_name="humanoid", task_name="run").reset().first()
    pure = suite.load(domain_name="humanoid", task_name="run_pure_state").reset()
    assert list(pure.observation) == ["position", "velocity"]
    """
    run(program)


def test_shimmys_bridge_to_gymnasium_runs_a_task() -> None:
    if importlib.util.find_spec("shimmy") is None:
        pytest.skip("shimmy is not installed")
    program = f"""
    {INSTALL}
    import sys, gymnasium, numpy as np, shimmy
    from dm_control import suite
    from dm_control.suite.wrappers import action_scale
    from shimmy.dm_control_compatibility import DmControlCompatibilityV0

    twin = suite.load("stacker", "stack_2", task_kwargs={{"random": 0}})
    env = DmControlCompatibilityV0(suite.load("stacker", "stack_2"))
    for episode in range(2):
        observation, info = env.reset(seed=episode)
        twin.task._random = np.random.RandomState(episode)
        expected = twin.reset()
        for key, value in expected.observation.items():
            np.testing.assert_array_equal(observation[key], value)
        assert env.observation_space.contains(observation)
        terminated = truncated = False
        while not (terminated or truncated):
            action = np.full(5, 0.3)
            observation, reward, terminated, truncated, info = env.step(action)
            expected = twin.step(action)
            assert reward == expected.reward
        assert truncated and not terminated and expected.last()
    wrapped = DmControlCompatibilityV0(action_scale.Wrapper(suite.load("humanoid", "run"), 0, 1))
    wrapped.reset(seed=3)
    env.close()
    if sys.argv[1] == "draw":
        task = suite.load("manipulator", "bring_ball")
        for mode, shape in (
            ("rgb_array", (60, 80, 3)),
            ("depth_array", (60, 80)),
            ("multi_camera", (60, 160, 3)),  # two cameras
        ):
            env = DmControlCompatibilityV0(task, mode, {{"height": 60, "width": 80}})
            env.reset()
            assert env.render().shape == shape, mode
    made = gymnasium.make("dm_control/humanoid-walk-v0")
    made.reset(seed=0)
    made.step(made.action_space.sample())
    made.close()
    """
    run(program, "draw" if _CAN_DRAW else "", warnings="ignore")
