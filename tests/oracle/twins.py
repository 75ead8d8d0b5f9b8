"""The same environment in both packages, driven by the same actions and compared at every step."""

import operator
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from .oracle import BOTH, ours
from .same import assert_same

__all__ = ["ACTIONS", "MODELS", "TASKS", "Twins", "load"]

TASKS = ours("suite").ALL_TASKS
# One task for each model: what depends on the model alone is compared once.
MODELS = [
    ("humanoid", "walk"),
    ("manipulator", "bring_ball"),
    ("manipulator", "bring_peg"),
    ("manipulator", "insert_ball"),
    ("manipulator", "insert_peg"),
    ("stacker", "stack_2"),
    ("stacker", "stack_4"),
]
ACTIONS = ["random", "zero", "bang-bang"]

# Chance per step and actuator that bang-bang control changes its sign: it holds for 10 steps on
# average, long enough to throw the body about and to press fingers against things.
_SWITCH = 0.1


class Twins:
    """One environment of Limberjack and its twin of dm_control."""

    def __init__(self, our_env: Any, their_env: Any, where: str = "") -> None:
        # `Any`: the two environments are of classes that share no type.
        self.ours = our_env
        self.theirs = their_env
        self.where = where
        self.step_count = 0

    def reset(self) -> Any:
        """Both first time steps are the same; returns dm_control's."""
        self.step_count = 0
        return self._compared(self.ours.reset(), self.theirs.reset())

    def step(self, action: Any) -> Any:
        """Both next time steps are the same; returns dm_control's."""
        self.step_count += 1
        return self._compared(self.ours.step(action), self.theirs.step(action))

    def play(self, actions: Iterable[Any]) -> int:
        """Steps until the episode or the actions end; returns the episode's number of steps."""
        for action in actions:
            if self.step(action).last():
                break
        return self.step_count

    def actions(self, kind: str, seed: int) -> Iterator[np.ndarray]:
        """Endless actions for this environment: random, zero or bang-bang."""
        spec = self.theirs.action_spec()
        random = np.random.RandomState(seed)
        signs = random.choice([-1.0, 1.0], spec.shape)
        while True:
            if kind == "zero":
                yield np.zeros(spec.shape)
            elif kind == "random":
                yield random.uniform(spec.minimum, spec.maximum, spec.shape)
            else:
                signs = np.where(random.uniform(size=spec.shape) < _SWITCH, -signs, signs)
                yield np.where(signs > 0, spec.maximum, spec.minimum)

    def assert_same_physics(self, *fields: str) -> None:
        """The named fields, `data.qpos` for one, are the same."""
        for field in fields:
            get = operator.attrgetter(field)
            where = f"{self.where}, step {self.step_count}, {field}"
            assert_same(get(self.ours.physics), get(self.theirs.physics), where)

    def _compared(self, our_step: Any, their_step: Any) -> Any:
        assert_same(our_step, their_step, f"{self.where}, step {self.step_count}")
        return their_step


def load(domain: str, task: str, seed: int | None = 0, **kwargs: Any) -> Twins:
    """The task in both packages; keyword arguments are those of `suite.load`."""
    task_kwargs = {"random": seed} | kwargs.pop("task_kwargs", {})
    envs = [
        package("suite").load(domain, task, task_kwargs=dict(task_kwargs), **kwargs)
        for package in BOTH
    ]
    return Twins(*envs, where=f"{domain}:{task}, seed {seed}")
