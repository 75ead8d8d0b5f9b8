"""The costs of cheetah, walker, hopper and quadruped."""

from typing import Any

import numpy as np

from .playing import played, terms_of


def _turned(joint: str, angle: float) -> Any:
    def plant(physics: Any) -> None:
        physics.named.data.qpos[joint] = angle

    return plant


def test_a_cheetah_may_tilt_a_little() -> None:
    states = [_turned("rooty", angle) for angle in (0.0, 0.9, np.pi)]
    tilt = terms_of("cheetah", "run", *states)["tilt"]
    assert tilt.tolist()[:2] == [0, 0]
    assert tilt[2] > 0.3


def test_a_cheetah_runs() -> None:
    rewards, env = played("cheetah", "run", 1000, 60, samples=24)
    assert rewards[-10:].mean() > 0.15
    assert env.physics.speed() > 1.5


def test_a_walker_on_the_ground_costs_more_than_one_that_stands() -> None:
    for task in ("stand", "run"):
        terms = terms_of("walker", task, _turned("rooty", 0.0), _turned("rooty", np.pi / 2))
        assert terms["tilt"][1] > terms["tilt"][0] + 0.2
        total = np.sum(list(terms.values()), axis=0)
        assert total[1] > total[0]


def test_a_walker_gets_up() -> None:
    rewards, _ = played("walker", "stand", 1000, 50, samples=24)
    assert rewards[-10:].mean() > 0.8


def test_a_hopper_wants_its_foot_below_its_body() -> None:
    states = [_turned("rooty", angle) for angle in (0.0, np.pi / 2)]
    terms = terms_of("hopper", "hop", *states)
    for name in ("height", "tilt", "balance"):
        assert terms[name][1] > terms[name][0] + 0.2, name


def test_speed_counts_for_a_hopper_that_shall_hop() -> None:
    standing = _turned("rooty", 0.0)
    hop, stand = (terms_of("hopper", task, standing)["speed"][0] for task in ("hop", "stand"))
    assert hop > stand


def test_a_quadruped_upside_down_costs_more() -> None:
    def rolled(physics: Any) -> None:
        physics.named.data.qpos["root"][3:] = 0, 1, 0, 0

    def level(physics: Any) -> None:
        physics.named.data.qpos["root"][3:] = 1, 0, 0, 0

    terms = terms_of("quadruped", "walk", level, rolled)
    np.testing.assert_allclose(terms["tilt"], [0.0, 1.0], atol=1e-9)


def test_a_quadruped_walks() -> None:
    rewards, env = played("quadruped", "walk", 1001, 40, samples=12)
    assert env.physics.torso_upright() > 0.8
    assert rewards[-10:].mean() > 0.5
