"""The costs of reacher, ball_in_cup, finger and fish."""

from typing import Any

import numpy as np
import pytest

from .playing import played, terms_of


def test_a_reacher_costs_its_distance_and_its_speed_at_the_target() -> None:
    def plant(wrist: float, speed: float) -> Any:
        def planted(physics: Any) -> None:
            physics.named.data.qpos["wrist"] = wrist
            physics.named.data.qvel["wrist"] = speed

        return planted

    terms = terms_of("reacher", "hard", plant(0.0, 0.0), plant(2.0, 0.0), plant(0.0, 3.0))
    assert terms["distance"][0] == terms["distance"][2] != terms["distance"][1]
    assert terms["motion"].tolist()[:2] == [0, 0]
    assert terms["motion"][2] > 0


def test_a_reacher_reaches_a_small_target() -> None:
    rewards, _ = played("reacher", "hard", 1000, 150)
    assert rewards[-50:].mean() > 0.9


def test_a_ball_below_the_cup_costs_more_than_one_beside_it() -> None:
    def at(x: float, z: float) -> Any:
        def plant(physics: Any) -> None:
            physics.named.data.qpos[["ball_x", "ball_z"]] = x, z

        return plant

    terms = terms_of("ball_in_cup", "catch", at(0.0, 0.0), at(0.2, 0.5), at(0.0, 0.46))
    assert terms["below"][0] > 0.2
    assert terms["below"][1] == 0
    assert terms["distance"][2] < terms["distance"][1] < terms["distance"][0]


def test_a_ball_is_caught() -> None:
    rewards, _ = played("ball_in_cup", "catch", 1000, 70, samples=16)
    assert rewards[-10:].mean() == 1


def test_a_finger_is_wanted_near_the_body_and_its_tip_at_the_target() -> None:
    def bent(physics: Any) -> None:
        physics.named.data.qpos["proximal"] = 1.5

    def turned(physics: Any) -> None:
        physics.named.data.qpos["hinge"] += np.pi

    terms = terms_of("finger", "turn_hard", lambda physics: None, bent, turned)
    assert terms["finger"][1] != terms["finger"][0] == terms["finger"][2]
    assert terms["distance"][2] != terms["distance"][0] == terms["distance"][1]


@pytest.mark.parametrize("seed", [1000, 1001])
def test_a_finger_turns_the_tip_into_a_small_target(seed: int) -> None:
    rewards, _ = played("finger", "turn_hard", seed, 80, samples=16)
    assert rewards[-10:].mean() == 1


def test_a_fish_swims_towards_its_target() -> None:
    def near(physics: Any) -> None:
        physics.data.qpos[:3] = physics.named.model.geom_pos["target"]

    distance = terms_of("fish", "swim", near, lambda physics: None)["distance"]
    assert distance[0] < distance[1]
    _, env = played("fish", "swim", 1000, 60, samples=12)
    start = terms_of("fish", "swim", lambda physics: None)["distance"]
    assert np.linalg.norm(env.physics.mouth_to_target()) < start
