"""Plays episodes of the suite for the bridge, in an environment that may lack Limberjack.

    python bridge_player.py PACKAGE DOMAIN TASK FIRST END [POLICY]

plays an episode of each seed from FIRST to END - 1 with `PACKAGE.suite`, which is dm_control's or
Limberjack's, and prints one line of JSON: versions, returns, and the starts. POLICY is a policy
file; without one, all actions are zero.

It imports NumPy, safetensors and PACKAGE, and reads the policy file by itself, after the
description in docs/policies.md: no more is needed to play a policy of Limberjack elsewhere.
"""

import importlib
import importlib.metadata
import json
import math
import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["Network", "environments", "main", "play"]

_MOST_STEPS = 1000  # control steps, of all tasks that have a time limit and of those that have none
_ROWS = 64  # that a network sees, as in Limberjack: other shapes may round differently
_DRAWN_AT_LOAD = ("lqr",)  # domains whose model is drawn as it is loaded

_ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "relu": lambda x: np.maximum(x, 0),
    "relu6": lambda x: np.clip(x, 0, 6),
    "leaky_relu": lambda x: np.where(x > 0, x, np.float32(0.01) * x),
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0))),
    "silu": lambda x: x * (np.float32(0.5) * (np.tanh(x * np.float32(0.5)) + 1)),
    "tanh": np.tanh,
}


class Network:
    """The policy in a file.

    Attributes:
      card: as JSON; see `limberjack.policies.mlp.Card`.
    """

    def __init__(self, path: Path | str) -> None:
        """Reads a file that is known to be a policy."""
        safetensors: Any = importlib.import_module("safetensors")
        with safetensors.safe_open(path, "numpy") as file:
            self.card: dict[str, Any] = json.loads(file.metadata()["limberjack"])
            self._layers = [
                (file.get_tensor(f"layers.{i}.weight"), file.get_tensor(f"layers.{i}.bias"))
                for i in range(len(self.card["sizes"]) - 1)
            ]

    def action(self, observation: dict[str, Any]) -> np.ndarray:
        """The action at one observation, (actions,), float32."""
        names = [name for name, _ in self.card["layout"]]
        x = np.zeros((_ROWS, self.card["sizes"][0]), np.float32)
        x[0] = np.concatenate([np.ravel(observation[name]) for name in names])
        if self.card["mean"] is not None:
            scaled = (x - np.array(self.card["mean"])) / np.array(self.card["scale"])
            clip = self.card["clip"] or np.inf
            x = np.clip(scaled, -clip, clip).astype(np.float32)
        *hidden, (weight, bias) = self._layers
        for inner, offset in hidden:
            x = _ACTIVATIONS[self.card["activation"]](x @ inner.T + offset)
        return self._within_bounds((x @ weight.T + bias)[0])

    def _within_bounds(self, x: np.ndarray) -> np.ndarray:
        low, high = np.array(self.card["low"]), np.array(self.card["high"])
        if self.card["end"] == "tanh":
            x = low + (np.tanh(x) + 1.0) * ((high - low) / 2)
        return np.clip(x, low, high).astype(np.float32)


def environments(suite: Any, domain: str, task: str, seeds: Iterable[int]) -> Iterator[Any]:
    """Environments whose next episode is the first one of each seed.

    Args:
      suite: the module `suite` of a package with dm_control's interface.
      domain, task: of it.
      seeds: of the task's random stream.
    """
    environment: Any = None
    for seed in seeds:
        if environment is None or domain in _DRAWN_AT_LOAD:
            environment = suite.load(domain, task, task_kwargs={"random": seed})
        else:  # the same stream, without compiling the model again
            environment.task.random.seed(seed)
        yield environment


def play(environment: Any, network: Network | None) -> dict[str, Any]:
    """The return, the steps and the start of an environment's next episode.

    Args:
      environment: with dm_control's interface.
      network: acts, every `action_repeat` control steps; None for zero actions.
    """
    repeat = 1 if network is None else network.card["action_repeat"]
    action = np.zeros(environment.action_spec().shape)
    time_step = environment.reset()
    data = environment.physics.data
    start = {
        "state": np.concatenate([data.qpos, data.qvel]).tolist(),
        "observation": np.concatenate([np.ravel(x) for x in time_step.observation.values()]),
    }
    rewards: list[float] = []
    while not time_step.last() and len(rewards) < _MOST_STEPS:
        if network is not None and len(rewards) % repeat == 0:
            action = network.action(time_step.observation)
        time_step = environment.step(action)
        rewards.append(float(time_step.reward))
    start["observation"] = start["observation"].tolist()
    return {"return": math.fsum(rewards), "steps": len(rewards), **start}


def main(package: str, domain: str, task: str, first: int, end: int, policy: str | None) -> Any:
    """The versions, and the results of all seeds, as values of JSON."""
    suite: Any = importlib.import_module(f"{package}.suite")
    network = None if policy is None else Network(policy)
    begun = environments(suite, domain, task, range(first, end))
    episodes = [play(environment, network) for environment in begun]
    versions = {name: _version(name) for name in (package, "mujoco", "numpy")}
    return {"versions": {"python": platform.python_version(), **versions}, "episodes": episodes}


def _version(package: str) -> str:
    found = getattr(importlib.import_module(package), "__version__", None)
    return found or importlib.metadata.version(package)


if __name__ == "__main__":
    os.environ["MUJOCO_GL"] = "disable"  # before dm_control is imported, which looks for a display
    # The packages' output must not mix with the answer.
    channel = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    package, domain, task, first, end, *policy = sys.argv[1:]
    answer = main(package, domain, task, int(first), int(end), policy[0] if policy else None)
    channel.write(json.dumps(answer) + "\n")
    channel.close()
