"""`Trace`: the reward, its terms and the observations of an episode, step by step.

    trace = Trace(environment)
    run_episode(environment, policies.random, seed, on_step=trace.add)
    trace.seconds, trace.rewards, trace.terms["upright"], trace.observations["velocity"]

It keeps what the steps returned and computes nothing, so the episode is the same without it. Of a
long episode it keeps every second step, then every fourth, ..., so that it needs no more memory for
an hour than for a minute.
"""

import numpy as np

from limberjack.rl.control import Environment
from limberjack.rollout import Step

__all__ = ["Trace"]

_MOST_SAMPLES = 4000  # four times as many as an episode of the suite has steps


class Trace:
    """What an episode has shown so far."""

    def __init__(self, environment: Environment) -> None:
        """Begin a trace of the environment's running episode."""
        self._environment = environment
        self._control_timestep = environment.control_timestep()
        self._stride = 1
        self._steps: list[int] = []
        self._rewards: list[float] = []
        self._terms: list[dict[str, float]] = []
        self._observations: list[dict[str, np.ndarray]] = []

    def add(self, step: Step) -> None:
        """Keep the reset or a step that the environment has just returned, if its turn has come."""
        if step.number % self._stride:
            return
        terms = self._environment.reward_terms if step.number else {}
        self._steps.append(step.number)
        self._rewards.append(step.reward if step.number else np.nan)
        self._terms.append({name: float(value) for name, value in terms.items()})
        observation = step.time_step.observation
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
