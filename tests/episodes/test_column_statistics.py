"""The statistics of columns are those of all values, computed an episode at a time."""

import json

import numpy as np
import pytest

from limberjack.data import Dataset, Spread
from limberjack.episodes import column_statistics
from limberjack.episodes.column_statistics import QUANTILES, statistics_of

from .collected import folder_of


def _all(dataset: Dataset, name: str) -> np.ndarray:
    if name in ("actions", "rewards"):
        return np.concatenate([getattr(episode, name) for episode in dataset])
    return np.concatenate([episode.observations[name] for episode in dataset])


def _spreads(dataset: Dataset) -> dict[str, Spread]:
    found = dataset.statistics()
    return {**found.observations, "actions": found.actions, "rewards": found.rewards}


def test_statistics_are_those_of_all_values(arms: Dataset) -> None:
    spreads = _spreads(arms)
    assert set(spreads) == {*arms[0].observations, "actions", "rewards"}
    for name, spread in spreads.items():
        values = _all(arms, name)
        assert spread.count == len(values)
        # They are merged from sums of episodes.
        np.testing.assert_allclose(spread.mean, values.mean(axis=0), rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(spread.std, values.std(axis=0), rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(spread.min, values.min(axis=0))
        np.testing.assert_array_equal(spread.max, values.max(axis=0))
        assert tuple(spread.quantiles) == QUANTILES
        for probability, found in spread.quantiles.items():
            np.testing.assert_array_equal(found, np.quantile(values, probability, axis=0))


def test_statistics_of_a_dataset_have_the_bits_of_its_manifest(pendulums: Dataset) -> None:
    folder = folder_of(pendulums)
    listed = json.loads((folder / "dataset.json").read_text())["statistics"]
    found = pendulums.statistics()
    for name, spread in found.observations.items():
        for key, numbers in listed[f"observation/{name}"].items():
            assert getattr(spread, key).ravel().tolist() == numbers, (name, key)
    for name, spread in (("action", found.actions), ("reward", found.rewards)):
        for key, numbers in listed[name].items():
            assert getattr(spread, key).ravel().tolist() == numbers, (name, key)


def test_quantiles_of_many_values_are_those_of_a_sample(
    pendulums: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(column_statistics, "_MOST_ROWS", 400)

    def sampled() -> Spread:
        return statistics_of([pendulums], pendulums.recipe, pendulums.lengths).actions

    exact, found, again = pendulums.statistics().actions, sampled(), sampled()
    actions = _all(pendulums, "actions")
    chosen = np.random.default_rng(0).choice(len(actions), 400, replace=False)
    for probability in QUANTILES:
        expected = np.quantile(actions[chosen], probability, axis=0)
        np.testing.assert_array_equal(found.quantiles[probability], expected)
        np.testing.assert_array_equal(again.quantiles[probability], expected)
    np.testing.assert_array_equal(found.max, exact.max)
    assert found.count == 700
