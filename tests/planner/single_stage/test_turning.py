"""The costs of finger spin and fish upright."""

from typing import Any

import pytest

from .playing import played, terms_of


def _spinning(speed: float) -> Any:
    def plant(physics: Any) -> None:
        physics.named.data.qvel["hinge"] = speed

    return plant


def test_a_body_that_spins_fast_enough_costs_nothing_for_its_speed() -> None:
    terms = terms_of("finger", "spin", _spinning(0.0), _spinning(-8.0), _spinning(-20.0))
    assert terms["speed"].tolist() == pytest.approx([2.0, 1.0, 0.0], abs=1e-6)
    assert terms["reward"].tolist() == [1, 1, 0]


def test_a_finger_that_is_far_from_the_body_costs_more() -> None:
    def bent(physics: Any) -> None:
        physics.named.data.qpos["proximal"] = 1.5

    terms = terms_of("finger", "spin", lambda physics: None, bent)
    assert terms["finger"][0] != terms["finger"][1]


def test_a_finger_spins_the_body() -> None:
    rewards, _ = played("finger", "spin", 1000, 80)
    assert rewards.mean() > 0.15


def test_a_fish_costs_its_tilt_and_its_turning_where_it_is_upright() -> None:
    def turned(upright: bool, turning: float) -> Any:
        def plant(physics: Any) -> None:
            physics.data.qpos[3:7] = (1, 0, 0, 0) if upright else (0, 1, 0, 0)
            physics.data.qvel[3:6] = turning, 0, 0

        return plant

    terms = terms_of("fish", "upright", turned(True, 0), turned(False, 0), turned(True, 2))
    assert terms["tilt"].tolist() == pytest.approx([0, 1, 0], abs=1e-6)
    assert terms["motion"][2] == pytest.approx(0.02 * 4, rel=0.1)
    assert terms["motion"][0] == pytest.approx(0, abs=1e-9)


def test_a_fish_turns_upright() -> None:
    rewards, _ = played("fish", "upright", 1002, 80, samples=24)
    assert rewards[-10:].mean() > rewards[:10].mean() + 0.3
