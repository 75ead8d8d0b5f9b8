"""Cart-pole: push a cart along a rail to balance a pole, or several in a chain, or swing them up.

The tasks come from the DeepMind Control Suite (https://arxiv.org/abs/1801.00690).
"""

import collections
from collections.abc import Mapping
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import _chain, _parameters, base, common
from limberjack.suite import _locomotion as locomotion
from limberjack.suite.base import Seed
from limberjack.suite.base import StepKwargs as Kwargs
from limberjack.utils import arrays, containers, rewards, xml_tools
from limberjack.worlds.faults import Parameter, Range

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Balance",
    "Physics",
    "balance",
    "balance_sparse",
    "get_model_and_assets",
    "swingup",
    "swingup_sparse",
    "three_poles",
    "two_poles",
]

_DEFAULT_TIME_LIMIT = 10  # seconds
_FAST = 5  # rad/s; at this velocity of a pole its term is a tenth
_FAR = 2  # metres; at this distance of the cart from the centre its term is a tenth

SUITE = containers.TaggedTasks()
# Chosen by eye: poles that lean, and poles that hang.
PICTURES = {
    **dict.fromkeys(("balance", "balance_sparse"), base.Picture("fixed", seed=2, steps=60)),
    **dict.fromkeys(("swingup", "swingup_sparse"), base.Picture("fixed", seed=1, steps=60)),
    **dict.fromkeys(("two_poles", "three_poles"), base.Picture("fixed", seed=0, steps=100)),
}
OBSERVATIONS = {
    "position": base.Observed(
        "cart's position on the rail; cosine and sine of each pole's angle from upright", "m; 1"
    ),
    "velocity": base.Observed("velocities of the cart and of the hinges", "m/s; rad/s"),
}


def get_model_and_assets(num_poles: int = 1) -> tuple[bytes, dict[str, bytes]]:
    """The MJCF of a cart with a chain of poles, and the files that it includes.

    Raises:
      ValueError: `num_poles` is not a whole number in range.
    """
    return _make_model(num_poles), common.ASSETS


def _make_model(n_poles: int) -> bytes:
    n_poles = _chain.checked_length("num_poles", n_poles)
    root = _chain.with_templates(common.read_model("cartpole.xml"))
    first = xml_tools.find_element(root, "body", "pole_1")
    _chain.repeat(first, range(2, n_poles + 1))
    if n_poles > 1:  # the floor is out of reach, and the cameras see all poles
        for tag, name, pos in (
            ("geom", "floor", f"0 0 {1 - n_poles - 0.05}"),
            ("camera", "fixed", f"0 {-1 - 2 * n_poles} 1"),
            ("camera", "lookatcart", f"0 {-2 * n_poles} 2"),
        ):
            xml_tools.find_element(root, tag, name).set("pos", pos)
    return ElementTree.tostring(root)


