"""`checked_seed`: validation of seeds for `numpy.random.RandomState`.

seed = checked_seed(7)
"""

import operator

__all__ = ["SEEDS", "checked_seed"]

SEEDS = 2**32  # numpy.random.RandomState accepts seeds below this


def checked_seed(seed: object) -> int:
    """The seed as an int.

    Raises:
      TypeError: the seed is not an integer; bool is not accepted.
      ValueError: the seed is not between 0 and 2**32 - 1.
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
