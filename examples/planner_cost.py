"""A planner for a task of your own: a cart swings a pole up and balances it.

    python examples/planner_cost.py --steps 400

`Upright` is all that the planner needs to know of the task; the model and the task above it are an
ordinary domain. With the zero action the pole hangs and the return is 0.
"""

import argparse
from collections import OrderedDict
from typing import Any, ClassVar

import numpy as np

from limberjack import mujoco
from limberjack.planner import Cost, Planner, Settings
from limberjack.rl import control
from limberjack.suite import base
from limberjack.utils import rewards

_XML = """
<mujoco model="cart and pole">
  <option timestep="0.005"/>
  <worldbody>
    <body name="cart" pos="0 0 1">
      <joint name="slide" type="slide" axis="1 0 0" limited="true" range="-1.8 1.8" damping="0.1"/>
      <geom type="box" size="0.1 0.1 0.05" mass="1"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0" damping="0.001"/>
        <geom type="capsule" fromto="0 0 0 0 0 1" size="0.03" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="push" joint="slide" gear="15" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


class SwingUp(base.Task):
    """Hold the pole up; it starts hanging."""

    def initialize_episode(self, physics: Any) -> None:
        """The pole down, a little beside the vertical."""
        physics.named.data.qpos["hinge"] = np.pi + self.random.uniform(-0.1, 0.1)
        super().initialize_episode(physics)

    def get_observation(self, physics: Any) -> OrderedDict:
        """Positions and velocities."""
        return OrderedDict(position=physics.position(), velocity=physics.velocity())

    def reward_terms(self, physics: Any) -> dict[str, Any]:
        """Whether the pole points up, (...)."""
        up = physics.named.data.xmat["pole", "zz"]
        return {"up": rewards.tolerance(up, (0.98, 1.0), margin=0.3)}

    def reward_of(self, terms: dict[str, Any]) -> Any:
        """The only term."""
        return terms["up"]


class Upright(Cost):
    """Cost of a low pole, of a fast one that is up, and of a cart far from the middle.

    Each line works for one simulation and for a batch: quantities have the shape (N,).
    """

    settings = Settings(horizon=1.0, knots=6, samples=64, gain=3.0, damping=0.5, noise=1.0)

    weights: ClassVar = {"low pole": 1.0, "swing": 0.02, "cart off the middle": 0.1}

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        """In all about 2 for a hanging pole, 0 for one that stands still in the middle."""
        data = physics.named.data
        low = 1.0 - data.xmat["pole", "zz"]
        return {
            "low pole": low,
            "swing": np.exp(-5.0 * low) * data.qvel["hinge"][..., 0] ** 2,
            "cart off the middle": data.qpos["slide"][..., 0] ** 2,
        }


def main() -> None:
    """Plays one episode."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=400, help="of 0.02 s")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    env = control.Environment(
        mujoco.Physics.from_xml_string(_XML),
        SwingUp(random=given.seed),
        time_limit=given.steps * 0.02,
        control_timestep=0.02,
    )
    planner = Planner(env, seed=given.seed, cost=Upright(env.task))
    time_step = env.reset()
    rewards_seen = []
    while not time_step.last():
        time_step = env.step(planner.act())
        rewards_seen.append(time_step.reward)
    print(f"return {sum(rewards_seen):.1f} of {len(rewards_seen)}, at last {rewards_seen[-1]:.2f}")


if __name__ == "__main__":
    main()
