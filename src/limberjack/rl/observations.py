"""The form of what a task observes: flat or by name, of one simulation or of many; its specs.

    flatten_observation({"angle": angle, "speed": speed})     # {"observations": (n,)}

`control` and `batch` observe with it. Pictures come on top, from `pixels`.
"""

import collections
from collections.abc import Mapping, MutableMapping
from typing import Any

import numpy as np
from dm_env import specs

from limberjack.utils import arrays

__all__ = ["FLAT_OBSERVATION_KEY", "flatten_observation", "of_rows", "specs_of"]

FLAT_OBSERVATION_KEY = "observations"


def flatten_observation(
    observation: MutableMapping[str, Any], output_key: str = FLAT_OBSERVATION_KEY
) -> MutableMapping[str, np.ndarray]:
    """Joins all observations into one flat array.

    Args:
      observation: mapping from names to arrays.
      output_key: name of the flat array.

    Returns:
      A mapping of the same type with one item. The order is that of an `OrderedDict`, and
      alphabetical for other mappings.

    Raises:
      ValueError: `observation` is not a mutable mapping.
    """
    if not isinstance(observation, MutableMapping):
        raise ValueError(
            f"Can only flatten dict-like observations, got {type(observation).__name__}."
        )
    flat = np.concatenate([observation[name].ravel() for name in _names(observation)])
    # The same type of mapping, whatever it is: its constructor takes pairs.
    make: Any = type(observation)
    return make([(output_key, flat)])


def of_rows(observation: Any, num_envs: int, flat: bool) -> Any:
    """A batch's observation in arrays of its own, (num_envs, ...) each, that nothing changes later.

    Args:
      observation: what the task gave, a mapping of arrays, which may be views; it is changed.
      num_envs: number of rows.
      flat: join each row's observations into one flat array, as `flatten_observation`.
    """
    if flat:
        parts = [observation[name].reshape(num_envs, -1) for name in _names(observation)]
        return type(observation)([(FLAT_OBSERVATION_KEY, arrays.concat(parts))])
    for name, value in observation.items():
        if not value.flags.owndata:
            observation[name] = value.copy()
    return observation


def specs_of(observation: Mapping[str, Any]) -> collections.OrderedDict:
    """Shapes and dtypes of an observation, by name."""
    return collections.OrderedDict(
        (name, specs.Array(value.shape, value.dtype, name=name))
        for name, value in observation.items()
    )


def _names(observation: Mapping[str, Any]) -> list[str]:
    """The names in the order of the flat array."""
    ordered = isinstance(observation, collections.OrderedDict)
    return list(observation) if ordered else sorted(observation)
