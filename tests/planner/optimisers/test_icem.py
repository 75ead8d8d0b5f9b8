"""Elites, which move the mean and are tried again."""

import numpy as np
import pytest

from limberjack.planner import ICEM

from .test_base import plans, search

_SAMPLES = plans(0.9, 0.1, 0.3, 0.5, 0.7, 0.8, 0.8, 0.8)
_COSTS = np.array([9.0, 1.0, 2.0, 3.0, np.inf, 9.0, 9.0, 9.0])


def test_mean_and_deviation_move_to_those_of_the_elites() -> None:
    optimiser = ICEM(iterations=2, elites=0.25, momentum=0.2)
    at = search(current=plans(0.6)[0])
    plan = optimiser.new_plan(at, _SAMPLES, _COSTS, 0)
    # The expected sums are of decimals, and round: default tolerances, here and below.
    np.testing.assert_allclose(plan, 0.2 * 0.6 + 0.8 * 0.2)
    # Elites of 0.1 and 0.3 deviate by 0.1, in units of the noise: 0.5 and 0.05.
    np.testing.assert_allclose(at.deviation, 0.2 + 0.8 * np.tile([0.2, 2.0], (6, 1)))
    # After the last iteration the next planning step begins with all of the noise.
    optimiser.new_plan(at, _SAMPLES, _COSTS, 1)
    np.testing.assert_array_equal(at.deviation, 1.0)


def test_the_best_elites_are_kept_and_tried_before_proposals() -> None:
    optimiser = ICEM(elites=0.5, kept=0.5)
    at = search(proposals=plans(0.95))
    optimiser.new_plan(at, _SAMPLES, _COSTS, 0)
    np.testing.assert_array_equal(at.elites, plans(0.1, 0.3))
    samples = optimiser.samples(at, 16, 0)
    np.testing.assert_array_equal(samples[1:4], plans(0.1, 0.3, 0.95))
    np.testing.assert_array_equal(optimiser.samples(at, 16, 1)[1:3], plans(0.1, 0.3))
    assert (optimiser.samples(at, 16, 1)[3] != 0.95).all()


def test_a_deviation_narrows_the_samples() -> None:
    at = search(deviation=np.full((6, 2), 0.01))
    samples = ICEM().samples(at, 64, 1)
    assert 0.003 < samples[1:, :, 0].std() < 0.007


def test_the_best_sample_is_the_plan_on_request_after_the_last_iteration() -> None:
    optimiser = ICEM(iterations=2, takes_best=True)
    np.testing.assert_array_equal(optimiser.new_plan(search(), _SAMPLES, _COSTS, 1), plans(0.1)[0])
    assert (optimiser.new_plan(search(), _SAMPLES, _COSTS, 0) != 0.1).all()


def test_elites_are_finite_and_without_any_the_plan_stays() -> None:
    at = search(elites=plans(0.4))
    few = np.where(np.arange(8) == 5, 1.0, np.inf)
    plan = ICEM(elites=0.5, momentum=0.0).new_plan(at, _SAMPLES, few, 0)
    np.testing.assert_array_equal(plan, plans(0.8)[0])
    none = ICEM().new_plan(at, _SAMPLES, np.full(8, np.inf), 0)
    np.testing.assert_array_equal(none, plans(0.9)[0])
    assert len(at.elites) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"elites": 0.6}, "elites is 0.6; expected a share from 0 to 0.5"),
        ({"kept": -0.1}, "kept is -0.1; expected a share from 0 to 1"),
        ({"momentum": float("nan")}, "momentum is nan; expected a share from 0 to 1"),
    ],
)
def test_a_share_that_cannot_be_is_named(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ICEM(**options)  # pyright: ignore[reportArgumentType]
