"""Policies and an environment that the tests of the evaluation share."""

import collections
import os
import signal
from collections.abc import Mapping
from typing import Any

import numpy as np

from limberjack.rl import control
from limberjack.suite import humanoid

__all__ = [
    "FALLS_FROM",
    "Arm",
    "Compiled",
    "Forgetful",
    "Leaning",
    "Linear",
    "Network",
    "NotANumber",
    "OfItsOwn",
    "Raising",
    "Remembering",
    "TooShort",
    "WithoutEnd",
    "leaning",
    "linear",
    "raising",
    "sinking",
    "too_long",
    "watching",
]

FALLS_FROM = 0.8  # metres; the head is below it after 13 to 18 steps without torques
_JUMPS = 0.2  # share of starts that diverge where that is wanted
_WEIGHTS = np.random.RandomState(7).standard_normal((12, 21)) / 2


def leaning(observation: Mapping[str, Any]) -> np.ndarray:
    """Acts by an observation that is one number, and fails where that has another type."""
    assert isinstance(observation, collections.OrderedDict)
    assert isinstance(observation["head_height"], float)
    return np.tanh(observation["joint_angles"] - observation["head_height"])


class Leaning:
    """The same, as a class without a state."""

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        return leaning(observation)


class Remembering:
    """Acts by how many steps of the episode there were."""

    def reset(self) -> None:
        self.steps = 0

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        self.steps += 1
        return np.full(21, np.sin(self.steps)) * observation["joint_angles"]


def linear(observation: Mapping[str, Any]) -> np.ndarray:
    """A linear policy, summed number by number so that the size of a batch does not matter."""
    return _linear({name: np.asarray(value)[None] for name, value in observation.items()})[0]


def _linear(observations: Mapping[str, np.ndarray]) -> np.ndarray:
    rows = len(observations["head_height"])
    total = np.zeros((rows, 21))
    for column, weights in zip(observations["extremities"].T, _WEIGHTS, strict=True):
        total += column[:, None] * weights
    return np.tanh(total)


class Linear:
    """The same on batches."""

    def __init__(self) -> None:
        self.begun: list[int] = []

    def reset_batch(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        assert rows.shape == seeds.shape
        self.begun += seeds.tolist()

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        assert observations["head_height"].shape == (64,)
        actions = _linear(observations)
        # Kills the process now and then where the tests say so: see test_resuming.py.
        if self.begun[-1] >= int(os.environ.get("KILL_FROM_SEED", str(2**32))):
            os.kill(os.getpid(), signal.SIGKILL)
        return actions


class Arm:
    """Slows the arm's joints down, on batches."""

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.clip(-observations["arm_vel"][:, :5], -1, 1)


class Network:
    """Two layers in float32."""

    def __init__(self) -> None:
        random = np.random.RandomState(1)
        self.layers = [random.standard_normal(s).astype("f") for s in ((12, 256), (256, 21))]

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        first, second = self.layers
        hidden = np.maximum(observations["extremities"].astype("f") @ first, 0)
        return np.tanh(hidden @ second / 20)


class Compiled:
    """Gets its function only as it is made, as one that is compiled then."""

    def __init__(self) -> None:
        self.act_batch = lambda observations: np.zeros((64, 21))


class Forgetful(Arm):
    """Has a state, and a reset that no batch calls."""

    def reset(self) -> None:
        """Forgets."""


class TooShort:
    """Returns an action for one row."""

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.zeros(21)


class NotANumber:
    """Fails in the row that plays seed 70, in its fourth step."""

    def reset_batch(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        self.rows = rows[seeds == 70]
        self.steps = 0

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        actions = np.zeros((64, 21))
        if self.steps == 3:
            actions[self.rows, 2] = np.nan
        self.steps += 1
        return actions


class WithoutEnd:
    """Returns text."""

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> list[str]:
        return ["left"] * 64


def raising(observation: Mapping[str, Any]) -> np.ndarray:
    """Fails in itself."""
    raise ValueError("a mistake of the policy's own")


class Raising:
    """The same on batches."""

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        return raising(observations)


def too_long(observation: Mapping[str, Any]) -> np.ndarray:
    """An action with a number too many."""
    return np.zeros(22)


def watching(observation: Mapping[str, Any]) -> np.ndarray:
    """Acts by the difference between the newest picture and the one before."""
    *_, before, newest = np.split(
        observation["pixels"].astype(int), observation["pixels"].shape[-1] // 3, -1
    )
    return np.cos(np.arange(21) + np.sum(newest - 2 * before))


class OfItsOwn(control.Environment):
    """An environment that is not plain, so that rows cannot be vectorised."""

    def step(self, action: Any) -> Any:
        return super().step(action)


class _Sinks(humanoid.Humanoid):
    """Stand; the task ends the episode once the head is low, so lengths differ."""

    some_diverge = False

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        if self.some_diverge and self.random.uniform() < _JUMPS:
            physics.named.data.qvel["root"] = 1e9

    def get_termination(self, physics: Any) -> Any:
        fallen = physics.head_height() < FALLS_FROM
        if np.ndim(fallen):
            return np.where(fallen, 0.0, np.nan)
        return 0.0 if fallen else None


def sinking(
    seed: int | None = None,
    some_diverge: bool = False,
    kind: type[control.Environment] = control.Environment,
    **kwargs: Any,
) -> control.Environment:
    """An environment whose episodes have different lengths; some of its starts may diverge."""
    physics = humanoid.Physics.from_shared_xml(*humanoid.get_model_and_assets())
    task = _Sinks(move_speed=0, pure_state=False, random=seed)
    task.some_diverge = some_diverge
    return kind(physics, task, time_limit=16 * 0.025, control_timestep=0.025, **kwargs)
