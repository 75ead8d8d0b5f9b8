"""`Cost`: the quantity that plans minimise, computed for a batch of states.

    class Still(Cost):
        settings = Settings(horizon=0.4, gain=1.5)

        def step_cost(self, physics):
            return np.abs(physics.velocity()).mean(axis=-1)

    planner = Planner(env, cost=Still(env.task))

`step_cost` receives a batch of the environment's own `Physics`, so all measurements of the domain
and the task, including `task.get_reward(physics)`, are available with the states as leading axis.
It receives all states of all plans at once, because NumPy takes hardly longer for many.
"""

import dataclasses
from typing import Any

import numpy as np

__all__ = ["Cost", "Settings"]


@dataclasses.dataclass(frozen=True)
class Settings:
    """Settings of the planner for a task; times in seconds.

    Attributes:
      samples: number of plans per planning step, including the current one.
      horizon: duration of a plan.
      knots: number of knots of a plan's spline, equally spaced from now to the horizon; if
        anchored, the last one lies beyond it.
      anchored: whether knots keep their times between planning steps. Otherwise the spline is
        resampled at each planning step, which smooths it: suitable for slow motion, not for gaits.
      interval: control steps between planning steps.
      timestep: time step of the planning model; None for the environment's. It must divide the
        control step; a longer one is faster and less accurate.
      armature: armature added to each hinge of the actuated bodies in the planning model, kg m2.
        Light fingers pressed against an object otherwise oscillate at a long time step, and the
        object slips, in the planning model only.
      gain: control per radian between a joint and its target.
      damping: control per radian per second of a joint's velocity.
      tendons: whether motors on fixed tendons also follow an angle: the mean of the joints,
        weighted as in the tendon's length. These joints must have equal limits.
      noise: largest standard deviation of sampled targets: radians for joints, fractions of half
        the range for directly controlled actuators.
      finest: smallest standard deviation of sampled targets, as a fraction of `noise`.
      temperature: scale of the cost differences at which samples lose weight, as a fraction of the
        difference between the best sample and the worst of the best eighth.
      flowing: whether proposals begin at the targets of the current plan. A moving joint lags
        behind its target, so a target at its current position would stop it abruptly.
      proposal_interval: planning steps between calls of `proposals`, unless the cost's stage
        changes. In between, the last proposals are used again, shifted in time. Not for anchored
        plans.
      cost_interval: control steps between evaluations of a plan's cost. With short steps, every
        second one is enough and halves the time spent outside MuJoCo.
      servos: whether servos in the planning model follow the targets at each time step, instead of
        the control law at each control step. A rollout is then one call without Python in between
        and without synchronisation of threads: on four threads it takes a quarter less.
      rest: whether bodies at rest are left out of the planning model's physics until touched, like
        MuJoCo's sleeping islands: with four boxes this saves a fifth of a plan's time.
    """

    samples: int = 64
    horizon: float = 0.5
    knots: int = 5
    anchored: bool = False
    interval: int = 1
    timestep: float | None = None
    armature: float = 0.0
    gain: float = 1.5
    damping: float = 0.0
    tendons: bool = False
    noise: float = 0.5
    finest: float = 0.03
    temperature: float = 0.3
    flowing: bool = False
    proposal_interval: int = 1
    cost_interval: int = 1
    servos: bool = False
    rest: bool = False

    def __post_init__(self) -> None:
        fewest = 3 if self.anchored else 2
        at_least = {"samples": 2, "knots": fewest}
        at_least |= dict.fromkeys(("interval", "proposal_interval", "cost_interval"), 1)
        for name, least in at_least.items():
            value = getattr(self, name)
            if not isinstance(value, int) or value < least:
                raise ValueError(f"{name} is {value!r}; expected a whole number from {least} up")
        numbers = ["horizon", "gain", "noise", "finest", "temperature"]
        for name in numbers if self.timestep is None else [*numbers, "timestep"]:
            value = getattr(self, name)
            if not (_is_number(value) and value > 0):
                raise ValueError(f"{name} is {value!r}; expected a positive number")
        for name in ("damping", "armature"):
            value = getattr(self, name)
            if not (_is_number(value) and value >= 0):
                raise ValueError(f"{name} is {value!r}; expected a number from 0 up")
        if self.anchored and self.proposal_interval > 1:
            raise ValueError(
                f"proposal_interval is {self.proposal_interval}; expected 1, as plans are anchored"
            )
        if self.finest > 1:
            raise ValueError(
                f"finest is {self.finest!r}; expected a fraction of `noise`, at most 1"
            )

    @property
    def spacing(self) -> float:
        """Time between knots, seconds."""
        return self.horizon / (self.knots - (2 if self.anchored else 1))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and bool(np.isfinite(value))


class Cost:
    """The quantity that plans minimise; see the module's docstring.

    A subclass must define `step_cost`. The other methods are for tasks with stages or with known
    good plans.
    """

    settings = Settings()
    breadth = 1.0  # noise scale, as a fraction of the settings' noise; `look` may set it
    place = 0.0  # phase of the current time in the plan, in knots; the planner sets it if anchored

    def __init__(self, task: Any) -> None:
        """Stores the environment's task, whose reward terms the cost may use."""
        self.task = task

    def reset(self) -> None:
        """Called at the start of each episode, to reset stages."""

    def look(self, physics: Any) -> None:
        """Called before each planning step, to update the stage.

        Args:
          physics: a single simulation in the environment's current state. It belongs to the
            planner, so it may be read, modified and stepped.
        """

    def step_cost(self, physics: Any) -> np.ndarray:
        """The cost of each state, (N,); a plan's cost is the mean over its control steps.

        It may be called more than once for the same states.

        Args:
          physics: N states from rollouts of plans, as a batch of simulations. Read-only; the cost
            of a state must not depend on the other states.
        """
        raise NotImplementedError(
            f"{type(self).__name__} does not define step_cost(physics), which returns the cost of "
            "each state of a batch, shape (N,)"
        )

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray | None:
        """Plans to try in addition to variations of the current one, (n, knots, nu), or None.

        Args:
          physics: as for `look`.
          random: the planner's stream.

        Returns:
          Targets of the actuators at the knots: an angle in radians for an actuator on a joint, the
          control for others. They fill at most half of the samples; surplus ones are ignored.
        """
        return None

    def stage(self) -> Any:
        """The stage on which proposals depend in addition to the state; compared by `==`.

        While the stage stays the same, proposals may be reused; see `Settings.proposal_interval`.
        """
        return None

    def continued(self, plan: np.ndarray) -> np.ndarray:
        """The targets of the knot after a plan's last one, (nu,); by default those of the last one.

        Called when the time of a plan's first anchored knot has passed.

        Args:
          plan: the current plan, (knots, nu).
        """
        return plan[-1]

    def followed(self, targets: np.ndarray) -> None:
        """Called at each control step with the current targets, (nu,)."""
