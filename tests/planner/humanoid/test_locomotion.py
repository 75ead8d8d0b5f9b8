"""Stages of the humanoid's cost, and its terms."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import cost_for
from limberjack.planner.humanoid.locomotion import Locomotion, Stage


def _upright(task: str) -> tuple[Any, Any]:
    """The cost of a task and its physics, upright and at rest."""
    env = suite.load("humanoid", task, {"random": 0})
    env.reset()
    with env.physics.reset_context():
        env.physics.data.qpos[:] = env.physics.model.qpos0
    return cost_for(env.task), env.physics


@pytest.mark.parametrize(("task", "stage"), [("stand", Stage.STAND), ("walk", Stage.MOVE)])
def test_a_body_that_is_steady_moves_if_the_task_moves(task: str, stage: Stage) -> None:
    cost, physics = _upright(task)
    assert isinstance(cost, Locomotion)
    assert cost.stage() is Stage.STAND
    cost.update(physics)
    assert cost.stage() is stage


def test_a_body_that_has_fallen_stands_up_first() -> None:
    cost, physics = _upright("run")
    cost.update(physics)
    with physics.reset_context():
        physics.named.data.qpos["root"][2] = 0.3
    cost.update(physics)
    assert cost.stage() is Stage.STAND
    cost.update(physics)
    assert cost.stage() is Stage.STAND


def test_a_body_that_falls_fast_through_standing_height_is_not_steady() -> None:
    cost, physics = _upright("walk")
    with physics.reset_context():
        physics.named.data.qvel["root"][:3] = 0.0, 0.0, -2.0
    cost.update(physics)
    assert cost.stage() is Stage.STAND


def test_a_low_head_and_a_tilted_torso_cost_more() -> None:
    cost, physics = _upright("stand")
    upright = cost.weighted_terms(physics)
    with physics.reset_context():
        physics.named.data.qpos["root"][2] -= 0.5
    low = cost.weighted_terms(physics)
    assert low["height"] == 2.0 * (1.55 - physics.head_height()) > upright["height"]
    assert low["reward"] > upright["reward"]
    assert np.isfinite(cost.step_cost(physics))
