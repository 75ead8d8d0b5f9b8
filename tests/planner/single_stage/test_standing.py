"""The costs of dog and humanoid_CMU."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite

from .playing import played, terms_of


def _lowered(by: float) -> Any:
    def plant(physics: Any) -> None:
        physics.named.data.qpos["root"][2] -= by

    return plant


def _rolled(physics: Any) -> None:
    physics.named.data.qpos["root"][3:] = 0, 1, 0, 0


def test_a_dog_costs_what_it_lacks_in_height_and_its_tilt() -> None:
    terms = terms_of("dog", "stand", _lowered(0.0), _lowered(0.2), _rolled)
    assert terms["height"][0] == 0
    assert terms["height"][1] == pytest.approx(4.0 * 2 * 0.2, abs=0.4)
    assert terms["tilt"][2] > terms["tilt"][0] + 0.9
    assert terms["factors"][2] > terms["factors"][0] + 0.5


def test_a_dog_that_shall_move_or_fetch_lacks_more_factors() -> None:
    stand, walk, fetch = (
        terms_of("dog", task, _lowered(0.0))["factors"][0] for task in ("stand", "walk", "fetch")
    )
    assert stand < min(walk, fetch)


def test_a_dog_stands() -> None:
    rewards, _ = played("dog", "stand", 1000, 26, samples=12)
    assert rewards[-10:].mean() > 0.7  # without torques it has fallen by then


def test_a_humanoid_costs_its_height_and_a_centre_beside_its_feet() -> None:
    def beside(physics: Any) -> None:
        physics.named.data.qpos["root"][3:] = 1, 0, 0, 0  # the head is along y

    def upright(physics: Any) -> None:
        physics.named.data.qpos["root"][2] += 0.4
        physics.named.data.qpos["root"][3:] = 0.5**0.5, 0.5**0.5, 0, 0

    terms = terms_of("humanoid_CMU", "stand", upright, beside)
    for name in ("height", "tilt", "balance"):
        assert terms[name][1] > terms[name][0] + 0.4, name
    assert terms["height"][0] == 0


def test_a_humanoid_falls_later_than_one_that_does_nothing() -> None:
    _, env = played("humanoid_CMU", "stand", 1003, 20, samples=16)
    idle = suite.load("humanoid_CMU", "stand", task_kwargs={"random": 1003})
    idle.reset()
    for _ in range(20):
        idle.step(np.zeros(56))
    assert env.physics.head_height() > 1.1 > idle.physics.head_height() + 0.2
