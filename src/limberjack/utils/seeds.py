"""`checked_seed`, `checked_seeds`: validation of seeds for `numpy.random.RandomState`.

seed = checked_seed(7)
seeds = checked_seeds(range(100))     # of episodes, which increase
"""

import itertools
import operator
from collections.abc import Iterable
from typing import SupportsIndex

__all__ = ["SEEDS", "checked_seed", "checked_seeds"]

SEEDS = 2**32  # numpy.random.RandomState accepts seeds below this


def checked_seed(seed: object) -> int:
    """The seed as an int.

    Raises:
      TypeError: the seed is not an integer; bool is not accepted.
      ValueError: the seed is not between 0 and 2**32 - 1.
    """
    try:
        if isinstance(seed, bool) or not isinstance(seed, SupportsIndex):
            raise TypeError
        number = operator.index(seed)
    except TypeError:
        raise TypeError(f"seed is {seed!r}; expected a whole number") from None
    if not 0 <= number < SEEDS:
        raise ValueError(f"seed is {number}; expected a whole number from 0 to 2**32 - 1")
    return number


def checked_seeds(seeds: Iterable[object]) -> list[int]:
    """The seeds of episodes as ints.

    Raises:
      TypeError: one is not an integer.
      ValueError: there are none, one is out of range, or they are not increasing.
    """
    checked = [checked_seed(seed) for seed in seeds]
    if not checked:
        raise ValueError("there are no seeds; expected at least one, such as range(100)")
    for one, following in itertools.pairwise(checked):
        if following <= one:
            raise ValueError(f"seed {following} follows {one}; expected increasing seeds")
    return checked
