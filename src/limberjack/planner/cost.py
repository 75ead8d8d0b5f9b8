"""`Cost`: what a plan should avoid, written on arrays with one value per state.

    class Still(Cost):
        settings = Settings(horizon=0.4, gain=1.5)

        def step_cost(self, physics):
            return np.abs(physics.velocity()).mean(axis=-1)

    planner = Planner(env, cost=Still(env.task))

`step_cost` sees a batch of the environment's own `Physics`, so everything that the domain and the
task measure is there, with the states as leading axis: `task.get_reward(physics)` too. It sees all
states of all plans at once, because NumPy takes hardly longer for many.
"""

import dataclasses
from typing import Any

import numpy as np

__all__ = ["Cost", "Settings"]


@dataclasses.dataclass(frozen=True)
class Settings:
    """How a task is planned for; times in seconds.

    Attributes:
      samples: plans that are simulated each time, the present one included.
      horizon: how far a plan reaches.
      knots: points of a plan's spline, at equal distances from now to the horizon; if they are
        anchored, the last of them lies beyond it.
      anchored: whether knots keep their moments from one planning to the next. Otherwise a plan is
        cut anew from its spline at each planning, which takes its edges off: good where what is
        done is slow, not for a stride.
      interval: control steps from one planning to the next.
      timestep: time step of the physics in the plan; None for the environment's. It must divide
        the control step; a longer one is quicker and less exact.
      armature: kg m2 that each hinge of the actuated bodies gains in the plan. Light fingers that
        press on something shake at a long time step, and what they hold slips in the plan alone.
      gain: control per radian between a joint and its target.
      damping: control per radian per second of a joint's velocity.
      tendons: whether a motor on a fixed tendon follows an angle too: the mean of the joints, each
        as it counts in the tendon's length. Such joints must have the same limits.
      noise: standard deviation of the most varied samples' targets: radians for joints, parts of
        half the range for actuators that are controlled directly.
      finest: the least varied samples' standard deviation, as a part of `noise`.
      temperature: how much worse a sample may be and still count, as a part of the difference
        between the best sample and the worst of the best eighth.
      flowing: whether proposals begin at the targets of the present plan. A joint that moves is
        behind its target: if that were where the joint is now, it would stop at once.
      proposal_interval: plannings from one call of `proposals` to the next, unless the cost's stage
        changes. In between those that it gave last are tried again, as seen from then. Not for
        anchored plans.
      cost_interval: control steps of a plan from one look at its cost to the next. Where steps are
        short, every second one tells as much and takes half of the time outside of MuJoCo.
      servos: whether in the plan servos follow the targets at each time step, instead of the law at
        each control step. A plan is then simulated in one call, without Python and without threads
        that wait for each other: on four threads it takes a quarter less.
      rest: whether in the plan what lies still is left out of the physics till it is touched, as
        MuJoCo's sleeping islands are: with four boxes that saves a fifth of a plan's time.
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
            raise ValueError(f"finest is {self.finest!r}; expected a part of `noise`, 1 at most")

    @property
    def spacing(self) -> float:
        """Seconds from one knot to the next."""
        return self.horizon / (self.knots - (2 if self.anchored else 1))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and bool(np.isfinite(value))


class Cost:
    """What a plan should avoid; see the module's docstring.

    A subclass must define `step_cost`. The other methods are for tasks that have stages or know
    good plans.
    """

    settings = Settings()
    breadth = 1.0  # how wide plans are varied, as a part of the settings' noise; `look` may set it
    place = 0.0  # in knots: where in a plan the present is; the planner sets it if anchored

    def __init__(self, task: Any) -> None:
        """Takes the environment's task, whose terms of reward a cost may use."""
        self.task = task

    def reset(self) -> None:
        """Called at the start of each episode: forgets stages."""

    def look(self, physics: Any) -> None:
        """Called before each planning, to choose the stage.

        Args:
          physics: a single simulation in the environment's present state. It is the planner's own:
            it may be read, moved and stepped.
        """

    def step_cost(self, physics: Any) -> np.ndarray:
        """The cost of states, (N,); a plan's is the mean of those after its control steps.

        It may be called more than once for the same states.

        Args:
          physics: N states that plans lead through, each to be judged by itself, as a batch of
            simulations; to be read only.
        """
        raise NotImplementedError(
            f"{type(self).__name__} does not define step_cost(physics), which returns the cost of "
            "each state of a batch, shape (N,)"
        )

    def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray | None:
        """Plans worth trying besides variations of the present one, (n, knots, nu), or None.

        Args:
          physics: as for `look`.
          random: the planner's stream.

        Returns:
          Targets of the actuators at the knots: an angle in radians for an actuator on a joint, the
          control for others. At most half of the samples are taken from them, from the first on.
        """
        return None

    def stage(self) -> Any:
        """What proposals depend on besides the state, to be compared by `==`.

        While it stays the same, proposals may be tried again; see `Settings.proposal_interval`.
        """
        return None

    def continued(self, plan: np.ndarray) -> np.ndarray:
        """The targets of the knot after a plan's last one, (nu,): by default the same.

        Called when the first of a plan's anchored knots has passed.

        Args:
          plan: the present plan, (knots, nu).
        """
        return plan[-1]

    def followed(self, targets: np.ndarray) -> None:
        """Called at each control step with the targets that are followed from then on, (nu,)."""
