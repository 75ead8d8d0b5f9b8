"""Policies that the tests of datasets name as a user does, MODULE:CALLABLE."""

import os
import signal
from collections.abc import Mapping

import numpy as np

__all__ = ["Failing", "Killing", "Remembering", "moving"]


class Remembering:
    """Acts by the number of steps so far, so that it plays one episode at a time."""

    def reset(self) -> None:
        """Begins an episode."""
        self.steps = 0

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """The action."""
        self.steps += 1
        return np.sin([self.steps + observation["velocity"][0]])


class Killing:
    """Acts with zeros; kills its process where the environment variable names a seed."""

    def reset_batch(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Begins episodes."""
        if int(os.environ.get("KILL_AT_SEED", "-1")) in seeds:
            os.kill(os.getpid(), signal.SIGKILL)

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        """The actions."""
        return np.zeros((64, 1))


class Failing:
    """Returns no action in the episode of seed 70."""

    def __init__(self) -> None:
        self.episodes = -1

    def reset(self) -> None:
        """Begins an episode."""
        self.episodes += 1

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """The action."""
        return np.zeros(2 if self.episodes == 70 else 1)


def moving(observation: Mapping[str, np.ndarray]) -> np.ndarray:
    """Changes the working directory, as libraries of settings do."""
    os.chdir("/")
    return np.zeros(1)
