"""Tasks that declare what they remember of an episode, for the tests of declared memory."""

from typing import Any

import numpy as np

from . import odd_environments as odd

HOOKS = ("before_step", "after_step", "get_reward", "get_observation", "get_termination")
COUNTERS = tuple(f"of_{hook}" for hook in HOOKS)


class Smooth(odd.Pole):
    """An action-rate penalty."""

    EPISODE_ATTRIBUTES = ("last_action", "change")

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.last_action = np.zeros(1)
        self.change = 0.0

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self.last_action, self.change = np.zeros(1), 0.0

    def before_step(self, action: Any, physics: Any) -> None:
        self.change = np.abs(action - self.last_action).sum(axis=-1)
        self.last_action = action
        super().before_step(action, physics)

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) - 0.1 * self.change


class Calls(odd.Pole):
    """Counts the calls of every hook, keeps the last positions, and ends episodes by itself.

    An action above 0.9 makes the simulation diverge.
    """

    EPISODE_ATTRIBUTES = (*COUNTERS, "ring", "slot", "episodes", "velocity", "flag", "place")

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        for name in COUNTERS:
            setattr(self, name, 0)
        self.ring = np.zeros((3, 1))
        self.slot = np.int64(0)
        self.episodes = 0
        self.velocity = np.zeros(1)
        self.flag = False
        self.place = np.zeros(3)

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self.episodes += 1
        self.slot = np.int64(0)
        self.ring[:] = physics.data.qpos  # the row's own ring, in place
        self.velocity = physics.data.qvel  # the simulation's memory
        self.place = physics.data.geom_xpos[0]  # which is computed again once the start is set
        self.get_reward(physics)  # a start may call hooks

    def before_step(self, action: Any, physics: Any) -> None:
        self.of_before_step += 1
        super().before_step(action, physics)
        # Of a row that diverges.
        speed = physics.data.qvel
        physics.data.qvel[...] = np.where(np.asarray(action) > 0.9, 1e20, speed)

    def after_step(self, physics: Any) -> None:
        super().after_step(physics)
        self.of_after_step += 1
        slots = np.arange(3) == np.asarray(self.slot)[..., None]
        self.ring[...] = np.where(slots[..., None], physics.data.qpos[..., None, :], self.ring)
        self.slot = (self.slot + 1) % 3
        self.velocity = physics.data.qvel

    def get_reward(self, physics: Any) -> Any:
        self.of_get_reward = self.of_get_reward + 1
        self.flag = self.ring.sum(axis=(-1, -2)) > 0
        return super().get_reward(physics) + self.of_get_reward + 0.1 * self.ring[..., 0, 0]

    def get_observation(self, physics: Any) -> Any:
        self.of_get_observation += 1
        observation = super().get_observation(physics)
        observation["velocity"] = self.velocity
        observation["place"] = self.place
        observation["ring"] = self.ring
        for name in COUNTERS:
            observation[name] = np.asarray(getattr(self, name), float)[..., None]
        observation["flag"] = np.asarray(self.flag)[..., None]
        return observation

    def get_termination(self, physics: Any) -> Any:
        self.of_get_termination += 1
        ends = self.of_after_step % 5 == 0
        return np.where(ends, 0.5, np.nan) if np.ndim(ends) else (0.5 if ends else None)


def smooth(seed: int) -> Any:
    """An environment with an action-rate penalty."""
    return odd.environment(Smooth, seed)
