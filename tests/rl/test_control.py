"""Tests of limberjack.rl.control with a small physics and task."""

import collections
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs

from limberjack.rl import control

_TIMESTEP = 0.125  # seconds; exact in binary


class Counter(control.Physics):
    """A number that grows by the control at each step."""

    def __init__(self, timestep: float = _TIMESTEP) -> None:
        self.value = 0.0
        self.speed = 0.0
        self.told: list[str] = []
        self._time = 0.0
        self._timestep = timestep

    def step(self, n_sub_steps: int = 1) -> None:
        self.told.append(f"step {n_sub_steps}")
        self.value += self.speed * n_sub_steps
        self._time += n_sub_steps * self._timestep
        if abs(self.value) > 1e6:
            raise control.PhysicsError("the number is too large")

    def time(self) -> float:
        return self._time

    def timestep(self) -> float:
        return self._timestep

    def set_control(self, control: Any) -> None:
        self.speed = float(np.asarray(control)[0])

    def reset(self) -> None:
        self.told.append("reset")
        self.value = self.speed = self._time = 0.0

    def after_reset(self) -> None:
        self.told.append("after_reset")


class Reach(control.Task):
    """The number should reach 10, at which the episode ends."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def initialize_episode(self, physics: Any) -> None:
        physics.told.append("initialize_episode")
        physics.value = 1.0

    def before_step(self, action: Any, physics: Any) -> None:
        physics.told.append("before_step")
        physics.set_control(action)

    def after_step(self, physics: Any) -> None:
        physics.told.append("after_step")

    def action_spec(self, physics: Any) -> Any:
        return specs.BoundedArray((1,), float, -1.0, 1.0)

    def get_observation(self, physics: Any) -> Any:
        physics.told.append("get_observation")
        parts = {"value": np.array([physics.value]), "speed": np.array([physics.speed])}
        return collections.OrderedDict(parts)

    def get_reward(self, physics: Any) -> float:
        physics.told.append("get_reward")
        return physics.value / 10

    def get_termination(self, physics: Any) -> float | None:
        physics.told.append("get_termination")
        return 0.0 if physics.value >= 10 else None


def make(**kwargs: Any) -> Any:
    return control.Environment(Counter(), Reach(), **kwargs)


def test_methods_are_called_in_the_documented_order() -> None:
    env = make(n_sub_steps=3)
    told = env.physics.told
    env.reset()
    assert told == ["reset", "initialize_episode", "after_reset", "get_observation"]
    told.clear()
    env.step([0.5])
    assert told == [
        "before_step",
        "step 3",
        "after_step",
        "get_reward",
        "get_observation",
        "get_termination",
    ]


def test_a_step_returns_the_tasks_quantities_of_the_new_state() -> None:
    env = make()
    first = env.reset()
    assert (first.reward, first.discount) == (None, None)
    assert first.step_type is dm_env.StepType.FIRST
    assert first.observation["value"] == [1.0]
    step = env.step([0.5])
    assert (step.reward, step.discount) == (0.15, 1.0)
    assert step.step_type is dm_env.StepType.MID
    assert step.observation["value"] == [1.5]


def test_the_task_ends_an_episode_with_its_discount() -> None:
    env = make(n_sub_steps=9)
    env.reset()
    last = env.step([1.0])
    assert last.step_type is dm_env.StepType.LAST
    assert (last.reward, last.discount) == (1.0, 0.0)
    again = env.step([1.0])
    assert again.step_type is dm_env.StepType.FIRST
    assert again.observation["value"] == [1.0]


@pytest.mark.parametrize(
    ("time_limit", "n_sub_steps", "expected"),
    [(1.0, 1, 8), (1.0, 2, 4), (1.0, 3, 3), (1.1, 1, 9), (0.001, 1, 1), (0.5, 4, 1)],
)
def test_the_time_limit_ends_an_episode_at_the_first_step_that_reaches_it(
    time_limit: float, n_sub_steps: int, expected: int
) -> None:
    env = make(time_limit=time_limit, n_sub_steps=n_sub_steps)
    for _ in range(2):
        step, count = env.reset(), 0
        while not step.last():
            step, count = env.step([0.0]), count + 1
        assert count == expected
        assert step.discount == 1.0


def test_the_task_is_not_asked_for_its_termination_at_the_time_limit() -> None:
    env = make(time_limit=_TIMESTEP, n_sub_steps=1)
    env.reset()
    env.physics.value = 20.0
    assert env.step([0.0]).discount == 1.0
    assert "get_termination" not in env.physics.told


def test_without_a_time_limit_an_episode_does_not_end() -> None:
    env = make()
    env.reset()
    assert all(env.step([0.0]).mid() for _ in range(3000))


@pytest.mark.parametrize(
    "make_control_step", [{"n_sub_steps": 4}, {"control_timestep": 4 * _TIMESTEP}]
)
def test_the_control_step_is_given_in_seconds_or_physics_steps(make_control_step: Any) -> None:
    env = make(**make_control_step)
    assert env.control_timestep() == 4 * _TIMESTEP
    env.reset()
    env.step([0.0])
    assert env.physics.time() == 4 * _TIMESTEP


def test_the_physics_gets_legacy_step() -> None:
    assert make().physics.legacy_step is True
    assert make(legacy_step=False).physics.legacy_step is False


def test_specs_come_from_the_task() -> None:
    env = make()
    assert env.action_spec() == specs.BoundedArray((1,), float, -1.0, 1.0)
    assert env.observation_spec() == {
        "value": specs.Array((1,), np.dtype(float), name="value"),
        "speed": specs.Array((1,), np.dtype(float), name="speed"),
    }
    assert env.reward_spec() == specs.Array((), float, name="reward")
    assert env.discount_spec() == specs.BoundedArray((), float, 0.0, 1.0, name="discount")
    with pytest.raises(NotImplementedError, match="Reach does not define step_spec"):
        env.step_spec()
    env.task.observation_spec = lambda physics: {"value": "the task's own"}
    env.task.step_spec = lambda physics: "steps"
    assert env.observation_spec() == {"value": "the task's own"}
    assert env.step_spec() == "steps"


def test_an_error_at_a_step_makes_the_next_one_begin_an_episode() -> None:
    env = make()
    env.reset()
    env.physics.value = 1e7
    with pytest.raises(control.PhysicsError, match="too large"):
        env.step([0.0])
    assert env.step([0.0]).first()
    assert env.step([0.0]).mid()


def test_an_error_at_a_start_makes_the_next_step_begin_an_episode() -> None:
    env = make()
    env.reset()
    env.step([0.5])
    env.task.initialize_episode = lambda physics: 1 / 0
    with pytest.raises(ZeroDivisionError):
        env.reset()
    with pytest.raises(ZeroDivisionError):
        env.step([0.5])
    del env.task.initialize_episode
    assert env.step([0.5]).first()


def test_a_default_state_that_diverges_can_be_given_a_good_one() -> None:
    class Diverging(Counter):
        def reset(self) -> None:
            super().reset()
            raise control.PhysicsError("at the default state")

    env = control.Environment(Diverging(), Reach())
    assert env.reset().observation["value"] == [1.0]


def test_actions_in_a_structure_are_left_to_the_task() -> None:
    class Structured(Reach):
        def action_spec(self, physics: Any) -> Any:
            return {"speed": specs.Array((1,), float)}

        def before_step(self, action: Any, physics: Any) -> None:
            physics.set_control(action["speed"])

    env = control.Environment(Counter(), Structured())
    env.reset()
    assert env.step({"speed": [2.0]}).observation["value"] == [3.0]


def test_a_list_reaches_the_task_as_an_array() -> None:
    env = make()
    env.reset()
    env.task.before_step = lambda action, physics: physics.set_control(action * 0.5)
    assert env.step([1.0]).observation["value"] == [1.5]
    assert env.step((1,)).observation["value"] == [2.0]


def test_a_reward_that_is_a_view_stays_as_it_was() -> None:
    env, live = make(), np.zeros(1)
    env.reset()
    env.task.get_reward = lambda physics: live[..., 0]
    kept = []
    for number in range(3):
        live[0] = number
        kept.append(env.step([0.0]).reward)
    assert kept == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("ending", [False, True, np.bool_(False), np.array([False, True])])
def test_an_ending_that_is_no_discount_is_refused(ending: Any) -> None:
    env = make()
    env.reset()
    env.task.get_termination = lambda physics: ending
    with pytest.raises(
        TypeError, match=r"get_termination of task Reach returned .*; expected None"
    ):
        env.step([0.0])
    del env.task.get_termination
    assert env.step([0.0]).first()


def test_a_wrapped_action_is_looked_into() -> None:
    Wrapped = collections.namedtuple("Wrapped", ["continuous_actions"])
    env = make()
    env.reset()
    env.task.before_step = lambda action, physics: physics.set_control(action.continuous_actions)
    assert env.step(Wrapped(np.array([0.5]))).observation["value"] == [1.5]
    with pytest.raises(ValueError, match="not finite at index"):
        env.step(Wrapped(np.array([np.nan])))


def test_the_task_checks_the_shape_of_an_action() -> None:
    env = make()
    env.reset()
    env.task.before_step = lambda action, physics: physics.set_control(action.sum(keepdims=True))
    assert env.step(np.array([0.25, 0.5])).observation["value"] == [1.75]


def test_a_physics_without_free_can_be_closed() -> None:
    env = make()
    env.reset()
    env.close()
    env.close()
    with pytest.raises(RuntimeError, match="closed"):
        env.step([0.0])


def test_a_physics_that_does_not_define_set_control_is_named() -> None:
    class Still(Counter):
        set_control = control.Physics.set_control

    with pytest.raises(NotImplementedError, match="Still does not define set_control"):
        Still().set_control([0.0])


@pytest.mark.parametrize(
    ("control_timestep", "physics_timestep", "expected"),
    [
        (0.2, 0.1, 2),
        (0.1, 0.1, 1),
        (0.03, 0.01, 3),
        (0.025, 0.005, 5),
        (1.0, 1e-4, 10_000),
        (3, 1, 3),
    ],
)
def test_a_control_step_is_a_whole_number_of_physics_steps(
    control_timestep: float, physics_timestep: float, expected: int
) -> None:
    steps = control.compute_n_steps(control_timestep, physics_timestep)
    assert steps == expected
    assert type(steps) is int


@pytest.mark.parametrize(
    ("control_timestep", "physics_timestep", "match"),
    [
        (3, 2, "integer multiple"),
        (0.003, 0.00101, "integer multiple"),
        (1, 2, "smaller"),
        (0.0, 0.1, "smaller"),
        (float("inf"), 0.1, "integer multiple"),
        (float("nan"), 0.1, "smaller"),
        (0.1, float("nan"), "smaller"),
    ],
)
def test_a_control_step_that_is_not_a_multiple_is_refused(
    control_timestep: float, physics_timestep: float, match: str
) -> None:
    with pytest.raises(ValueError, match=match):
        control.compute_n_steps(control_timestep, physics_timestep)


def test_the_tolerance_of_the_control_step_is_that_of_the_ratio() -> None:
    assert control.compute_n_steps(1.0 + 1e-10, 0.1) == 10
    assert control.compute_n_steps(1.001, 0.1, tolerance=0.1) == 10
    with pytest.raises(ValueError, match="multiple"):
        control.compute_n_steps(1.001, 0.1)


def test_an_ordered_dict_is_flattened_in_its_order_and_others_in_that_of_their_names() -> None:
    parts = [("b", np.array([[1.0, 2.0], [3.0, 4.0]])), ("a", np.array(0.0))]
    for kind, expected in ((collections.OrderedDict, [1, 2, 3, 4, 0]), (dict, [0, 1, 2, 3, 4])):
        flat = control.flatten_observation(kind(parts))
        assert type(flat) is kind
        assert list(flat) == ["observations"]
        np.testing.assert_array_equal(flat["observations"], expected)
    assert list(control.flatten_observation(dict(parts), "state")) == ["state"]


@pytest.mark.parametrize("bad", [np.zeros(3), [("a", np.zeros(3))], None, "a"])
def test_only_mappings_are_flattened(bad: Any) -> None:
    with pytest.raises(ValueError, match=f"dict-like observations, got {type(bad).__name__}"):
        control.flatten_observation(bad)


def test_a_flat_environment_has_a_flat_spec() -> None:
    env = make(flat_observation=True)
    spec = env.observation_spec()
    assert list(spec) == ["observations"]
    assert spec["observations"].shape == (2,)
    np.testing.assert_array_equal(env.reset().observation["observations"], [1.0, 0.0])


def test_nan_lets_an_episode_go_on_as_in_a_batch() -> None:
    env = make()
    env.reset()
    for go_on in (np.nan, np.array(np.nan), np.where(False, 0.0, np.nan)):
        env.task.get_termination = lambda physics, value=go_on: value
        time_step = env.step([0.0])
        assert time_step.mid()
        assert time_step.discount == 1.0
    env.task.get_termination = lambda physics: np.where(True, 0.0, np.nan)
    assert env.step([0.0]).last()


def test_a_task_without_a_stream_is_named_where_one_is_needed() -> None:
    env = make()
    env.reset()
    with pytest.raises(TypeError, match=r"task Reach has no numpy\.random\.RandomState `random`"):
        env.snapshot()
