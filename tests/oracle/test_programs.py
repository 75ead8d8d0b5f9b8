"""A program with its own model, Physics and Task runs the same with either package."""

import collections
import itertools
from typing import Any

import numpy as np
import pytest

from . import models, twins
from .oracle import BOTH
from .same import assert_same_pair

pytestmark = pytest.mark.oracle


def _swing_up(package: Any, **environment_kwargs: Any) -> Any:
    """A user's domain, written against dm_control's interfaces: a pendulum to be swung up."""
    mujoco = package("mujoco")
    base, control = package("suite.base"), package("rl.control")
    randomizers, rewards = package("suite.utils.randomizers"), package("utils.rewards")

    class Physics(mujoco.Physics):
        def angle(self) -> np.ndarray:
            return self.named.data.xmat["pole", ["zz", "xz"]]

        def speed(self) -> np.ndarray:
            return self.named.data.sensordata["speed"].copy()

    class SwingUp(base.Task):
        def initialize_episode(self, physics: Any) -> None:
            randomizers.randomize_limited_and_rotational_joints(physics, self.random)
            physics.named.model.dof_damping["hinge"] = self.random.uniform(0, 1)
            physics.named.data.qvel["hinge"] = self.random.randn()
            super().initialize_episode(physics)

        def get_observation(self, physics: Any) -> dict[str, Any]:
            observation = collections.OrderedDict()
            observation["angle"] = physics.angle()
            observation["speed"] = physics.speed()
            observation["time"] = np.float64(physics.time())
            return observation

        def get_reward(self, physics: Any) -> Any:
            upright = rewards.tolerance(-physics.angle()[0], (0.9, 1), 0.5)
            return upright * (4 + rewards.tolerance(physics.control(), margin=1).mean()) / 5

        def get_termination(self, physics: Any) -> float | None:
            return 0.0 if abs(physics.speed()[0]) > 6 else None

    task = SwingUp(random=3)
    task.visualize_reward = True
    physics = Physics.from_xml_string(models.PENDULUM)
    return control.Environment(physics, task, **environment_kwargs)


@pytest.mark.parametrize(
    "kwargs",
    [
        {},
        {"control_timestep": 0.02},
        {"n_sub_steps": 3, "time_limit": 2.0},
        {"control_timestep": 0.01, "time_limit": 1, "flat_observation": True},
        {"legacy_step": False, "n_sub_steps": 2},
    ],
)
def test_a_user_domain_runs_the_same(kwargs: dict[str, Any]) -> None:
    env = twins.Twins(*(_swing_up(package, **kwargs) for package in BOTH), where=f"{kwargs}")
    endings = set()
    for episode in range(3):
        env.reset()
        env.play(itertools.islice(env.actions("bang-bang", episode), 400))
        env.assert_same_physics("model.mat_rgba", "model.dof_damping", "data.qpos")
        endings.add(env.step_count)
    assert endings != {400}, "no episode ended of itself"


def test_a_task_that_defines_specs_provides_them() -> None:
    twin = [_swing_up(package) for package in BOTH]
    for env in twin:
        env.task.observation_spec = lambda physics: {"mine": 1}
        env.task.action_spec = lambda physics: "mine"
        env.task.step_spec = lambda physics: "a step"
    for query in ("observation_spec", "action_spec", "step_spec", "control_timestep"):
        assert_same_pair((getattr(env, query)() for env in twin), query)


def test_flattening_is_the_same_for_each_kind_of_mapping() -> None:
    parts = {"b": np.arange(3.0), "a": np.float64(7), "c": np.ones((2, 2))[:, ::-1]}
    for kind in (dict, collections.OrderedDict):
        flat = [package("rl.control").flatten_observation(kind(parts)) for package in BOTH]
        assert_same_pair(flat, kind.__name__)
    named = [package("rl.control").flatten_observation(dict(parts), "out") for package in BOTH]
    assert_same_pair(named, "another key")
    for package in BOTH:
        with pytest.raises(ValueError, match="flatten"):
            package("rl.control").flatten_observation([1, 2])
