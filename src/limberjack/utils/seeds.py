"""`checked_seed`: a number that `numpy.random.RandomState` takes as a seed.

seed = checked_seed(7)
"""

import operator

__all__ = ["SEEDS", "checked_seed"]

SEEDS = 2**32  # numpy.random.RandomState takes seeds below this


def checked_seed(seed: object) -> int:
    """The seed as an int.

    Raises:
      TypeError: it is not a whole number; True and False are not.
      ValueError: it is not between 0 and 2**32 - 1.
    """
    try:
        if isinstance(seed, bool):
            raise TypeError
        number = operator.index(seed)  # pyright: ignore[reportArgumentType] (TypeError says so)
    except TypeError:
        raise TypeError(f"seed is {seed!r}; expected a whole number") from None
    if not 0 <= number < SEEDS:
        raise ValueError(f"seed is {number}; expected a whole number from 0 to 2**32 - 1")
    return number
