"""Statistics of many scores."""

import json

import numpy as np
import pytest

from limberjack.episodes import statistics
from limberjack.episodes.episode import Episode
from limberjack.episodes.statistics import Score, bootstrap_interval, strata, summarise


def _scores(*totals: float, **kwargs: object) -> list[Score]:
    return [Score(seed, total, 1000, 0.0, **kwargs) for seed, total in enumerate(totals)]  # pyright: ignore[reportArgumentType]


def test_a_summary_has_mean_median_and_successes() -> None:
    scores = [Score(0, 10.0, 1000, 0.9), Score(1, 20.0, 1000, 0.89), Score(2, 90.0, 1000, 1.0)]
    summary = summarise(scores)
    assert (summary.episodes, summary.mean, summary.median) == (3, 40.0, 20.0)
    assert summary.successes == 2
    assert summary.success_rate == 2 / 3


def test_the_median_of_an_even_number_lies_between_the_middle_two() -> None:
    assert summarise(_scores(1.0, 2.0, 40.0, 50.0)).median == 21.0


def test_a_mean_reward_of_exactly_nine_tenths_is_a_success() -> None:
    assert Score(0, 900.0, 1000, 0.9).success
    assert not Score(0, 900.0, 1000, np.nextafter(0.9, 0)).success


def _score(rewards: np.ndarray) -> Score:
    return Score.of(Episode(0, None, rewards))


def test_success_is_decided_by_the_last_hundred_steps() -> None:
    late = np.concatenate([np.zeros(900), np.full(100, 0.9)])
    assert _score(late).success
    assert not _score(late[::-1]).success
    assert not _score(np.concatenate([late[:-1], [0.89]])).success
    assert _score(np.full(10, 0.95)).success  # shorter: all of it counts


def test_a_return_is_added_in_order_as_a_loop_would() -> None:
    rewards = np.random.RandomState(0).uniform(size=1000)
    total = 0.0
    for reward in rewards.tolist():
        total += reward
    assert _score(rewards).total == total


def test_a_diverged_episode_is_no_success_whatever_it_earned() -> None:
    score = Score.of(Episode(3, None, np.full(991, 1.0), diverged=True))
    assert score.total == 991.0
    assert score.diverged
    assert not score.success
    assert summarise([score]).diverged == 1


def test_strata_are_the_summaries_of_each_kind_of_start() -> None:
    low, high = _scores(1.0, 3.0, start="level_0"), _scores(7.0, start="level_1")
    assert strata([*high, *low]) == {"level_0": summarise(low), "level_1": summarise(high)}
    assert strata(_scores(1.0, 2.0)) == {}


def test_the_interval_is_the_same_every_time_and_holds_the_mean() -> None:
    values = np.random.RandomState(1).standard_normal(50)
    low, high = bootstrap_interval(values) or (0, 0)
    assert (low, high) == bootstrap_interval(values)
    assert low < values.mean() < high
    # That of the normal distribution, within what 10,000 resamples of 50 values tell.
    width = 2 * 1.96 * values.std() / np.sqrt(50)
    assert high - low == pytest.approx(width, rel=0.05)


def test_the_interval_holds_the_true_mean_nineteen_times_in_twenty() -> None:
    draws = np.random.RandomState(2).uniform(size=(150, 40))
    intervals = [bootstrap_interval(values) or (0, 0) for values in draws]
    held = np.mean([low <= 0.5 <= high for low, high in intervals])
    assert held == pytest.approx(0.95, abs=0.06)  # three standard errors of 150 trials


def test_the_interval_cuts_off_two_and_a_half_percent_of_the_resamples_at_either_end() -> None:
    values = np.array([0.0] * 5 + [1.0] * 5)
    low, high = bootstrap_interval(values) or (0, 0)
    # Means of ten draws are binomial: 1 % of them are 0.1 or less, 5.5 % are 0.2 or less.
    assert (low, high) == (0.2, 0.8)


def test_the_interval_is_the_same_in_one_piece_and_in_many(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.RandomState(3).uniform(size=37)
    in_pieces = []
    for size in (1_000, 10**9):
        monkeypatch.setattr(statistics, "_CHUNK", size)
        in_pieces.append(bootstrap_interval(values))
    assert in_pieces[0] == in_pieces[1]


def test_a_single_episode_has_no_interval() -> None:
    assert bootstrap_interval(np.array([5.0])) is None
    assert summarise(_scores(5.0)).interval is None


def test_equal_returns_have_an_interval_of_no_width() -> None:
    assert bootstrap_interval(np.full(20, 4.0)) == (4.0, 4.0)


def test_returns_that_are_not_finite_are_null_in_json() -> None:
    for undefined in (np.nan, np.inf):
        numbers = summarise(_scores(1.0, undefined, undefined)).as_json()
        json.dumps(numbers, allow_nan=False)
        assert (numbers["mean"], numbers["median"]) == (None, None)
        assert numbers["episodes"] == 3


def test_rewards_and_returns_that_sum_up_to_infinity_raise_no_warning() -> None:
    score = _score(np.full(3, 1e308))
    assert (score.total, score.final_reward) == (np.inf, np.inf)
    assert summarise(_scores(1e308, 1e308)).mean == np.inf


def test_returns_that_are_infinite_have_no_mean_and_raise_no_warning() -> None:
    summary = summarise(_scores(np.inf, -np.inf))
    assert np.isnan(summary.mean)
    assert summary.as_json()["mean"] is None
