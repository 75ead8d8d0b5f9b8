"""`checked_seed`, `checked_seeds`: validation of seeds for `numpy.random.RandomState`.

seed = checked_seed(7)
first = first_of_seeds(7, 256)        # of rows with seeds 7, 8, ...
seeds = checked_seeds(range(100))     # of episodes, which increase
"""

import itertools
import operator
from collections.abc import Iterable
from typing import SupportsIndex

__all__ = ["SEEDS", "checked_seed", "checked_seeds", "distinct_seeds", "first_of_seeds"]

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


def first_of_seeds(seed: object, count: int) -> int:
    """The seed of the first of several rows, whose seeds follow one another, as an int.

    Raises:
      TypeError, ValueError: see `checked_seed`; or a later row's seed is not below 2**32.
    """
    first = checked_seed(seed)
    if count > SEEDS:
        raise ValueError(f"there are {count} rows; expected at most 2**32, one for each seed")
    if first + count > SEEDS:
        raise ValueError(
            f"seed is {first}, and the last of {count} rows would have seed {first + count - 1}; "
            f"expected at most {SEEDS - count} for so many rows"
        )
    return first


def distinct_seeds(seeds: Iterable[object]) -> list[int]:
    """The seeds of episodes as ints, in any order.

    Raises:
      TypeError: they are no sequence, or one is not an integer.
      ValueError: there are none, one is out of range, or one occurs twice.
    """
    if isinstance(seeds, str) or not isinstance(seeds, Iterable):
        raise TypeError(f"seeds is {seeds!r}; expected several, such as range(100)")
    if isinstance(seeds, range) and seeds:  # which may be too long to list
        checked_seed(seeds[0]), checked_seed(seeds[-1])
    checked = [checked_seed(seed) for seed in seeds]
    if not checked:
        raise ValueError("there are no seeds; expected at least one, such as range(100)")
    if len(set(checked)) < len(checked):
        raise ValueError("a seed occurs twice; expected each once, so that no episode counts twice")
    return checked


def checked_seeds(seeds: Iterable[object]) -> list[int]:
    """The seeds of episodes as ints.

    Raises:
      TypeError, ValueError: see `distinct_seeds`; or they are not increasing.
    """
    checked = distinct_seeds(seeds)
    for one, following in itertools.pairwise(checked):
        if following <= one:
            raise ValueError(f"seed {following} follows {one}; expected increasing seeds")
    return checked
