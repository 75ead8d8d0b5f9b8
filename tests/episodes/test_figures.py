"""Returns and statistics: their values, and their bits whoever adds them up."""

import dataclasses
import json

import numpy as np
import pytest

from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.figures import Figures
from limberjack.episodes.recipe import Recipe

from .collected import ARM, EVERYTHING, made


def _of(recipe: Recipe, episodes: list[Episode]) -> Figures:
    figures = Figures(recipe)
    for episode in episodes:
        figures.add(episode)
    return figures


@pytest.mark.parametrize("kept", [Kept(), EVERYTHING])
def test_the_statistics_are_those_of_all_rows(kept: Kept) -> None:
    recipe, episodes = made(ARM, range(5), kept)
    first, rest = _of(recipe, episodes[:2]), _of(recipe, episodes[2:])
    first.include(rest)
    assert first.returns == [episode.total for episode in episodes]
    found = first.statistics()
    assert set(found) == {c.name for c in recipe.columns if c.has_figures}
    name = next(iter(episodes[0].observations))
    rows = {
        f"observation/{name}": np.concatenate([e.observations[name] for e in episodes]),
        "action": np.concatenate([e.actions for e in episodes]),
        "reward": np.concatenate([e.rewards for e in episodes]),
    }
    for column, values in rows.items():
        values = values.reshape(len(values), -1).astype(float)
        of = found[column]
        # Sums in another order than NumPy's.
        np.testing.assert_allclose(
            np.array(of["mean"]), values.mean(axis=0), rtol=1e-12, atol=1e-14
        )
        np.testing.assert_allclose(np.array(of["std"]), values.std(axis=0), rtol=1e-9, atol=1e-12)
        assert of["min"] == values.min(axis=0).tolist()
        assert of["max"] == values.max(axis=0).tolist()


def test_a_text_gives_the_same_figures() -> None:
    recipe, episodes = made(ARM, range(3))
    text = _of(recipe, episodes).text()
    found = Figures.parse(text, recipe, 3)
    assert found.text() == text
    with pytest.raises(ValueError, match="its figures are damaged: 3 numbers; expected 4"):
        Figures.parse(text, recipe, 4)


def test_the_memory_layout_of_an_episode_changes_no_bit() -> None:
    recipe, (episode,) = made(ARM, range(1))
    wide = np.zeros((len(episode.actions), 2 * episode.actions.shape[1]))
    wide[:, ::2] = episode.actions
    other = dataclasses.replace(episode, actions=wide[:, ::2])
    assert _of(recipe, [other]).text() == _of(recipe, [episode]).text()


def test_numbers_that_json_lacks_are_null() -> None:
    recipe, (episode,) = made(ARM, range(1))
    rewards = episode.rewards.copy()
    rewards[2], actions = np.nan, episode.actions.copy()
    actions[0, 0] = 1e300
    figures = _of(recipe, [dataclasses.replace(episode, rewards=rewards, actions=actions)])
    statistics = json.loads(json.dumps(figures.statistics(), allow_nan=False))
    assert statistics["reward"] == {name: [None] for name in ("mean", "std", "min", "max")}
    assert statistics["action"]["std"][0] is None
    assert figures.returns_listed() == [None]
    again = Figures.parse(figures.text(), recipe, 1)
    assert again.text() == figures.text()


@pytest.mark.parametrize("count", ["0", "-1", "1e400", str(2**70), '"many"'])
def test_a_forged_number_of_rows_is_refused(count: str) -> None:
    recipe, episodes = made(ARM, range(1))
    text = _of(recipe, episodes).text().replace('"count":5', f'"count":{count}')
    with pytest.raises(ValueError, match="its figures are"):
        Figures.parse(text, recipe, 1)
