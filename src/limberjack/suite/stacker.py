"""Stacker: a planar arm puts a box onto a target, which may be on top of other boxes.

The tasks come from the DeepMind Control Suite (https://arxiv.org/abs/1801.00690).
"""

import collections

import numpy as np

from limberjack.rl import control
from limberjack.suite import _planar_arm, base
from limberjack.suite._planar_arm import CONTROL_TIMESTEP as _CONTROL_TIMESTEP
from limberjack.suite._planar_arm import TIME_LIMIT as _TIME_LIMIT
from limberjack.suite._planar_arm import Physics
from limberjack.suite.base import Kwargs, Seed
from limberjack.utils import arrays, containers, rewards

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Physics",
    "Stack",
    "make_model",
    "stack_2",
    "stack_4",
]

# dm_control's names, which task files import.
_ARM_JOINTS, _CLOSE = _planar_arm._ARM_JOINTS, _planar_arm._CLOSE

_BOXES = 4  # in the model's file
_HAND_AWAY = 0.1  # metres; distance from the target beyond which the hand counts as removed
_HAND_MARGIN = _CLOSE  # metres

SUITE = containers.TaggedTasks()
# Chosen by eye: a start in which boxes and target are visible.
PICTURES = {name: base.Picture("fixed", seed=4, steps=3) for name in ("stack_2", "stack_4")}
OBSERVATIONS = {
    **_planar_arm.OBSERVATIONS,
    "box_pos": base.Observed("planar pose of each box", "m; 1"),
    "box_vel": base.Observed("velocities of each box in turn: x; about y; z", "m/s; rad/s; m/s"),
    "target_pos": base.Observed("x and z of the target's centre", "m"),
}


def make_model(n_boxes: int) -> tuple[bytes, dict[str, bytes]]:
    """The MJCF with the first `n_boxes` of four boxes, and the files that it includes."""
    unused = [f"box{i}" for i in range(n_boxes, _BOXES)]
    return _planar_arm.model_without("stacker.xml", unused)


@SUITE.add("hard")
def stack_2(
    fully_observable: bool = True,
    time_limit: float = _TIME_LIMIT,
    random: Seed = None,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    """Stack two boxes."""
    return _environment(2, fully_observable, time_limit, random, environment_kwargs)


@SUITE.add("hard")
def stack_4(
    fully_observable: bool = True,
    time_limit: float = _TIME_LIMIT,
    random: Seed = None,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    """Stack four boxes."""
    return _environment(4, fully_observable, time_limit, random, environment_kwargs)


def _environment(
    n_boxes: int, fully_observable: bool, time_limit: float, random: Seed, kwargs: Kwargs
) -> control.Environment:
    return control.Environment(
        Physics.from_shared_xml(*make_model(n_boxes)),
        Stack(n_boxes, fully_observable, random),
        time_limit=time_limit,
        control_timestep=_CONTROL_TIMESTEP,
        **kwargs or {},
    )


class Stack(_planar_arm.ArmTask):
    """Put any of the boxes onto the target and remove the hand."""

    GOAL = ("box_is_close", "hand_is_far")
    planner_cost = "limberjack.planner.stacker.stack:Stack"

    def __init__(self, n_boxes: int, fully_observable: bool, random: Seed = None) -> None:
        """Creates the task.

        Args:
          n_boxes: number of boxes; at most `n_boxes - 1` of them belong below the target.
          fully_observable: observe hand, boxes and target in addition to the arm's sensors.
          random: a `numpy.random.RandomState`, a seed, or None.
        """
        self._n_boxes = n_boxes
        self.STARTS = tuple(f"level_{level}" for level in range(n_boxes))
        self._box_names = [f"box{i}" for i in range(n_boxes)]
        self._box_joint_names = [f"{box}_{axis}" for box in self._box_names for axis in "xyz"]
        super().__init__(fully_observable, random)

    @property
    def boxes(self) -> list[str]:
        """Names of the boxes, which are bodies and sites."""
        return list(self._box_names)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws random poses of arm, target and boxes, without contacts, at rest."""
        self.draw_collision_free_start(physics, lambda: self._draw_start(physics))
        super().initialize_episode(physics)

    def _draw_start(self, physics: Physics) -> None:
        uniform = self.random.uniform
        physics.randomize_arm(self.random)
        half_size = physics.named.model.geom_size["target", "x"]
        half_sizes_up = 2 * self.random.randint(self._n_boxes) + 1
        physics.named.model.body_pos["target", "z"] = half_size * half_sizes_up
        physics.named.model.body_pos["target", "x"] = uniform(-0.37, 0.37)
        qpos = physics.named.data.qpos
        for box in self._box_names:
            qpos[f"{box}_x"] = uniform(0.1, 0.3)
            qpos[f"{box}_z"] = uniform(0, 0.7)
            qpos[f"{box}_y"] = uniform(0, 2 * np.pi)

    def start(self, physics: Physics) -> str:
        """The number of boxes that belong below the target: 'level_0', 'level_1', ..."""
        model = physics.named.model
        half_size = model.geom_size["target", "x"]
        level = (model.body_pos["target", "z"] / half_size - 1) / 2
        return f"level_{round(float(level))}"

    def observe_scene(self, physics: Physics) -> collections.OrderedDict:
        """Poses and velocities of the boxes, and the target's position."""
        obs = collections.OrderedDict()
        obs["box_pos"] = physics.body_2d_pose(self._box_names)
        obs["box_vel"] = physics.joint_vel(self._box_joint_names)
        obs["target_pos"] = physics.body_2d_pose("target", orientation=False)
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Closeness of the nearest box to the target, and distance of the hand from it."""
        box_size = 2 * physics.named.model.geom_size["target", "x"]
        to_target = (physics.site_distance(box, "target") for box in self._box_names)
        nearest = arrays.minimum_of(to_target)
        hand = physics.site_distance("grasp", "target")
        return {
            # Relative to the box size, which may be randomised per row.
            "box_is_close": rewards.tolerance(nearest / box_size, margin=1),
            "hand_is_far": rewards.tolerance(hand, (_HAND_AWAY, np.inf), margin=_HAND_MARGIN),
        }
