"""Tests of limberjack.suite.base with a user task."""

import inspect
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import base, common

_XML = """
<mujoco>
  <include file="./common/visual.xml"/>
  <include file="./common/skybox.xml"/>
  <include file="./common/materials.xml"/>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" limited="true" range="-2 2"/>
      <geom name="cart" size=".1" material="self"/>
    </body>
  </worldbody>
  <actuator><motor joint="slide" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


_MATERIALS = ("self", "effector", "target")


class Stay(base.Task):
    """Stay in the middle."""

    def initialize_episode(self, physics: Any) -> None:
        physics.named.data.qpos["slide"] = self.random.uniform(-1, 1)
        super().initialize_episode(physics)

    def get_observation(self, physics: Any) -> dict:
        return {"position": physics.position()}

    def get_reward(self, physics: Any) -> float:
        return float(np.exp(-abs(physics.position()[0])))


def make(random: Any = None) -> control.Environment:
    physics = mujoco.Physics.from_xml_string(_XML, common.ASSETS)
    return control.Environment(physics, Stay(random), time_limit=0.02)


def control_batch(num_envs: int) -> BatchEnvironment:
    """A batch of cartpoles whose episodes have begun."""
    batch = suite.load_batch("cartpole", "swingup", num_envs, 1, seed=0)
    batch.reset()
    return batch


def test_an_attribute_of_a_users_task_is_no_kind_of_start() -> None:
    env = suite.load("cartpole", "balance")
    task: Any = SimpleNamespace(start=np.zeros(2))
    env._task = task
    assert base.kind_of_start(env) is None


def test_a_user_task_runs() -> None:
    env = make(random=0)
    first = env.reset()
    assert first.observation["position"] == np.random.RandomState(0).uniform(-1, 1)
    steps = [env.step([0.5]) for _ in range(10)]
    assert [step.last() for step in steps] == [False] * 9 + [True]
    assert steps[-1].reward == np.exp(-abs(steps[-1].observation["position"][0]))
    np.testing.assert_array_equal(env.physics.control(), [0.5])


def test_random_is_a_stream_a_seed_or_none() -> None:
    stream = np.random.RandomState(5)
    assert Stay(stream).random is stream
    assert Stay(7).random.uniform() == np.random.RandomState(7).uniform()
    before = np.random.get_state()[1].tolist()  # pyright: ignore[reportArgumentType, reportCallIssue, reportIndexIssue]
    assert Stay().random.uniform() != Stay(None).random.uniform()
    after = np.random.get_state()[1].tolist()  # pyright: ignore[reportArgumentType, reportCallIssue, reportIndexIssue]
    assert before == after


def test_the_action_spec_is_the_actuators() -> None:
    spec = make().action_spec()
    assert (spec.shape, spec.minimum.tolist(), spec.maximum.tolist()) == ((1,), [-1.0], [1.0])


def test_a_wrapped_action_is_looked_into() -> None:
    env = make()
    env.reset()
    env.task.before_step(SimpleNamespace(continuous_actions=[0.25]), env.physics)
    np.testing.assert_array_equal(env.physics.control(), [0.25])


@pytest.mark.parametrize("action", [0.25, [0.25], [[0.25]], [[[0.25]]], np.float32(0.25)])
def test_one_number_for_one_actuator_may_have_any_shape(action: Any) -> None:
    env, same = make(random=0), make(random=0)
    env.reset(), same.reset()
    ours, theirs = env.step(action), same.step([0.25])
    assert ours.observation["position"] == theirs.observation["position"]
    np.testing.assert_array_equal(env.physics.control(), [0.25])


@pytest.mark.parametrize("shape", [(0,), (2,), (1, 2), (2, 1), (1, 0)])
def test_more_or_fewer_numbers_than_one_are_refused(shape: tuple[int, ...]) -> None:
    env = make(random=0)
    env.reset()
    with pytest.raises(ValueError, match=r"expected \(1,\): one number for each actuator"):
        env.step(np.zeros(shape))
    assert env.physics.time() == 0.0


@pytest.mark.parametrize("num_envs", [1, 3])
@pytest.mark.parametrize("more", [(), (1,), (1, 1)])
def test_one_number_for_each_row_may_have_any_shape(num_envs: int, more: tuple[int, ...]) -> None:
    batch, same = (control_batch(num_envs) for _ in range(2))
    actions = np.linspace(-1, 1, num_envs)
    first, second = batch.step(actions.reshape(num_envs, *more)), same.step(actions[:, None])
    for name, value in first.observation.items():
        np.testing.assert_array_equal(value, second.observation[name])


@pytest.mark.parametrize("shape", [(3, 2), (3, 0), (3, 1, 2)])
def test_a_batch_refuses_another_number_of_numbers(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"expected \(3, 1\)"):
        control_batch(3).step(np.zeros(shape))


@pytest.mark.parametrize("shape", [(), (1,), (1, 21), (21, 1), (1, 1, 21)])
def test_several_actuators_take_the_shape_of_the_spec_only(shape: tuple[int, ...]) -> None:
    env = suite.load("humanoid", "stand")
    env.reset()
    with pytest.raises(ValueError, match=r"expected \(21,\)"):
        env.step(np.zeros(shape))


@pytest.mark.parametrize("value", [1, 0, None, "yes", np.bool_(True)])
def test_visualize_reward_is_a_boolean(value: Any) -> None:
    task = Stay()
    with pytest.raises(ValueError, match="Expected a boolean, got"):
        task.visualize_reward = value
    assert task.visualize_reward is False


@pytest.mark.parametrize(("reward", "blend"), [(0.0, 0.0), (1.0, 1.0), (0.5, 0.0625), (7.0, 1.0)])
def test_the_reward_is_shown_at_the_start_and_after_each_step(reward: float, blend: float) -> None:
    env = make(random=0)
    env.task.get_reward = lambda physics: reward
    colours = env.physics.named.model.mat_rgba
    plain = [colours[name].copy() for name in _MATERIALS]
    env.reset()
    assert np.array_equal([colours[name] for name in _MATERIALS], plain)
    env.task.visualize_reward = True
    for move in (env.reset, lambda: env.step([0.0])):
        colours[list(_MATERIALS)] = 0.0
        move()
        for name in _MATERIALS:
            highlight, default = colours[f"{name}_highlight"], colours[f"{name}_default"]
            # Colours are of single precision.
            expected = blend * highlight + (1 - blend) * default
            np.testing.assert_allclose(colours[name], expected, atol=1e-6)


def test_a_model_without_the_coloured_materials_is_refused_by_name() -> None:
    xml = _XML.replace(' material="self"', "").replace(
        '<include file="./common/materials.xml"/>', ""
    )
    task = Stay()
    task.visualize_reward = True
    env = control.Environment(mujoco.Physics.from_xml_string(xml, common.ASSETS), task)
    with pytest.raises(ValueError, match=r"lacks a material that .*self.*common/materials\.xml"):
        env.reset()


def test_a_start_is_drawn_until_nothing_touches() -> None:
    env = make()
    physics, drawn = env.physics, []
    contacts = iter([3, 1, 0])
    counted = SimpleNamespace(ncon=0)

    def draw() -> None:
        drawn.append(len(drawn))
        counted.ncon = next(contacts)

    told = SimpleNamespace(after_reset=lambda: drawn.append("after_reset"), data=counted)
    env.task.draw_collision_free_start(told, draw)
    assert drawn == [0, "after_reset", 2, "after_reset", 4, "after_reset"]
    assert physics.data.ncon == 0


def test_a_missing_method_of_a_task_is_named() -> None:
    class Nothing(base.Task):
        def get_observation(self, physics: Any) -> dict:
            return {}

    with pytest.raises(NotImplementedError, match="Nothing"):
        Nothing().get_reward(make().physics)
    assert Nothing().start(make().physics) is None


def test_options_are_those_of_an_environment() -> None:
    parameters = list(inspect.signature(control.Environment).parameters)
    assert parameters[:3] == ["physics", "task", "time_limit"]
    assert set(base.StepOptions.__annotations__) == set(parameters[3:])
    # A task sets them itself, unless it keeps the step of its physics.
    of_the_step = {"control_timestep", "n_sub_steps"}
    assert set(base.Options.__annotations__) == set(parameters[3:]) - of_the_step


def test_the_reward_is_the_product_of_its_terms_unless_a_task_combines_them_otherwise() -> None:
    assert Stay().reward_of({"near": 0.5, "high": 0.25, "still": 0.9}) == 0.5 * 0.25 * 0.9
    assert Stay().reward_of({"near": 0.5}) == 0.5


def test_success_is_all_terms_of_the_goal_nearly_1() -> None:
    class Two(Stay):
        GOAL = ("near", "high")

    for near, high, expected in ((1.0, 0.95, True), (1.0, 0.5, False), (0.5, 1.0, False)):
        assert Two().is_success({"near": near, "high": high, "small_control": 0.0}) == expected


def test_a_goal_that_is_no_term_is_named() -> None:
    class Misspelled(Stay):
        GOAL = ("naer",)

    message = "GOAL of task Misspelled names 'naer', which is none of its terms: near, high. Did"
    with pytest.raises(ValueError, match=message):
        Misspelled().is_success({"near": 1.0, "high": 1.0})
