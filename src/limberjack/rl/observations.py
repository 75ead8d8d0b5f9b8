"""Observations: flat or by name, of a single simulation or of a batch, and their specs.

    flatten_observation({"angle": angle, "speed": speed})     # {"observations": (n,)}

Used by `control` and `batch`. Pixel observations are added by `pixels`.
"""

import collections
from collections.abc import Iterable, Mapping, MutableMapping
from typing import Any, TypeVar, cast

import numpy as np
from dm_env import specs

from limberjack.rl.contract import Observation
from limberjack.utils import arrays

__all__ = [
    "FLAT_OBSERVATION_KEY",
    "flat_order",
    "flatten_observation",
    "of_rows",
    "of_type",
    "specs_of",
]

FLAT_OBSERVATION_KEY = "observations"

_V = TypeVar("_V")


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
    flat = np.concatenate([np.ravel(observation[name]) for name in flat_order(observation)])
    return of_type(observation, [(output_key, flat)])


def of_rows(observation: Observation, num_envs: int, flat: bool) -> MutableMapping[str, np.ndarray]:
    """A batch's observation in arrays that own their memory, (num_envs, ...) each.

    Args:
      observation: the task's observation, whose arrays may be views; modified in place.
      num_envs: number of rows.
      flat: join each row's observations into one flat array, as `flatten_observation` does.
    """
    given = cast(MutableMapping[str, np.ndarray], observation)
    if flat:
        parts = [given[name].reshape(num_envs, -1) for name in flat_order(given)]
        return of_type(given, [(FLAT_OBSERVATION_KEY, arrays.concat(parts))])
    for name, value in given.items():
        if not value.flags.owndata:
            given[name] = value.copy()
    return given


def specs_of(observation: Observation) -> collections.OrderedDict[str, specs.Array]:
    """Shapes and dtypes of an observation, by name.

    Raises:
      TypeError: it is not a mapping, or one of its values is nested.
    """
    if not isinstance(observation, Mapping):
        raise TypeError(
            f"get_observation returned {observation!r}; expected a mapping from names to arrays"
        )
    arrays_by_name = {name: np.asarray(value) for name, value in observation.items()}
    for name, array in arrays_by_name.items():
        if array.dtype == object:
            raise TypeError(
                f"observation {name!r} is a {type(observation[name]).__name__}; expected an array "
                "of numbers: give each part of it a name of its own, since observations are not "
                "nested"
            )
    return collections.OrderedDict(
        (name, specs.Array(array.shape, array.dtype, name=name))
        for name, array in arrays_by_name.items()
    )


def flat_order(observation: Observation) -> list[str]:
    """The names in the order of the flat array."""
    ordered = isinstance(observation, collections.OrderedDict)
    return list(observation) if ordered else sorted(observation)


def of_type(
    like: Mapping[str, object], contents: Mapping[str, _V] | Iterable[tuple[str, _V]]
) -> MutableMapping[str, _V]:
    """A new mapping of the same type as another, whose constructor accepts mappings and pairs."""
    make: Any = type(like)  # the type of a user's mapping
    return make(contents)
