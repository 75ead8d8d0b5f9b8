"""Splitting seeds at multiples of 64."""

import itertools
from typing import Any

import pytest

from limberjack.workers import Unit, prepare, shard_of, units_of

from .playing import TASK


def test_units_end_before_seeds_that_are_multiples_of_64() -> None:
    assert [(u[0], u[-1]) for u in units_of(range(60, 130))] == [(60, 63), (64, 127), (128, 129)]


def test_units_of_one_seed_keep_the_order() -> None:
    assert units_of([5, 3, 4], 1) == [(5,), (3,), (4,)]


def test_seeds_in_any_order_are_together_with_those_of_their_block() -> None:
    assert units_of([70, 3, 64, 1]) == [(70, 64), (3, 1)]


@pytest.mark.parametrize("shards", range(1, 8))
@pytest.mark.parametrize("seeds", [range(300), range(60, 70), [9]])
def test_shards_partition_the_seeds_at_multiples_of_64(shards: int, seeds: list[int]) -> None:
    parts = [shard_of(seeds, (number, shards)) for number in range(1, shards + 1)]
    assert list(itertools.chain(*parts)) == list(seeds)
    blocks = [{seed // 64 for seed in part} for part in parts]
    assert sum(map(len, blocks)) == len(set().union(*blocks))
    counts = [len(block) for block in blocks]
    assert max(counts) - min(counts) <= 1


@pytest.mark.parametrize("shard", ["1/2", (1, 2, 3), (1.0, 2)])
def test_a_shard_that_is_no_pair_of_whole_numbers_is_refused(shard: Any) -> None:
    with pytest.raises(TypeError, match=r"expected a pair \(K, N\)|'float' object"):
        shard_of(range(10), shard)


@pytest.mark.parametrize("shard", [(0, 3), (4, 3), (1, 0)])
def test_a_shard_that_does_not_exist_is_refused(shard: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"expected K/N with K from 1 to N"):
        shard_of(range(10), shard)


def test_a_unit_is_shown_with_its_policy_and_its_seeds() -> None:
    setup = prepare(*TASK, "random")
    assert str(Unit(setup, (3,))) == "policy 'random', seed 3"
    assert str(Unit(setup, (64, 65, 66))) == "policy 'random', seeds 64 to 66"
