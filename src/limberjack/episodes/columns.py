"""`columns_of` and `episode_of`: an episode as the columns of a file, and back.

    values = columns_of(episode, recipe)        # {"seed": (T + 1,), "action": (T + 1, nu), ...}
    episode = episode_of(values, seed)

A row is a step: the observation before it, the action, and what followed. The last row has the last
observation, NaN as action and reward, and no flag. A model field, `field/...`, and the kind of
start belong to the episode, not to a row. The file format itself is in `parquet`.
"""

from collections.abc import Mapping

import numpy as np

from limberjack.episodes.episode import Episode
from limberjack.episodes.recipe import FIELD, OBSERVATION, Recipe

__all__ = ["Values", "columns_of", "episode_of"]

Values = np.ndarray | str  # of a column in an episode; the only text is the kind of start


def columns_of(episode: Episode, recipe: Recipe) -> dict[str, Values]:
    """The values of each of the recipe's columns."""
    return {column.name: _values(episode, column.name) for column in recipe.columns}


def _values(episode: Episode, name: str) -> Values:
    if name.startswith(OBSERVATION):
        return episode.observations[name.removeprefix(OBSERVATION)]
    if name.startswith(FIELD):
        return episode.fields[name.removeprefix(FIELD)]
    match name:
        case "seed":
            return np.full(episode.length + 1, episode.seed)
        case "start":
            found = episode.start
        case "state":
            found = episode.states
        case "action":
            found = _with_last(episode.actions, np.nan)
        case "reward":
            found = _with_last(episode.rewards, np.nan)
        case "diverged":
            found = np.zeros(episode.length + 1, bool)
            found[-2] = episode.diverged
        case _:
            flags = {"terminated": episode.terminated, "truncated": episode.truncated}
            success = episode.success
            if success is None:  # it diverged before a step had terms of the reward
                success = np.zeros(episode.length, bool)
            found = flags.get(name, success)
            found = None if found is None else _with_last(found, False)
    assert found is not None, name
    return found


def _with_last(values: np.ndarray, last: float) -> np.ndarray:
    return np.concatenate([values, np.full((1, *values.shape[1:]), last, values.dtype)])


def episode_of(values: Mapping[str, Values], seed: int) -> Episode:
    """The episode of a seed, in views of the columns' values.

    Raises:
      ValueError: the values are not those of one whole episode with this seed.
    """
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    ends = arrays["terminated"] | arrays["truncated"]
    if ends[-1] or not ends[-2] or ends[:-2].any():
        raise ValueError(f"the episode of seed {seed} does not end with its last step")
    if (arrays["seed"] != seed).any():
        raise ValueError(f"the episode of seed {seed} has rows of seed {arrays['seed'].tolist()}")
    start = values.get("start")
    success = arrays.get("success")
    return Episode(
        seed,
        start if isinstance(start, str) else None,
        arrays["reward"][:-1],
        bool(arrays["diverged"].any()),
        actions=arrays["action"][:-1],
        terminated=arrays["terminated"][:-1],
        truncated=arrays["truncated"][:-1],
        success=None if success is None else success[:-1],
        observations=_part(arrays, OBSERVATION),
        states=arrays.get("state"),
        fields=_part(arrays, FIELD),
    )


def _part(arrays: Mapping[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """The arrays whose names begin so, by the rest of their names."""
    return {n.removeprefix(prefix): v for n, v in arrays.items() if n.startswith(prefix)}
