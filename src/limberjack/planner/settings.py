"""`Settings`: the planner's options for a task.

    settings = Settings(horizon=0.4, samples=32, gain=2.5)
    settings = dataclasses.replace(cost.settings, samples=16)

A setting that cannot be used is refused when it is made, with the value and what was expected.
"""

import dataclasses

import numpy as np

from limberjack.planner.optimisers.base import Optimiser
from limberjack.planner.optimisers.mppi import MPPI

__all__ = ["Settings"]


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
      gain: control per radian between a joint and its target. None derives it for each motor: full
        control at a quarter of the joint's range, at most half a radian; motors on joints without
        limits then take controls as targets.
      damping: control per radian per second of a joint's velocity. None derives it from the gain,
        the gear and the joint's inertia: half of critical damping, less the joint's own.
      tendons: whether motors on fixed tendons also follow an angle: the mean of the joints,
        weighted as in the tendon's length. These joints must have equal limits.
      noise: largest standard deviation of what is added to the targets of a plan: radians for
        joints, fractions of half the range for directly controlled actuators. None is half the
        range, of joints too.
      optimiser: the way from samples and their costs to a new plan, with its own constants.
      flowing: whether proposals begin at the targets of the current plan. A moving joint lags
        behind its target, so a target at its current position would stop it abruptly.
      proposal_interval: planning steps between calls of `proposals`, unless the cost's stage
        changes. In between, the last ones are used again, shifted in time. Not for anchored plans.
      cost_interval: control steps between evaluations of a plan's cost. With short steps, every
        second one is enough and halves the time spent outside MuJoCo.
      servos: whether servos in the planning model follow the targets at each time step, instead of
        the control law at each control step. Threads then do not wait for each other between
        steps: on four threads a rollout takes a quarter less.
      sleep: whether bodies at rest are left out of the planning model's physics until touched, like
        MuJoCo's sleeping islands: with four boxes this saves a fifth of a plan's time.
    """

    samples: int = 64
    horizon: float = 0.5
    knots: int = 5
    anchored: bool = False
    interval: int = 1
    timestep: float | None = None
    armature: float = 0.0
    gain: float | None = None
    damping: float | None = None
    tendons: bool = False
    noise: float | None = None
    optimiser: Optimiser = dataclasses.field(default_factory=MPPI)
    flowing: bool = False
    proposal_interval: int = 1
    cost_interval: int = 1
    servos: bool = False
    sleep: bool = False

    def __post_init__(self) -> None:
        at_least = {"samples": 2, "knots": 3 if self.anchored else 2}
        at_least |= dict.fromkeys(("interval", "proposal_interval", "cost_interval"), 1)
        for name, least in at_least.items():
            value = getattr(self, name)
            if not isinstance(value, int | np.integer) or value < least:
                raise ValueError(f"{name} is {value!r}; expected a whole number from {least} up")
        positive = ("horizon", "gain", "noise", "timestep")
        expected = dict.fromkeys(positive, "a positive number")
        expected |= dict.fromkeys(("damping", "armature"), "a number from 0 up")
        for name, what in expected.items():
            value = getattr(self, name)
            is_number = isinstance(value, int | float | np.number) and np.isfinite(value)
            if name in ("timestep", "gain", "damping", "noise") and value is None:
                continue
            if not is_number or value < 0 or (value == 0 and name in positive):
                raise ValueError(f"{name} is {value!r}; expected {what}")
        if self.anchored and self.proposal_interval > 1:
            raise ValueError(
                f"proposal_interval is {self.proposal_interval}; expected 1, as plans are anchored"
            )
        if not isinstance(self.optimiser, Optimiser):
            raise ValueError(
                f"optimiser is {self.optimiser!r}; expected one such as MPPI() or ICEM()"
            )

    @property
    def spacing(self) -> float:
        """Time between knots, seconds."""
        return self.horizon / (self.knots - (2 if self.anchored else 1))
