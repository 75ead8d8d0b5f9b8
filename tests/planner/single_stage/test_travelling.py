"""The costs of point_mass, lqr, swimmer, and the quadruped's escape and fetch."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import cost_for

from .playing import played, terms_of

_EDGE = 30  # metres from the centre of the terrain of escape


def _moving(position: float, speed: float) -> Any:
    def plant(physics: Any) -> None:
        physics.data.qpos[:] = position
        physics.data.qvel[:] = speed

    return plant


def test_a_ball_costs_its_distance_and_its_speed_at_the_target() -> None:
    terms = terms_of("point_mass", "easy", _moving(0.0, 0.0), _moving(0.1, 0.0), _moving(0.0, 1.0))
    # A length is a rounded root.
    np.testing.assert_allclose(terms["distance"], [0, 4.0 * 0.1 * 2**0.5, 0], rtol=1e-15)
    assert terms["motion"][2] > 0.5
    assert terms["motion"].tolist()[:2] == [0, 0]


@pytest.mark.parametrize("task", ["easy", "hard"])
def test_a_ball_is_held_at_the_target(task: str) -> None:
    rewards, _ = played("point_mass", task, 1000, 150, samples=32)
    assert rewards[-20:].mean() > 0.95


def test_a_chain_costs_as_much_as_its_task_and_what_is_left_of_its_motion() -> None:
    plants = _moving(0.0, 0.0), _moving(1.0, 0.0), _moving(0.0, 1.0)
    np.testing.assert_array_equal(terms_of("lqr", "lqr_2_1", *plants)["reward"], [0, 1, 0])
    env = suite.load("lqr", "lqr_2_1", {"random": 0})
    left = []
    for plant in plants:
        with env.physics.reset_context():
            plant(env.physics)
        left.append(cost_for(env.task).terminal(env.physics))
    # A length is a rounded root.
    np.testing.assert_allclose(left, [0, 1.5, 1.5], rtol=1e-15)


@pytest.mark.parametrize("seed", [1001, 1002])
def test_a_chain_comes_to_rest(seed: int) -> None:
    rewards, env = played("lqr", "lqr_2_1", seed, 500, samples=16)
    assert rewards[-30:].mean() > 0.9
    assert env.physics.state_norm() < 0.7


def test_a_swimmer_swims_towards_its_target() -> None:
    def near(physics: Any) -> None:
        physics.data.qpos[:2] = physics.named.model.geom_pos["target", ["x", "y"]]

    distance = terms_of("swimmer", "swimmer6", near, lambda physics: None)["distance"]
    assert distance[0] < 0.5 < distance[1]
    rewards, _ = played("swimmer", "swimmer6", 1003, 60, samples=12)
    assert rewards[-5:].mean() > 1.3 * rewards[:5].mean()


def _at(x: float) -> Any:
    def plant(physics: Any) -> None:
        physics.named.data.qpos["root"][0] = x
        physics.named.data.qpos["root"][3:] = 1, 0, 0, 0

    return plant


def test_a_quadruped_costs_the_way_to_the_edge() -> None:
    way = terms_of("quadruped", "escape", _at(0.0), _at(10.0))["way"]
    assert 3.8 < way[0] < 4.0  # the workspace is ahead of the middle of the torso
    assert way[0] - way[1] == pytest.approx(4.0 * 10 / _EDGE, abs=0.1)


def test_a_quadruped_costs_its_way_to_the_ball_and_the_balls_to_the_target() -> None:
    def ball(x: float) -> Any:
        def plant(physics: Any) -> None:
            physics.named.data.qpos["root"][:2] = 0, 0
            physics.named.data.qpos["root"][3:] = 1, 0, 0, 0
            physics.named.data.qpos["ball_root"][:2] = x, 0

        return plant

    terms = terms_of("quadruped", "fetch", ball(2.0), ball(4.0), ball(-4.0))
    assert terms["bring"][1] - terms["bring"][0] == pytest.approx(2.0, abs=1e-6)
    assert terms["reach"][1] > terms["reach"][0] + 1.0
    assert terms["behind"][0] == pytest.approx(0.5, abs=0.1)  # between ball and target


def test_a_quadruped_walks_to_the_ball() -> None:
    rewards, _ = played("quadruped", "fetch", 1000, 40, samples=12)
    assert rewards[-5:].mean() > rewards[:5].mean() + 0.03
