"""Short episodes with the planner, and costs of planted states."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from limberjack import suite
from limberjack.mujoco.simulation import model_fields
from limberjack.planner import Planner, cost_for
from limberjack.utils.arrays import rows_of_a_batch

__all__ = ["played", "terms_of"]


def played(domain: str, task: str, seed: int, steps: int, samples: int = 32) -> Any:
    """The rewards of the first steps of an episode, (steps,), and the environment after them."""
    env = suite.load(domain, task, task_kwargs={"random": seed})
    settings = dataclasses.replace(cost_for(env.task).settings, samples=samples)
    planner = Planner(env, num_threads=1, seed=seed, settings=settings)
    env.reset()
    return np.array([env.step(planner.act()).reward for _ in range(steps)]), env


def terms_of(domain: str, task: str, *plants: Callable[[Any], None]) -> dict[str, np.ndarray]:
    """The cost's weighted terms for states that differ from a start, by name, (states,) each."""
    env = suite.load(domain, task, task_kwargs={"random": 0})
    env.reset()
    count = len(plants)
    saved = env.snapshot().physics
    batch = env.physics.replicate(count, 1, tuple(model_fields(saved))).physics
    batch.simulation.load({name: np.repeat(v, count, axis=0) for name, v in saved.items()})
    for row, plant in enumerate(plants):
        single = env.physics.copy()
        with single.reset_context():
            plant(single)
        batch.simulation.state[row] = single.simulation.save(None, ())["state"][0]
    batch.forward()
    with rows_of_a_batch(count):
        terms = cost_for(env.task).weighted_terms(batch)
    return {name: np.asarray(term) for name, term in terms.items()}
