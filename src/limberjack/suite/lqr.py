"""LQR: bring a row of balls on springs to rest, with a quadratic cost of positions and forces.

The system is linear, so `limberjack.suite.lqr_solver` computes the optimal policy. The stiffness of
the springs is drawn from the random stream once, before its first episode. Episodes have no time
limit; they end when everything is at rest. The tasks come from the DeepMind Control Suite
(https://arxiv.org/abs/1801.00690).
"""

import collections
import numbers
from xml.etree import ElementTree

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.rl.streams import set_stream_fields
from limberjack.suite import _chain, base, common
from limberjack.suite.base import Seed
from limberjack.suite.base import StepKwargs as Kwargs
from limberjack.utils import arrays, containers

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "LQRLevel",
    "Physics",
    "get_model_and_assets",
    "lqr_2_1",
    "lqr_6_2",
]

_DEFAULT_TIME_LIMIT = float("inf")  # seconds
_CONTROL_COST_COEF = 0.1
_STIFFNESS = (15, 25)  # N/m; the springs are drawn uniformly from this range
_DAMPING = (0, 0)  # N s/m; a number is drawn for each joint nonetheless, as in dm_control
_REACHED = 0.01  # norm of the state at which an episode counts as solved

SUITE = containers.TaggedTasks()
# Chosen by eye: all balls are visible.
PICTURES = {
    "lqr_2_1": base.Picture("cam0", seed=12, steps=9),
    "lqr_6_2": base.Picture("cam0", seed=2),
}
OBSERVATIONS = {
    "position": base.Observed("displacement of each ball from the one before", "m"),
    "velocity": base.Observed("the same for velocities", "m/s"),
}


def get_model_and_assets(
    n_bodies: int, n_actuators: int, random: np.random.RandomState
) -> tuple[bytes, dict[str, bytes]]:
    """The MJCF of a chain with random springs, and the files that it includes.

    Args:
      n_bodies: number of balls.
      n_actuators: number of balls that are pushed, from the first on.
      random: the stream from which the stiffness of each spring is drawn.

    Raises:
      ValueError: a number is out of range, or there are more actuators than balls.
      TypeError: a number is not whole.
    """
    root = _chain_of(n_bodies, n_actuators)
    joints = root.iterfind("worldbody//joint")
    for joint, stiffness in zip(joints, _draw(random, n_bodies), strict=True):
        joint.set("stiffness", str(stiffness))
    return ElementTree.tostring(root), common.ASSETS


def _chain_of(n_bodies: int, n_actuators: int) -> ElementTree.Element:
    """The MJCF of the chain, with springs of no stiffness."""
    n_bodies = _chain.checked_length("n_bodies", n_bodies, wrong_kind=TypeError)
    n_actuators = _chain.checked_length("n_actuators", n_actuators, wrong_kind=TypeError)
    if n_actuators > n_bodies:
        raise ValueError(
            f"n_actuators is {n_actuators}; expected at most n_bodies, {n_bodies}: one for each"
        )
    root = _chain.with_templates(common.read_model("lqr.xml"))
    counts = {"worldbody": n_bodies, "actuator": n_actuators, "tendon": n_bodies - 1}
    for section, count in counts.items():
        (parent,) = root.iterfind(section)
        _chain.repeat(parent, range(count))
    (first,) = root.iterfind("worldbody/body")
    first.set("pos", ".25 0 .1")  # the others are at its height
    return root


def _draw(random: np.random.RandomState, joints: int) -> list[float]:
    """The stiffness of each joint, N/m; a damping is drawn after each and is always 0."""
    low, high = np.transpose((_STIFFNESS, _DAMPING))
    return random.uniform(low, high, (joints, 2))[:, 0].tolist()


