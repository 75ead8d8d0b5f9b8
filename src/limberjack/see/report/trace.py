"""`Trace`: rewards, their terms, observations, actions and plans of an episode, step by step.

    trace = Trace(environment)
    trace.add(Step(0, 0.0, environment.reset(), None))      # and each step
    trace.seconds, trace.rewards, trace.terms["upright"], trace.observations["velocity"]
    trace.labels.observations["velocity"][0]      # Label('root x', 'm/s')

It records what the steps returned and computes nothing until the last one, so the episode is the
same without it. Of a long episode it records every second step, then every fourth, ..., so that an
hour takes no more memory than a minute.
"""

import dataclasses
from collections.abc import Mapping

import dm_env
import numpy as np

from limberjack.rl.action_specs import as_numbers
from limberjack.rl.control import Environment, shown_by
from limberjack.see.report.labels import MOST_NUMBERS, Labels, labels_of

__all__ = ["Step", "Trace"]

_MOST_SAMPLES = 4000  # four times as many as an episode of the suite has steps


@dataclasses.dataclass(frozen=True)
class Step:
    """The reset of an episode or one of its steps, as films and pages show it."""

    number: int  # steps so far; 0 for the reset
    total: float  # return so far
    time_step: dm_env.TimeStep
    action: np.ndarray | None  # the action of this step; None for the reset

    @property
    def reward(self) -> float:
        """The reward of this step; 0 for the reset."""
        return 0.0 if self.time_step.reward is None else float(self.time_step.reward)


class Trace:
    """Samples of an episode, up to its latest step.

    Attributes:
      labels: names and units of the observations and actions; empty until the episode has ended.
      too_large: numbers of each observation that has too many to be recorded, as a picture, by
        name.
    """

    def __init__(self, environment: Environment) -> None:
        """Begin a trace of the environment's running episode."""
        self.labels = Labels({}, ())
        self.too_large: dict[str, int] = {}
        self._environment = environment
        self._control_timestep = environment.control_timestep()
        self._stride = 1
        self._steps: list[int] = []
        self._rewards: list[float] = []
        self._terms: list[dict[str, float]] = []
        self._observations: list[dict[str, np.ndarray]] = []
        self._actions: list[np.ndarray | None] = []
        self._plan: tuple[str, dict[str, float]] = ("", {})
        self._plans: list[tuple[str, dict[str, float]]] = []

    def add_plan(self, stage: str, terms: Mapping[str, float]) -> None:
        """Record the plan that the next step's action is from: its stage and its cost's terms."""
        self._plan = stage, dict(terms)

    def add(self, step: Step) -> None:
        """Record the reset or a step that the environment has just returned, if it is sampled."""
        if step.time_step.last():
            self.labels = labels_of(self._environment)
        if step.number % self._stride:
            return
        terms = shown_by(self._environment, "reward_terms", {}) if step.number else {}
        self._steps.append(step.number)
        self._rewards.append(step.reward if step.number else np.nan)
        self._terms.append({name: float(value) for name, value in terms.items()})
        observation = step.time_step.observation
        sizes = {name: np.size(value) for name, value in observation.items()}
        self.too_large |= {name: size for name, size in sizes.items() if size > MOST_NUMBERS}
        small = [name for name in sizes if name not in self.too_large]
        self._observations.append({name: np.array(observation[name]) for name in small})
        self._actions.append(_numbers(step.action))
        self._plans.append(self._plan if step.number else ("", {}))
        if len(self._steps) > _MOST_SAMPLES:
            self._halve()

    def _halve(self) -> None:
        self._stride *= 2
        samples = (self._steps, self._rewards, self._terms, self._observations, self._actions)
        for series in (*samples, self._plans):
            del series[1::2]

    @property
    def seconds(self) -> np.ndarray:
        """The time of each sample since the reset, (n,)."""
        return np.array(self._steps) * self._control_timestep

    @property
    def rewards(self) -> np.ndarray:
        """The reward of each sample's step, (n,); NaN for the reset."""
        return np.array(self._rewards)

    @property
    def terms(self) -> dict[str, np.ndarray]:
        """The terms of the rewards, (n,) each, by name; NaN for the reset and where one lacks."""
        return _series(self._terms)

    @property
    def plan_terms(self) -> dict[str, np.ndarray]:
        """The terms of the plans' cost, (n,) each, by name; NaN in stages without that term."""
        return _series([terms for _, terms in self._plans])

    @property
    def stages(self) -> list[tuple[float, str]]:
        """The planner's stages in order, each with the second at which it began."""
        changes: list[tuple[float, str]] = []
        # A plan is made before the step that it belongs to.
        for second, (stage, _) in zip(self.seconds, self._plans[1:], strict=False):
            if stage and (not changes or changes[-1][1] != stage):
                changes.append((float(second), stage))
        return changes

    @property
    def observations(self) -> dict[str, np.ndarray]:
        """Each sample's observation, (n, size) each, by name."""
        names = self._observations[-1] if self._observations else {}
        return {
            name: np.array([observed[name].ravel() for observed in self._observations], float)
            for name in names
        }

    @property
    def actions(self) -> np.ndarray:
        """The action of each sample's step, (n, size); NaN for the reset.

        The size is 0 where actions are not arrays of numbers.
        """
        actions = self._actions
        sizes = {action.size for action in actions[1:] if action is not None}
        if len(sizes) != 1 or any(action is None for action in actions[1:]):
            return np.empty((len(actions), 0))
        (size,) = sizes
        return np.array([np.full(size, np.nan) if a is None else a.ravel() for a in actions])


def _series(samples: list[dict[str, float]]) -> dict[str, np.ndarray]:
    """Values by name over the samples, (n,) each; NaN where a sample lacks the name."""
    names = dict.fromkeys(name for one in samples for name in one)
    return {name: np.array([one.get(name, np.nan) for one in samples]) for name in names}


def _numbers(action: object) -> np.ndarray | None:
    """A copy of an action as an array; None for the reset, or if it is no array of numbers."""
    if action is None:
        return None
    try:
        return np.array(as_numbers(getattr(action, "continuous_actions", action)), float)
    except (TypeError, ValueError):  # a nested structure, which the task understands
        return None