@SUITE.add("benchmarking")
def balance(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Keep an upright pole upright."""
    return _environment(Balance(False, False, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def balance_sparse(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Keep an upright pole upright, rewarded only within narrow bounds."""
    return _environment(Balance(False, True, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def swingup(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swing a hanging pole up and balance it."""
    return _environment(Balance(True, False, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def swingup_sparse(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swing a hanging pole up and balance it, rewarded only within narrow bounds."""
    return _environment(Balance(True, True, random), time_limit, environment_kwargs)


@SUITE.add()
def two_poles(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swing up two poles, one on the end of the other."""
    return _environment(Balance(True, False, random), time_limit, environment_kwargs, num_poles=2)


@SUITE.add()
def three_poles(
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: Seed = None,
    num_poles: int = 3,
    sparse: bool = False,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    """Swing up a chain of three poles, or of `num_poles`."""
    return _environment(Balance(True, sparse, random), time_limit, environment_kwargs, num_poles)


def _environment(
    task: base.Task, time_limit: float, kwargs: Kwargs, num_poles: int = 1
) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets(num_poles))
    return control.Environment(physics, task, time_limit=time_limit, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the cart and its poles."""

    def cart_position(self) -> arrays.Quantity:
        """Position of the cart on the rail, (...), metres from the centre."""
        return self.named.data.qpos["slider"][..., 0][()]  # a number for one simulation

    def angular_vel(self) -> np.ndarray:
        """Angular velocities of the hinges, (..., poles), rad/s."""
        return self.data.qvel[..., 1:].copy()

    def pole_angle_cosine(self) -> np.ndarray:
        """Cosine of each pole's angle from upright, (..., poles)."""
        return self.named.data.xmat[2:, "zz"]

    def bounded_position(self) -> np.ndarray:
        """The cart's position, then cosine and sine of each pole's angle, (..., 1 + 2 poles)."""
        angles = self.named.data.xmat[2:, ["zz", "xz"]]
        cart = self.named.data.qpos["slider"]
        return arrays.concat((cart, angles.reshape(*cart.shape[:-1], -1)))


def _set_pole_length(root: ElementTree.Element, length: float) -> None:
    """Sets the length of each pole, metres, and its mass to a tenth of that, kilograms."""
    geom = _parameters.default_of(root, "pole", "geom")
    _parameters.set_numbers(geom, "fromto", 0, 0, 0, 0, 0, length)
    _parameters.set_numbers(geom, "mass", length / 10)
    for body in root.iter("body"):
        if body.get("name", "").startswith("pole_") and body.get("name") != "pole_1":
            _parameters.set_numbers(body, "pos", 0, 0, length)


def _set_pole_mass(root: ElementTree.Element, mass: float) -> None:
    _parameters.set_numbers(_parameters.default_of(root, "pole", "geom"), "mass", mass)


def _set_joint_damping(root: ElementTree.Element, damping: float) -> None:
    _parameters.set_numbers(_parameters.default_of(root, "pole", "joint"), "damping", damping)


def _set_slider_damping(root: ElementTree.Element, damping: float) -> None:
    _parameters.set_numbers(xml_tools.find_element(root, "joint", "slider"), "damping", damping)


class Balance(base.Task[Physics]):
    """Hold the poles upright above a cart at the centre of the rail."""

    PERTURBATIONS: ClassVar[Mapping[str, Parameter]] = {
        "pole_length": Parameter(
            _set_pole_length,
            1.0,
            Range(0.3, 3.0, 0.3),
            _parameters.challenges(
                Range(0.9, 1.1, 0.02), Range(0.7, 1.7, 0.1), Range(0.5, 2.3, 0.15)
            ),
        ),
        "pole_mass": Parameter(_set_pole_mass, 0.1, Range(0.1, 10.0, 0.5)),
        "joint_damping": Parameter(_set_joint_damping, 2e-6, Range(2e-6, 2e-1, 2e-2)),
        "slider_damping": Parameter(_set_slider_damping, 5e-4, Range(5e-4, 3.0, 0.3)),
    }
    planner_cost = "limberjack.planner.single_stage.swing_up:Cartpole"

    _CART_RANGE = (-0.25, 0.25)  # metres
    _ANGLE_COSINE_RANGE = (0.995, 1)  # up to 5.7 degrees from upright

    def __init__(self, swing_up: bool, sparse: bool, random: Seed = None) -> None:
        """Creates the task.

        Args:
          swing_up: begin with a hanging chain above the centre; otherwise with upright poles.
          sparse: reward 1 within narrow bounds of the goal and 0 elsewhere.
          random: a `numpy.random.RandomState`, a seed, or None.
        """
        self._sparse = sparse
        self._swing_up = swing_up
        self.GOAL = ("balanced",) if sparse else ("upright", "centered")
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Hanging or upright poles, with small random angles and velocities."""
        random, qpos, nv = self.random, physics.data.qpos, physics.model.nv
        if self._swing_up:
            qpos[0] = 0.01 * random.randn()
            qpos[1] = np.pi + 0.01 * random.randn()
            qpos[2:] = 0.1 * random.randn(nv - 2)
        else:
            qpos[0] = random.uniform(-0.1, 0.1)
            qpos[1:] = random.uniform(-0.034, 0.034, nv - 1)
        physics.data.qvel[:] = 0.01 * random.randn(nv)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Position of the cart, directions of the poles, and velocities."""
        position, velocity = physics.bounded_position(), physics.velocity()
        return collections.OrderedDict(position=position, velocity=velocity)

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Uprightness, central position, low effort and low velocity; or `balanced` if sparse."""
        return self._terms(physics, self._sparse)

    def _terms(self, physics: Physics, sparse: bool) -> dict[str, arrays.Quantity]:
        cosine, position = physics.pole_angle_cosine(), physics.cart_position()
        if sparse:
            is_upright = rewards.tolerance(cosine, self._ANGLE_COSINE_RANGE).prod(axis=-1)
            return {"balanced": rewards.tolerance(position, self._CART_RANGE) * is_upright}
        slowness = rewards.tolerance(physics.angular_vel(), margin=_FAST).min(axis=-1)
        return {
            "upright": arrays.mean((cosine + 1) / 2),
            "small_control": locomotion.low_effort(physics.control()),
            "small_velocity": (1 + slowness) / 2,
            "centered": (1 + rewards.tolerance(position, margin=_FAR)) / 2,
        }

    # dm_control's name, which task files call and override.
    def _get_reward(self, physics: Physics, sparse: bool) -> arrays.Quantity:
        return self.reward_of(self._terms(physics, sparse))

    def __init_subclass__(cls) -> None:
        """Makes `_get_reward` the reward of a subclass that overrides it, as in dm_control."""
        super().__init_subclass__()
        if cls._get_reward is not Balance._get_reward and cls.get_reward is Balance.get_reward:
            cls.get_reward = lambda self, physics: self._get_reward(physics, sparse=self._sparse)
