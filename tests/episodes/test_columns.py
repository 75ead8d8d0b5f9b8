"""Episodes as columns, and back."""

import numpy as np
import pytest

from limberjack.episodes.columns import columns_of, episode_of
from limberjack.episodes.episode import Kept

from .collected import ARM, EVERYTHING, PENDULUM, assert_equal, made


@pytest.mark.parametrize("where", [PENDULUM, ARM])
@pytest.mark.parametrize("kept", [Kept(), EVERYTHING])
def test_the_columns_of_an_episode_give_the_episode(
    where: tuple[str, str, float], kept: Kept
) -> None:
    recipe, (episode,) = made(where, range(7, 8), kept)
    values = columns_of(episode, recipe)
    assert list(values) == [column.name for column in recipe.columns]
    assert_equal(episode_of(values, 7), episode)


def test_the_last_row_has_an_observation_and_nothing_else() -> None:
    recipe, (episode,) = made(PENDULUM, range(1))
    values = columns_of(episode, recipe)
    last = {name: np.asarray(value)[-1] for name, value in values.items()}
    assert np.isfinite(last["observation/velocity"])
    assert np.isnan(last["action"]).all()
    assert np.isnan(last["reward"])
    assert not any(last[name] for name in ("terminated", "truncated", "success", "diverged"))


@pytest.mark.parametrize(
    ("row", "value", "message"),
    [
        (-1, True, "seed 0 does not end with its last step"),
        (-2, False, "seed 0 does not end with its last step"),
        (3, True, "seed 0 does not end with its last step"),
    ],
)
def test_an_episode_that_ends_elsewhere_is_refused(row: int, value: bool, message: str) -> None:
    recipe, (episode,) = made(PENDULUM, range(1))
    values = columns_of(episode, recipe)
    truncated = np.array(values["truncated"])
    truncated[row] = value
    with pytest.raises(ValueError, match=message):
        episode_of({**values, "truncated": truncated}, 0)


def test_rows_of_another_seed_are_refused() -> None:
    recipe, (episode,) = made(PENDULUM, range(1))
    with pytest.raises(ValueError, match="episode of seed 1 has rows of seed"):
        episode_of(columns_of(episode, recipe), 1)
