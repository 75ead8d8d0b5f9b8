"""Observations: flat or by name, of a single simulation or of a batch, and their specs.

    flatten_observation({"angle": angle, "speed": speed})     # {"observations": (n,)}

Used by `control` and `batch`. Pixel observations are added by `pixels`.
"""

import collections
from collections.abc import MutableMapping
from typing import Any, cast

import numpy as np
from dm_env import specs

from limberjack.rl.contract import Observation
from limberjack.utils import arrays

__all__ = ["FLAT_OBSERVATION_KEY", "flatten_observation", "of_rows", "specs_of"]

FLAT_OBSERVATION_KEY = "observations"


def flatten_observation(
    observation: Observation, output_key: str = FLAT_OBSERVATION_KEY
) -> MutableMapping[str, np.ndarray]:
    """Joins all observations into one flat array.

    Args:
      observation: mapping from names to arrays.
      output_key: name of the flat array.

    Returns:
      A mapping of the same type with one item. Arrays are joined in the order of an `OrderedDict`,
      and alphabetically by name for other mappings.

    Raises:
      ValueError: `observation` is not a mutable mapping.
    """
    if not isinstance(observation, MutableMapping):
        raise ValueError(
            f"Can only flatten dict-like observations, got {type(observation).__name__}."
        )
    flat = np.concatenate([np.ravel(observation[name]) for name in _names(observation)])
    return _same_type(observation, flat, output_key)


def of_rows(observation: Observation, num_envs: int, flat: bool) -> MutableMapping[str, np.ndarray]:
    """A batch's observation in arrays that own their memory, (num_envs, ...) each.

    Args:
      observation: the task's observation, whose arrays may be views; modified in place.
      num_envs: number of rows.
      flat: join each row's observations into one flat array, as `flatten_observation` does.
    """
    given = cast(MutableMapping[str, np.ndarray], observation)
    if flat:
        parts = [given[name].reshape(num_envs, -1) for name in _names(given)]
        return _same_type(given, arrays.concat(parts), FLAT_OBSERVATION_KEY)
    for name, value in given.items():
        if not value.flags.owndata:
            given[name] = value.copy()
    return given


def specs_of(observation: Observation) -> collections.OrderedDict[str, specs.Array]:
    """Shapes and dtypes of an observation, by name."""
    return collections.OrderedDict(
        (name, specs.Array(np.shape(value), np.asarray(value).dtype, name=name))
        for name, value in observation.items()
    )


def _names(observation: Observation) -> list[str]:
    """The names in the order of the flat array."""
    ordered = isinstance(observation, collections.OrderedDict)
    return list(observation) if ordered else sorted(observation)


def _same_type(like: Observation, flat: np.ndarray, key: str) -> MutableMapping[str, np.ndarray]:
    """A mapping of one item, of the same type as another."""
    make: Any = type(like)  # a mapping type whose constructor accepts pairs
    return make([(key, flat)])
