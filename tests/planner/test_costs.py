"""The costs of the suite's tasks."""

import enum
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import Cost, Planner, cost_for
from limberjack.utils.arrays import rows_of_a_batch

from .planned import ONE_OF_EACH_COST, PLANNED

every_task = pytest.mark.parametrize(("domain", "task"), PLANNED)
_ROWS = 6


def _own_fields(env: Any) -> list[str]:
    """The model fields that an episode's start sets."""
    return list(getattr(env.task, "EPISODE_FIELDS", ()))


def _in_many_states(domain: str, task: str) -> tuple[Any, Any]:
    """An environment, and a batch of its physics after random actions."""
    env = suite.load(domain, task, task_kwargs={"random": 7})
    env.reset()
    batch = env.physics.replicate(_ROWS, 1, _own_fields(env)).physics
    saved = env.snapshot().physics
    batch.simulation.load({name: np.repeat(v, _ROWS, axis=0) for name, v in saved.items()})
    random = np.random.default_rng(0)
    for _ in range(30):
        batch.set_control(random.uniform(-1, 1, (_ROWS, env.physics.model.nu)))
        batch.simulation.step(5)
    return env, batch


@pytest.mark.parametrize(("domain", "task"), PLANNED + ONE_OF_EACH_COST)
def test_a_cost_is_one_number_for_each_state_whatever_the_others_are(
    domain: str, task: str
) -> None:
    env, batch = _in_many_states(domain, task)
    cost = cost_for(env.task)
    cost.update(env.physics.copy())
    with rows_of_a_batch(_ROWS):
        together = cost.step_cost(batch)
    assert together.shape == (_ROWS,)
    assert np.isfinite(together).all()
    assert len(set(together.tolist())) == _ROWS
    saved = batch.simulation.save(None, _own_fields(env))
    last = {name: np.repeat(value[-1:], _ROWS, axis=0) for name, value in saved.items()}
    controls = np.repeat(batch.data.ctrl[-1:], _ROWS, axis=0)
    batch.simulation.load(last)
    batch.set_control(controls)
    with rows_of_a_batch(_ROWS):
        alone = cost.step_cost(batch)
    np.testing.assert_array_equal(alone, together[-1])


@every_task
def test_a_cost_inherits_from_no_other_one_and_names_its_stage(domain: str, task: str) -> None:
    cost = cost_for(suite.load(domain, task, task_kwargs={"random": 0}).task)
    assert type(cost).__bases__ == (Cost,)
    stage = cost.stage()
    assert isinstance(stage[0] if isinstance(stage, tuple) else stage, enum.Enum)


@every_task
def test_proposals_are_plans_of_the_right_shape(domain: str, task: str) -> None:
    env, _ = _in_many_states(domain, task)
    cost = cost_for(env.task)
    physics = env.physics.copy()
    cost.update(physics)
    found = cost.proposals(physics, np.random.default_rng(0))
    assert found is not None
    assert found.shape[1:] == (cost.settings.knots, env.physics.model.nu)
    assert np.isfinite(found).all()


def _play(domain: str, task: str, seed: int, seconds: float) -> np.ndarray:
    """The rewards of an episode with the planner."""
    env = suite.load(domain, task, task_kwargs={"random": seed, "time_limit": seconds})
    planner = Planner(env, num_threads=2, seed=seed)
    time_step = env.reset()
    rewards = []
    while not time_step.last():
        time_step = env.step(planner.act())
        rewards.append(time_step.reward)
    return np.array(rewards)


def test_a_ball_that_starts_in_the_hand_is_at_the_target_in_a_second() -> None:
    assert _play("manipulator", "bring_ball", 1001, 1.0)[-10:].mean() > 0.9


@pytest.mark.slow
def test_a_ball_is_fetched_and_brought() -> None:
    assert _play("manipulator", "bring_ball", 1000, 10.0).sum() > 700


@pytest.mark.slow
def test_a_humanoid_gets_up_and_stands() -> None:
    assert _play("humanoid", "stand", 1002, 10.0)[-100:].mean() > 0.9
