"""Samples of plans, and the noise that makes them."""

from typing import Any

import numpy as np
import pytest

from limberjack.planner import ICEM, MPPI
from limberjack.planner.optimisers.base import Optimiser, Search, coloured_noise

KNOTS, ACTUATORS = 6, 2


def search(**changes: Any) -> Search:
    """A search around zeros whose targets end at 1."""
    given: dict[str, Any] = {
        "current": np.zeros((KNOTS, ACTUATORS)),
        "proposals": np.zeros((0, KNOTS, ACTUATORS)),
        "elites": np.zeros((0, KNOTS, ACTUATORS)),
        "scale": np.array([1.0, 0.1]),
        "noise": 0.5,
        "within_limits": lambda targets: np.clip(targets, -1.0, 1.0),
        "random": np.random.default_rng(0),
    }
    return Search(**{**given, **changes})


def plans(*values: float) -> np.ndarray:
    """Plans that hold a value, (n, knots, nu)."""
    return np.array(values)[:, None, None] * np.ones((KNOTS, ACTUATORS))


@pytest.mark.parametrize("optimiser", [MPPI(), ICEM()])
def test_the_current_plan_comes_first_then_what_is_known_then_variations(
    optimiser: Optimiser,
) -> None:
    samples = optimiser.samples(
        search(current=plans(0.2)[0], proposals=plans(0.5, 3.0, 0.7)), 40, 0
    )
    assert samples.shape == (40, KNOTS, ACTUATORS)
    np.testing.assert_array_equal(samples[:4], plans(0.2, 0.5, 1.0, 0.7))
    varied = samples[4:] - 0.2
    assert (np.abs(varied).max(axis=(1, 2)) > 0).all()
    assert np.abs(samples).max() <= 1.0
    # Noise has each target's unit.
    assert 5 < varied[..., 0].std() / varied[..., 1].std() < 20


def test_known_plans_take_half_of_the_samples_at_most() -> None:
    samples = MPPI().samples(search(proposals=plans(*[0.9] * 30)), 20, 0)
    assert (samples[1:11] == 0.9).all()
    assert (samples[11:] != 0.9).all()


def test_proposals_are_tried_in_the_first_iteration_only() -> None:
    at = search(proposals=plans(0.9))
    assert (MPPI().samples(at, 4, 0)[1] == 0.9).all()
    assert (MPPI().samples(at, 4, 1)[1] != 0.9).all()


def test_the_finest_samples_hardly_move() -> None:
    varied = MPPI(finest=0.001).samples(search(), 400, 0)[1:, :, 0].std(axis=-1)
    assert varied.min() < 0.01 < 0.2 < varied.max()
    alike = MPPI(finest=1.0).samples(search(), 400, 0)[1:, :, 0]
    # 0.5, cut at 1; of 2,400 samples it deviates by 0.007.
    assert alike.std() == pytest.approx(0.46, abs=0.02)


@pytest.mark.parametrize("optimiser", [MPPI(iterations=4), ICEM(iterations=4)])
def test_iterations_share_the_samples_and_lower_the_cost(optimiser: Optimiser) -> None:
    counts, best = [], []

    def costs_of(samples: np.ndarray) -> np.ndarray:
        counts.append(len(samples))
        costs = ((samples[..., 0] - 0.4) ** 2).sum(axis=-1)
        best.append(costs.min())
        return costs

    plan = optimiser.optimise(search(), 80, costs_of)
    assert counts == [20] * 4
    assert best[-1] < 0.5 * best[0]
    assert ((plan[:, 0] - 0.4) ** 2).sum() < 6 * 0.4**2 / 3


def test_white_noise_is_that_of_the_stream() -> None:
    noise = coloured_noise(np.random.default_rng(1), (3, 4, 5), 0.0)
    np.testing.assert_array_equal(noise, np.random.default_rng(1).standard_normal((3, 4, 5)))


@pytest.mark.parametrize("knots", [2, 5, 16])
@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.5])
def test_coloured_noise_has_variance_one_and_smooth_plans(knots: int, exponent: float) -> None:
    noise = coloured_noise(np.random.default_rng(2), (20_000, knots, 1), exponent)[..., 0]
    # The deviation of 20,000 samples itself deviates by 1 / sqrt(40,000) = 0.005.
    np.testing.assert_allclose(noise.std(axis=0), 1.0, atol=0.03)
    neighbours = (noise[:, 1:] * noise[:, :-1]).mean()
    assert neighbours > 0.1
    rougher = coloured_noise(np.random.default_rng(2), (20_000, knots, 1), exponent / 2)[..., 0]
    assert neighbours > (rougher[:, 1:] * rougher[:, :-1]).mean() + 0.05
    # It does not end as it begins: ends are further from each other than neighbours.
    if knots > 2:
        assert (noise[:, 0] * noise[:, -1]).mean() < neighbours - 0.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"iterations": 0}, "iterations is 0; expected a whole number from 1"),
        ({"iterations": 1.5}, "iterations is 1.5"),
        ({"finest": 2.0}, "finest is 2.0; expected a fraction from above 0 up to 1"),
        ({"colour": -1.0}, "colour is -1.0; expected a number from 0 up"),
    ],
)
def test_an_option_that_cannot_be_is_named(options: dict[str, Any], message: str) -> None:
    for kind in (MPPI, ICEM):
        with pytest.raises(ValueError, match=message):
            kind(**options)
