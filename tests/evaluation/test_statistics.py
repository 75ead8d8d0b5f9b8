"""Statistics of runs on a set of tasks: interquartile mean, stratified bootstrap, percentiles."""

from typing import Any

import numpy as np
import pytest

from limberjack.evaluation.statistics import (
    PERCENTILES,
    interquartile_mean,
    percentiles,
    stratified_interval,
)

# By (runs, tasks, seed). Computed by rliable 1.2.0 with arch 7.2.0, SciPy 1.17.1 and NumPy 2.4.6:
# `metrics.aggregate_iqm`, and `library.get_interval_estimates` of it after `numpy.random.seed(0)`,
# which draws the same resamples.
_RLIABLE = {
    (3, 28, 1): (0.7122962172543064, 0.6685661966734244, 0.7554971817462405),
    (10, 28, 2): (0.6971664262688754, 0.6618841727703597, 0.7310020290346187),
    (5, 7, 3): (0.692624730940804, 0.6104642891859383, 0.7644351618417982),
    (4, 3, 4): (0.596518914456278, 0.4360224408183191, 0.7209968945885832),
    (2, 1, 5): (0.5263749498002516, 0.47871363017094287, 0.5740362694295603),
}


def _scores(runs: int, tasks: int, seed: int) -> np.ndarray:
    return np.random.RandomState(seed).beta(2, 1, size=(runs, tasks))


@pytest.mark.parametrize("case", _RLIABLE)
def test_mean_and_interval_are_those_of_rliable(case: tuple[int, int, int]) -> None:
    scores = _scores(*case)
    mean, low, high = _RLIABLE[case]
    # The order of additions differs.
    assert float(interquartile_mean(scores)) == pytest.approx(mean, rel=1e-14)
    assert stratified_interval(scores) == pytest.approx((low, high), rel=1e-14)


def test_a_quarter_at_each_end_does_not_count() -> None:
    scores = np.array([[-1e9, 0.2], [0.4, 1e9]])
    assert interquartile_mean(scores) == pytest.approx(0.3)
    # Of seven scores one at each end is left out, not one and three quarters.
    assert interquartile_mean(np.array([[9.0, 1, 2, 3, 4, 5, 0]])) == 3
    assert interquartile_mean(np.array([[1.0, 3.0, 8.0]])) == 4


def test_leading_axes_stay() -> None:
    scores = np.random.RandomState(0).uniform(size=(2, 5, 4, 3))
    means = interquartile_mean(scores)
    assert means.shape == (2, 5)
    assert means[1, 2] == interquartile_mean(scores[1, 2])


def test_a_task_on_which_all_runs_agree_adds_no_width() -> None:
    scores = np.tile(np.arange(8.0), (3, 1))  # tasks differ, runs do not
    low, high = stratified_interval(scores, resamples=100) or (0, 0)
    assert low == high == interquartile_mean(scores)


def test_one_run_has_no_interval() -> None:
    assert stratified_interval(np.ones((1, 28))) is None


def test_percentiles_are_those_of_the_means_of_runs() -> None:
    scores = np.array([[0.0, 0.2], [0.3, 0.3], [1.0, 0.0]])
    found = percentiles(scores)
    assert tuple(found) == PERCENTILES
    assert found[50] == pytest.approx(0.3)
    assert found[25] == pytest.approx(0.2)


def test_scores_that_are_no_matrix_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(3,\); expected \(runs, tasks\)"):
        stratified_interval(np.ones(3))
    for statistic in (interquartile_mean, percentiles):
        with pytest.raises(ValueError, match=r"shape \(0, 4\); expected at least one run"):
            statistic(np.ones((0, 4)))


@pytest.mark.parametrize("scores", [[[1.0, 2.0], [3.0]], [[1.0, None]], [["a", "b"]]])
def test_lists_that_are_no_matrix_of_numbers_are_refused(scores: Any) -> None:
    for statistic in (interquartile_mean, stratified_interval, percentiles):
        with pytest.raises(ValueError, match=r"not numbers in lists of equal length; expected \("):
            statistic(scores)


def test_a_missing_score_is_refused_by_its_place() -> None:
    scores = np.ones((2, 3))
    scores[1, 2] = np.nan
    # A sort puts it last, among the scores that do not count.
    for statistic in (interquartile_mean, percentiles, stratified_interval):
        with pytest.raises(ValueError, match="run 1 on task 2 is nan; leave out tasks"):
            statistic(scores)


def test_lists_are_scores_too() -> None:
    scores = [[1.0, 2.0], [3.0, 4.0]]
    assert interquartile_mean(scores) == 2.5  # pyright: ignore[reportArgumentType]
    assert percentiles(scores)[50] == 2.5  # pyright: ignore[reportArgumentType]
    assert stratified_interval(scores) == (1.5, 3.5)  # pyright: ignore[reportArgumentType]
