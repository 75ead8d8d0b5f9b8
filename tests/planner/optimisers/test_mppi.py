"""The weighted mean of samples."""

import numpy as np
import pytest

from limberjack.planner import MPPI

from .test_base import plans, search


def test_the_best_samples_weigh_most_on_the_scale_of_the_best_eighth() -> None:
    samples = plans(*np.arange(16.0))
    costs = np.append([0.0, 1.0, 2.0], np.full(13, 1e9))  # an eighth of 16: up to a cost of 2
    plan = MPPI(temperature=0.5).new_plan(search(), samples, costs, 0)
    weights = np.exp([0.0, -1.0, -2.0])
    # The weights are divided before they are summed: default tolerances.
    np.testing.assert_allclose(plan, (weights @ [0.0, 1.0, 2.0]) / weights.sum())
    sharp = MPPI(temperature=0.01).new_plan(search(), samples, costs, 0)
    # The next best plan has the weight exp(-50), 2e-22.
    np.testing.assert_allclose(sharp, 0.0, atol=1e-12)


@pytest.mark.parametrize("costs", [[np.inf] * 4, [2.0] * 4, [2.0, np.inf, np.inf, np.inf]])
def test_without_differences_the_first_of_the_best_is_the_plan(costs: list[float]) -> None:
    plan = MPPI().new_plan(search(), plans(0.1, 0.2, 0.3, 0.4), np.array(costs), 0)
    np.testing.assert_array_equal(plan, plans(0.1)[0])


@pytest.mark.parametrize("temperature", [0.0, -1.0, float("nan")])
def test_a_temperature_is_positive(temperature: float) -> None:
    with pytest.raises(ValueError, match=r"temperature is .*; expected a positive number"):
        MPPI(temperature=temperature)
