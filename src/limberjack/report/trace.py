"""`Trace`: the reward, its terms and the observations of an episode, step by step.

    trace = Trace(environment)
    trace.add(0)  # after the reset, and then after each step
    trace.add(1)
    trace.seconds, trace.rewards, trace.terms["upright"], trace.observations["velocity"]

It only reads: the episode goes on as if nobody had looked. Of a long episode it keeps every second
step, then every fourth, ..., so that it needs no more memory for an hour than for a minute.
"""

from typing import Any

import numpy as np

from limberjack.rl.reward_terms import reward_and_terms

__all__ = ["Trace"]

_MOST_SAMPLES = 4000  # four times as many as an episode of the suite has steps


class Trace:
    """What could be seen in an episode so far."""

    def __init__(self, environment: Any) -> None:
        """Begins a trace of the environment's running episode."""
        self._physics, self._task = environment.physics, environment.task
        self._control_timestep = environment.control_timestep()
        self._stride = 1
        self._steps: list[int] = []
        self._rewards: list[float] = []
        self._terms: list[dict[str, float]] = []
        self._observations: list[dict[str, np.ndarray]] = []

    def add(self, step: int) -> None:
        """Keeps the present state, if its turn has come.

        Args:
          step: the number of steps since the reset; the reset has no reward.
        """
        if step % self._stride:
            return
        physics, task = self._physics, self._task
        reward, terms = reward_and_terms(task, physics) if step else (np.nan, {})
        self._steps.append(step)
        self._rewards.append(float(reward))
        self._terms.append({name: float(value) for name, value in terms.items()})
        observation = task.get_observation(physics)
        self._observations.append({name: np.array(value) for name, value in observation.items()})
        if len(self._steps) > _MOST_SAMPLES:
            self._halve()

    def _halve(self) -> None:
        self._stride *= 2
        for samples in (self._steps, self._rewards, self._terms, self._observations):
            del samples[1::2]

    @property
    def seconds(self) -> np.ndarray:
        """When each sample was taken, (n,), since the reset."""
        return np.array(self._steps) * self._control_timestep

    @property
    def rewards(self) -> np.ndarray:
        """The reward of each sample's step, (n,); NaN for the reset."""
        return np.array(self._rewards)

    @property
    def terms(self) -> dict[str, np.ndarray]:
        """What the rewards are made of, (n,) each, by name; NaN for the reset."""
        names = self._terms[-1] if self._terms else {}
        return {
            name: np.array([terms.get(name, np.nan) for terms in self._terms]) for name in names
        }

    @property
    def observations(self) -> dict[str, np.ndarray]:
        """Each sample's observation, (n, size) each, by name."""
        names = self._observations[-1] if self._observations else {}
        return {
            name: np.array([observed[name].ravel() for observed in self._observations], float)
            for name in names
        }
