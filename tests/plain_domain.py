"""A domain whose task implements only `rl.control.Task`: no starts, no goal, no reward terms.

Its rewards also lie outside 0 to 1, its observations are views of the simulation, and it has fewer
action elements than actuators.
"""

import collections
from typing import Any

import numpy as np
from dm_env import specs

from limberjack import mujoco, suite
from limberjack.rl import control
from limberjack.utils.containers import TaggedTasks

__all__ = ["SUITE", "Push", "endless", "make", "push", "ticking"]

_MODEL = """
<mujoco>
  <option timestep="0.01"/>
  <visual><global offwidth="640" offheight="480"/></visual>
  <worldbody>
    <light pos="0 0 3"/>
    <camera name="side" pos="0 -3 1" xyaxes="1 0 0 0 0.3 1"/>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom size="0.1"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="left" joint="slide" gear="-1"/>
    <motor name="right" joint="slide" gear="1"/>
  </actuator>
</mujoco>
"""

SUITE = TaggedTasks()


class Push(control.Task):
    """Rewards the position of the cart, which may be negative. One action drives two motors."""

    def __init__(self, random: Any = None) -> None:
        self._random = np.random.RandomState(random)

    @property
    def random(self) -> np.random.RandomState:
        return self._random

    def action_spec(self, physics: Any) -> Any:
        return specs.BoundedArray((1,), float, -2.0, 2.0)

    def initialize_episode(self, physics: Any) -> None:
        physics.data.qpos[:] = self._random.uniform(-1, 1)

    def before_step(self, action: Any, physics: Any) -> None:
        action = np.asarray(action)
        physics.set_control(np.concatenate([-action, action], axis=-1) / 2)

    def get_observation(self, physics: Any) -> Any:
        return collections.OrderedDict(
            place=physics.data.qpos, speed=physics.data.qvel, fast=abs(physics.data.qvel) > 0.5
        )

    def get_reward(self, physics: Any) -> Any:
        return 3 * physics.data.qpos[..., 0]

    def get_termination(self, physics: Any) -> Any:
        return None if physics.num_envs is None else np.full(physics.num_envs, np.nan)


@SUITE.add("custom")
def push(
    time_limit: float = 0.5, random: Any = None, environment_kwargs: Any = None
) -> control.Environment:
    physics = mujoco.Physics.from_xml_string(_MODEL)
    kwargs = environment_kwargs or {}
    return control.Environment(
        physics, Push(random), time_limit=time_limit, control_timestep=0.02, **kwargs
    )


@SUITE.add("custom")
def drift(
    time_limit: float = float("inf"), random: Any = None, environment_kwargs: Any = None
) -> control.Environment:
    return push(time_limit, random, environment_kwargs)


def make(seed: int) -> control.Environment:
    return push(random=seed)


def endless(seed: int) -> control.Environment:
    return push(float("inf"), seed)


def ticking(seed: int) -> control.Environment:
    """An environment that differs from others by more than its random stream."""
    environment = push(random=seed)
    environment.physics.model.opt.gravity[2] = -seed
    return environment


def heavier(seed: int) -> control.Environment:
    """An environment of the suite under another name."""
    environment = suite.load("humanoid", "stand", {"random": seed, "time_limit": 0.5})
    environment.physics.model.body_mass[1] *= 2
    return environment
