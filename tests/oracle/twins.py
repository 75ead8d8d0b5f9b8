"""The same environment or Physics in both packages, driven alike and compared."""

import functools
import itertools
import operator
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any

import numpy as np
import pytest

from limberjack.rl.action_specs import bounds_to_try

from . import models
from .drawn_here import compared_part
from .oracle import BOTH, ours, theirs
from .same import assert_same, assert_same_outcome, assert_same_pair

__all__ = [
    "ACTIONS",
    "MODELS",
    "MODEL_OF",
    "TASKS",
    "TwinPhysics",
    "Twins",
    "actions",
    "load",
    "load_physics",
    "or_slow",
]

TASKS = ours("suite").ALL_TASKS
ACTIONS = ["random", "zero", "bang-bang"]


# Tasks whose model is that of the first task of their domain.
_SHARING = {
    "acrobot": ["swingup_sparse"],
    "cartpole": ["balance_sparse", "swingup", "swingup_sparse"],
    "dog": ["walk"],
    "finger": ["turn_easy", "turn_hard"],
    "fish": ["swim"],
    "hopper": ["hop"],
    "humanoid": ["walk", "run", "run_pure_state"],
    "humanoid_CMU": ["walk", "run"],
    "point_mass": ["hard"],
    "reacher": ["hard"],
    "walker": ["walk", "run"],
}
# One task per model, for comparisons that depend only on the model, and that of each task.
MODELS = [(domain, task) for domain, task in TASKS if task not in _SHARING.get(domain, [])]
MODEL_OF = {
    task: task if task in MODELS else next(one for one in MODELS if one[0] == task[0])
    for task in TASKS
}

# Chance per step and actuator that bang-bang control changes its sign: it holds for 10 steps on
# average, long enough to throw the body about and to press fingers against things.
_SWITCH = 0.1

_TURN = 25  # steps of mixed actions before the next kind

_STATE_FIELDS = (
    "qpos",
    "qvel",
    "act",
    "ctrl",
    "qacc",
    "qacc_warmstart",
    "sensordata",
    "xpos",
    "xmat",
)
_QUERIES = ("position", "velocity", "control", "activation", "state", "time", "timestep")


def or_slow(tasks: Iterable[tuple[Any, ...]], kept: Collection[tuple[str, str]]) -> list[Any]:
    """Arguments that begin with a task, marked as slow unless it is among those that are kept."""
    return [pytest.param(*one, marks=() if one[:2] in kept else pytest.mark.slow) for one in tasks]


def actions(spec: Any, kind: str, seed: int) -> Iterator[np.ndarray]:
    """Endless actions: random, zero, bang-bang, or mixed, which is each of these in turn."""
    if kind == "mixed":
        parts = [actions(spec, part, seed) for part in ACTIONS]
        yield from (next(parts[number // _TURN % len(parts)]) for number in itertools.count())
    random = np.random.RandomState(seed)
    low, high = bounds_to_try(spec)
    signs = random.choice([-1.0, 1.0], spec.shape)
    while True:
        if kind == "zero":
            yield np.zeros(spec.shape)
        elif kind == "random":
            yield random.uniform(low, high, spec.shape)
        else:
            signs = np.where(random.uniform(size=spec.shape) < _SWITCH, -signs, signs)
            yield np.where(signs > 0, high, low)


class Twins:
    """An environment of Limberjack and the same one of dm_control."""

    def __init__(self, our_env: Any, their_env: Any, where: str = "") -> None:
        # `Any`: the two environments are of classes that share no type.
        self.ours = our_env
        self.theirs = their_env
        self.where = where
        self.step_count = 0

    def reset(self) -> Any:
        """Resets both and compares the first time steps; returns dm_control's."""
        self.step_count = 0
        return self._compared(self.ours.reset(), self.theirs.reset())

    def step(self, action: Any) -> Any:
        """Steps both and compares the time steps; returns dm_control's.

        Where the simulation diverges, both raise, and both begin the next episode.
        """
        self.step_count += 1
        try:
            step = self.ours.step(action)
        except ours("rl.control").PhysicsError:
            with pytest.raises(theirs("rl.control").PhysicsError):
                self.theirs.step(action)
            return self.reset()
        return self._compared(step, self.theirs.step(action))

    def play(self, actions: Iterable[Any]) -> int:
        """Steps until the episode or the actions end; returns the episode's number of steps."""
        for action in actions:
            if self.step(action).last():
                break
        return self.step_count

    def actions(self, kind: str, seed: int) -> Iterator[np.ndarray]:
        """Endless actions for this environment; see `actions`."""
        return actions(self.theirs.action_spec(), kind, seed)

    def assert_same_physics(self, *fields: str) -> None:
        """Compares the named fields, such as `data.qpos`."""
        both = self.ours.physics, self.theirs.physics
        for field in fields:
            values = [operator.attrgetter(field)(physics) for physics in both]
            if field.startswith("model."):
                models = both[0].model.ptr, both[1].model.ptr
                domain, name = self.where.partition(":")[0], field.removeprefix("model.")
                values = compared_part(domain, name, models, values)
            if values is not None:
                assert_same_pair(values, f"{self.where}, step {self.step_count}, {field}")

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


class TwinPhysics:
    """A Physics of each package, driven alike."""

    def __init__(self, ours: Any, theirs: Any, where: str = "") -> None:
        # `Any`: classes of two packages that share no type.
        self.both = (ours, theirs)
        self.where = where

    def do(self, act: Callable[[Any], Any]) -> None:
        """Applies `act` to both and compares results or error types, then states."""
        assert_same_outcome([functools.partial(act, one) for one in self.both], self.where)
        self.assert_same_state()

    def map(self, act: Callable[[Any], Any]) -> "TwinPhysics":
        """The pair of results of `act`."""
        return TwinPhysics(*map(act, self.both), where=self.where)

    def assert_same_state(self) -> None:
        """Compares the whole state and all results of the physics' methods."""
        for field in _STATE_FIELDS:
            assert_same_pair(
                (getattr(one.data, field) for one in self.both), f"{self.where} {field}"
            )
        for query in _QUERIES:
            assert_same_pair(
                (getattr(one, query)() for one in self.both), f"{self.where} {query}()"
            )
        assert_same_pair((one.data.ncon for one in self.both), f"{self.where} ncon")
        assert_same_pair((one.data.warning.number for one in self.both), f"{self.where} warnings")

    def play(self, steps: int = 20, nstep: int = 1, seed: int = 0) -> None:
        """Steps with random controls and compares the states after each step."""
        random = np.random.RandomState(seed)
        for _ in range(steps):
            control = random.uniform(-1, 1, self.both[1].model.nu)
            for physics in self.both:
                physics.set_control(control)
                physics.step(nstep)
            self.assert_same_state()


def load_physics(name: str = "zoo") -> TwinPhysics:
    """A model of `models.BY_NAME` in both packages."""
    both = (package("mujoco").Physics.from_xml_string(models.BY_NAME[name]) for package in BOTH)
    return TwinPhysics(*both, where=name)
