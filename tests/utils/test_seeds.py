"""Seeds."""

import numpy as np
import pytest

from limberjack.utils.seeds import (
    SEEDS,
    checked_seed,
    checked_seeds,
    distinct_seeds,
    first_of_seeds,
)


def test_a_whole_number_that_randomstate_takes_is_returned_as_an_int() -> None:
    assert type(checked_seed(np.uint32(7))) is int
    assert checked_seed(SEEDS - 1) == SEEDS - 1
    np.random.RandomState(checked_seed(SEEDS - 1))


@pytest.mark.parametrize("seed", [True, False, 1.5, "1", None, np.True_])
def test_values_that_are_not_integers_are_type_errors(seed: object) -> None:
    with pytest.raises(TypeError, match=r"^seed is .*; expected a whole number$"):
        checked_seed(seed)


@pytest.mark.parametrize("seed", [-1, SEEDS])
def test_a_number_out_of_range_is_a_value_error(seed: int) -> None:
    with pytest.raises(ValueError, match=rf"seed is {seed}; expected .* from 0 to 2\*\*32 - 1"):
        checked_seed(seed)


def test_seeds_of_episodes_are_increasing() -> None:
    assert checked_seeds(np.array([3, 5])) == [3, 5]
    for seeds, message in (
        ([], "there are no seeds; expected at least one, such as range"),
        ([1, 1], "a seed occurs twice"),
        ([2, 1], "seed 1 follows 2; expected increasing seeds"),
        ([-1], "seed is -1"),
    ):
        with pytest.raises(ValueError, match=message):
            checked_seeds(seeds)


def test_seeds_that_cannot_be_listed_are_refused_at_once() -> None:
    with pytest.raises(ValueError, match="seed is 999999999999"):
        distinct_seeds(range(10**12))
    for given in (5, "12", None):
        with pytest.raises(TypeError, match="expected several, such as range"):
            distinct_seeds(given)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="a seed occurs twice"):
        distinct_seeds([3, 1, 3])
    assert distinct_seeds(np.array([5, 3])) == [5, 3]


def test_the_seeds_of_rows_follow_the_first_ones() -> None:
    assert first_of_seeds(SEEDS - 3, 3) == SEEDS - 3
    with pytest.raises(ValueError, match=rf"seed {SEEDS}; expected at most {SEEDS - 3} for so"):
        first_of_seeds(SEEDS - 2, 3)
    with pytest.raises(ValueError, match=r"10000000000 rows; expected at most 2\*\*32"):
        first_of_seeds(0, 10**10)
