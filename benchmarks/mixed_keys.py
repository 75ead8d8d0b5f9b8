"""Steps per second of tasks with keys that mix names with numbers and slices.

dm_control's other domains use such keys: `xmat[1:, ["xx", "xz"]]` in walker, `qpos[:2]` and
`geom_xpos["target", :2]` in reacher. Here two small tasks use them, with the same source for
Limberjack and dm_control, which alternate in blocks of steps.
"""

import collections
import importlib
from typing import Any

import peers
import stepping
from report import Row, at_least

__all__ = ["measure"]

_FASTER = at_least(1.15)  # steps per second over dm_control's

_CHAIN = """
<mujoco>
  <option timestep=".005"><flag contact="disable"/></option>
  <worldbody>
    <geom name="target" pos=".3 .1 0" size=".02"/>
    <body name="upper">
      <joint name="shoulder" axis="0 0 1" damping=".1"/>
      <geom name="upper" type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>
      <body name="lower" pos=".2 0 0">
        <joint name="elbow" axis="0 0 1" damping=".1"/>
        <geom name="lower" type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>
        <geom name="finger" pos=".2 0 0" size=".02"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" gear=".1"/><motor joint="elbow" gear=".1"/></actuator>
</mujoco>
"""


def _tasks(package: str) -> dict[str, Any]:
    """An environment of each task, with a package's own classes."""
    peers.suite(package)
    engine: Any = importlib.import_module(f"{package}.mujoco")
    control: Any = importlib.import_module(f"{package}.rl.control")
    base: Any = importlib.import_module(f"{package}.suite.base")

    class Reading(base.Task):
        """Base class of both tasks."""

        def initialize_episode(self, physics: Any) -> None:
            physics.data.qpos[:] = self.random.uniform(-1, 1, 2)

        def get_reward(self, physics: Any) -> float:
            return float(physics.named.data.xmat["lower", "zz"])

    class Reach(Reading):
        """Reads like reacher."""

        def get_observation(self, physics: Any) -> Any:
            data, obs = physics.named.data, collections.OrderedDict()
            obs["position"] = physics.position()
            obs["to_target"] = data.geom_xpos["target", :2] - data.geom_xpos["finger", :2]
            obs["velocity"] = physics.velocity()
            return obs

    class Walk(Reading):
        """Reads like walker."""

        def get_observation(self, physics: Any) -> Any:
            data, obs = physics.named.data, collections.OrderedDict()
            obs["orientations"] = data.xmat[1:, ["xx", "xz"]].ravel()
            obs["height"] = data.xpos["lower", "z"]
            obs["velocity"] = physics.velocity()
            return obs

    return {
        task.__name__.lower(): control.Environment(
            engine.Physics.from_xml_string(_CHAIN), task(random=0), control_timestep=0.02
        )
        for task in (Reach, Walk)
    }


def measure(num_episodes: int, num_steps: int) -> list[Row]:
    """The row of each task.

    Args:
      num_episodes: episodes of each task.
      num_steps: steps of each episode.
    """
    environments = {package: _tasks(package) for package in peers.installed()}
    rows = []
    for name in environments[peers.OURS]:
        contest = stepping.Contest(
            name, {package: of[name] for package, of in environments.items()}
        )
        for _ in range(num_episodes):
            contest.play(num_steps)
        rows.append(contest.speed_row("steps per second, mixed keys", _FASTER))
    return rows
