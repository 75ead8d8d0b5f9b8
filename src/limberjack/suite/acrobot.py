"""Acrobot: swing up two links with a torque on the elbow; from https://arxiv.org/abs/1801.00690.

The model comes from Coulom (2002), https://theses.hal.science/tel-00003985.
"""

import collections

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import base, common
from limberjack.suite.base import Seed
from limberjack.suite.base import StepKwargs as Kwargs
from limberjack.utils import arrays, containers, rewards

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Balance",
    "Physics",
    "get_model_and_assets",
    "swingup",
    "swingup_sparse",
]

_DEFAULT_TIME_LIMIT = 10  # seconds
_MARGIN = 1  # metres from the target's surface at which the smooth reward is 0.1
_LINKS = ["upper_arm", "lower_arm"]

SUITE = containers.TaggedTasks()
PICTURES = dict.fromkeys(("swingup", "swingup_sparse"), base.Picture("lookat", seed=4))
OBSERVATIONS = {
    "orientations": base.Observed(
        "sines of the angles of upper and lower arm from upright, then their cosines"
    ),
    "velocity": base.Observed("angular velocities of shoulder and elbow", "rad/s"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("acrobot.xml"), common.ASSETS


@SUITE.add("benchmarking")
def swingup(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swing up and balance; the reward grows as the tip comes near the target."""
    return _environment(Balance(False, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def swingup_sparse(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swing up and balance; only a tip inside the target is rewarded."""
    return _environment(Balance(True, random), time_limit, environment_kwargs)


def _environment(task: base.Task, time_limit: float, kwargs: Kwargs) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, task, time_limit=time_limit, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the two links."""

    def horizontal(self) -> np.ndarray:
        """Sines of the links' angles from upright, (..., 2)."""
        return self.named.data.xmat[_LINKS, "xz"]

    def vertical(self) -> np.ndarray:
        """Cosines of the links' angles from upright, (..., 2)."""
        return self.named.data.xmat[_LINKS, "zz"]

    def to_target(self) -> arrays.Quantity:
        """Distance from the tip to the target's centre, (...), metres."""
        positions = self.named.data.site_xpos
        return arrays.norm(positions["target"] - positions["tip"])

    def orientations(self) -> np.ndarray:
        """Sines, then cosines of the links' angles from upright, (..., 4)."""
        return arrays.concat((self.horizontal(), self.vertical()))


class Balance(base.Task[Physics]):
    """Keep the tip inside the target, a ball around the highest point that it can reach."""

    GOAL = ("at_target",)
    planner_cost = "limberjack.planner.single_stage.swing_up:Acrobot"

    def __init__(self, sparse: bool, random: Seed = None) -> None:
        """Creates the task; with `sparse`, nothing outside the target is rewarded."""
        self._sparse = sparse
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws any angles, at rest."""
        angles = self.random.uniform(-np.pi, np.pi, 2)
        physics.named.data.qpos[["shoulder", "elbow"]] = angles
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Orientations and angular velocities."""
        return collections.OrderedDict(
            orientations=physics.orientations(), velocity=physics.velocity()
        )

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Closeness of the tip to the target."""
        return {"at_target": self._get_reward(physics, self._sparse)}

    # dm_control's name, which task files call and override.
    def _get_reward(self, physics: Physics, sparse: bool) -> arrays.Quantity:
        inside = (0, physics.named.model.site_size["target", "x"])
        margin = 0 if sparse else _MARGIN
        return rewards.tolerance(physics.to_target(), inside, margin=margin)
