"""Humanoid of CMU's motion capture data: stand up, walk or run, with 56 torques.

The tasks of `limberjack.suite.humanoid` are given another body, from the DeepMind Control
Suite (https://arxiv.org/abs/1801.00690). Its thorax, where the torso is, has y up and z ahead.
"""

from collections.abc import Mapping
from typing import ClassVar

from limberjack.rl import control
from limberjack.suite import base, common, humanoid
from limberjack.suite.base import Kwargs, Seed
from limberjack.suite.humanoid import _RUN_SPEED, _STAND_HEIGHT, _WALK_SPEED  # noqa: F401
from limberjack.utils import containers
from limberjack.utils.arrays import Quantity
from limberjack.worlds.faults import Parameter

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "HumanoidCMU",
    "Physics",
    "get_model_and_assets",
    "run",
    "stand",
    "walk",
]

_DEFAULT_TIME_LIMIT = 20  # seconds
_CONTROL_TIMESTEP = 0.02  # seconds

SUITE = containers.TaggedTasks()
_SEEDS = {"stand": 8, "walk": 2, "run": 1}  # chosen by eye: the whole body is visible
PICTURES = {task: base.Picture("side", seed, steps=4) for task, seed in _SEEDS.items()}
OBSERVATIONS = {
    **{key: humanoid.OBSERVATIONS[key] for key in ("joint_angles", "extremities", "velocity")},
    "head_height": base.Observed("height of the joint between neck and head", "m"),
    "torso_vertical": base.Observed("the vertical in the thorax's frame; y is 1 if upright"),
    "com_velocity": base.Observed("velocity of the upper body's centre of mass", "m/s"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("humanoid_CMU.xml"), common.ASSETS


@SUITE.add()
def stand(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Stand up and stand still."""
    return _environment(HumanoidCMU(0, random), time_limit, environment_kwargs)


@SUITE.add()
def walk(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Walk in any direction at 1 m/s or more."""
    return _environment(HumanoidCMU(_WALK_SPEED, random), time_limit, environment_kwargs)


@SUITE.add()
def run(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Run in any direction, up to 10 m/s."""
    return _environment(HumanoidCMU(_RUN_SPEED, random), time_limit, environment_kwargs)


def _environment(task: base.Task, time_limit: float, kwargs: Kwargs) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs or {})


class Physics(humanoid.Physics):
    """Measurements of the humanoid, with the thorax as its torso."""

    _TORSO = "thorax"
    _UP, _FRONT = "zy", "zz"
    _LIMBS: ClassVar = ["lhand", "lfoot", "rhand", "rfoot"]

    def thorax_upright(self) -> Quantity:
        """Cosine of the thorax's tilt, (...): 1 upright, -1 head down."""
        return super().torso_upright()

    def torso_upright(self) -> Quantity:
        """As `thorax_upright`, which a subclass may override."""
        return self.thorax_upright()


class HumanoidCMU(humanoid.Humanoid):
    """Stand, or move at least at a given speed."""

    PERTURBATIONS: ClassVar[
        Mapping[str, Parameter]
    ] = {}  # the Real World RL suite has none of this model
    planner_cost = "limberjack.planner.single_stage.standing:HumanoidCMU"

    def __init__(self, move_speed: float, random: Seed = None) -> None:
        """Creates the task; `move_speed` and `random` are those of `humanoid.Humanoid`."""
        super().__init__(move_speed, pure_state=False, random=random)
