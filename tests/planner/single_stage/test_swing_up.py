"""The costs of pendulum, cartpole and acrobot."""

from typing import Any

import numpy as np

from .playing import played, terms_of


def _hinge(angle: float, speed: float = 0.0) -> Any:
    def plant(physics: Any) -> None:
        physics.named.data.qpos["hinge"] = angle
        physics.named.data.qvel["hinge"] = speed

    return plant


def test_a_pendulum_costs_less_the_higher_and_the_slower_it_is_at_the_top() -> None:
    states = [_hinge(np.pi), _hinge(np.pi / 2), _hinge(0.0), _hinge(0.0, 4.0), _hinge(np.pi, 4.0)]
    terms = terms_of("pendulum", "swingup", *states)
    np.testing.assert_allclose(terms["height"], [1.0, 0.5, 0.0, 0.0, 1.0], atol=1e-12)
    assert terms["motion"][3] > 100 * terms["motion"][4] > 0
    np.testing.assert_array_equal(terms["reward"], [1, 1, 0, 0, 1])


def test_a_pendulum_is_swung_up_and_held() -> None:
    # From hanging it takes six seconds of swinging, in which targets would drift out of reach.
    rewards, _ = played("pendulum", "swingup", 1004, 400)
    assert rewards[-50:].mean() > 0.9


def _cart(at: float, angle: float) -> Any:
    def plant(physics: Any) -> None:
        physics.named.data.qpos["slider"] = at
        physics.data.qpos[1:] = angle

    return plant


def test_a_cart_is_wanted_in_the_middle_and_all_its_poles_up() -> None:
    for task in ("swingup", "three_poles"):
        terms = terms_of("cartpole", task, _cart(0.0, 0.0), _cart(0.0, np.pi), _cart(1.0, 0.0))
        assert terms["height"][0] < 1e-12
        assert terms["height"][1] > 0.3
        assert terms["off centre"][2] > terms["off centre"][0] == 0


def test_a_pole_on_a_cart_is_swung_up() -> None:
    rewards, env = played("cartpole", "swingup", 1000, 200, samples=16)
    assert rewards[-20:].mean() > 0.7
    assert env.physics.pole_angle_cosine()[0] > 0.9


def _links(shoulder: float, elbow: float, speed: float = 0.0) -> Any:
    def plant(physics: Any) -> None:
        physics.named.data.qpos[["shoulder", "elbow"]] = shoulder, elbow
        physics.named.data.qvel[["shoulder", "elbow"]] = speed, 0.0

    return plant


def test_an_acrobot_lacks_the_energy_that_takes_it_to_the_top() -> None:
    # Turning about the shoulder, both links have a moment of inertia of 8/3 kg m2; they rise 4 m.
    rising = np.sqrt(2 * 4 * 9.81 / (8 / 3))
    states = [_links(np.pi, 0.0), _links(np.pi, 0.0, rising), _links(0.0, 0.0)]
    terms = terms_of("acrobot", "swingup", *states)
    np.testing.assert_allclose(terms["energy"], [4.0, 0.0, 0.0], atol=0.1)
    assert terms["distance"][0] > 100 * terms["distance"][2]


def test_an_acrobot_gains_energy() -> None:
    _, env = played("acrobot", "swingup", 1000, 120, samples=24)
    assert env.physics.vertical().sum() > 0