@SUITE.add()
def lqr_2_1(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Bring two balls to rest by pushing the first."""
    return _make_lqr(2, 1, _CONTROL_COST_COEF, time_limit, random, environment_kwargs)


@SUITE.add()
def lqr_6_2(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Bring six balls to rest by pushing the first two."""
    return _make_lqr(6, 2, _CONTROL_COST_COEF, time_limit, random, environment_kwargs)


# dm_control's name and arguments, for chains of another length.
def _make_lqr(
    n_bodies: int,
    n_actuators: int,
    control_cost_coef: float,
    time_limit: float,
    random: Seed,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    xml = ElementTree.tostring(_chain_of(n_bodies, n_actuators))
    physics = Physics.from_shared_xml(xml, common.ASSETS)
    task = LQRLevel(control_cost_coef, random, drawn_springs=n_bodies)
    set_stream_fields(task, task.random, physics.simulation)
    return control.Environment(physics, task, time_limit, **environment_kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the chain."""

    def state_norm(self) -> arrays.Quantity:
        """Euclidean norm of all positions and velocities together, (...)."""
        return arrays.norm(self.state())


class LQRLevel(base.Task[Physics]):
    """Bring everything to rest at a small cost of forces."""

    planner_cost = "limberjack.planner.single_stage.travelling:Regulator"
    EPISODE_FIELDS = ("jnt_stiffness",)

    _TERMINAL_TOL = 1e-6  # norm of the state below which the episode ends

    def __init__(
        self, control_cost_coef: float, random: Seed = None, drawn_springs: int = 0
    ) -> None:
        """Creates the task.

        Args:
          control_cost_coef: cost of a squared unit of control, relative to that of position.
          random: a `numpy.random.RandomState`, a seed, or None.
          drawn_springs: number of springs whose stiffness is drawn from each stream before its
            first episode; 0 keeps the stiffness of the model.

        Raises:
          ValueError, TypeError: the coefficient is not a positive number.
        """
        if not isinstance(control_cost_coef, numbers.Real) or not control_cost_coef > 0:
            kind = ValueError if isinstance(control_cost_coef, numbers.Real) else TypeError
            raise kind(f"control_cost_coef is {control_cost_coef!r}; expected a positive number")
        self._control_cost_coef = control_cost_coef
        self._drawn_springs = drawn_springs
        super().__init__(random=random)

    @property
    def control_cost_coef(self) -> float:
        """Cost of a squared unit of control, relative to that of position."""
        return self._control_cost_coef

    def begin_stream(self, random: np.random.RandomState) -> dict[str, np.ndarray]:
        """The stiffness of the springs, if it is drawn."""
        if not self._drawn_springs:
            return {}
        return {"jnt_stiffness": np.array(_draw(random, self._drawn_springs))}

    def initialize_episode(self, physics: Physics) -> None:
        """Positions of norm sqrt(2) in a random direction, at rest."""
        unit = self.random.randn(physics.model.nq)
        physics.data.qpos[:] = np.sqrt(2) * unit / np.linalg.norm(unit)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """The whole state."""
        return collections.OrderedDict(position=physics.position(), velocity=physics.velocity())

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Costs of positions and of controls, each half a weighted sum of squares; unbounded."""
        state_cost = 0.5 * arrays.squared_norm(physics.position())
        control_cost = 0.5 * arrays.squared_norm(physics.control())
        return {"state_cost": state_cost, "control_cost": control_cost * self._control_cost_coef}

    def reward_of(self, terms: dict[str, arrays.Quantity]) -> arrays.Quantity:
        """1 minus both costs; at most 1."""
        return 1 - (terms["state_cost"] + terms["control_cost"])

    def get_evaluation(self, physics: Physics) -> arrays.Quantity:
        """1 with the state near zero and 0 elsewhere, (...); not used for learning."""
        reached = np.where(physics.state_norm() <= _REACHED, 1.0, 0.0)
        return float(reached) if physics.num_envs is None else reached

    def get_termination(self, physics: Physics) -> arrays.Quantity | None:
        """Discount 0 where everything is at rest."""
        is_over = physics.state_norm() < self._TERMINAL_TOL
        if physics.num_envs is None:
            return 0.0 if is_over else None
        return np.where(is_over, 0.0, np.nan)
