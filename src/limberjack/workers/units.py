"""Units of work: the seeds that one worker plays at a time, and the seeds of a shard.

    units_of(range(60, 130), 64)      # [(60, ..., 63), (64, ..., 127), (128, 129)]
    shard_of(range(1000), (2, 8))     # the second of eight parts, in whole blocks of 64

Units and shards are split at seeds that are multiples of 64, because an episode has row
`seed % 64` of a batch.
"""

import collections
import dataclasses
import operator
from collections import deque
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from limberjack.policies import ROWS

if TYPE_CHECKING:
    from limberjack.workers.setup import Setup

__all__ = ["Unit", "queue_of", "shard_of", "units_of"]


@dataclasses.dataclass(frozen=True, eq=False)
class Unit:
    """Seeds that are played together, and everything else that their episodes depend on.

    Attributes:
      setup: the task and the policy.
      seeds: a tuple, or a range, which is small however long it is.
      more: further arguments of the function that a worker calls.
    """

    setup: "Setup"
    seeds: Sequence[int]
    more: tuple[object, ...] = ()

    @property
    def policy(self) -> str:
        """Its name."""
        return self.setup.identity["policy"]

    def __str__(self) -> str:
        first, last = min(self.seeds), max(self.seeds)
        which = f"seed {first}" if first == last else f"seeds {first} to {last}"
        return f"policy {self.policy!r}, {which}"


def queue_of(units: Iterable[Unit]) -> deque[Unit]:
    """The units as a queue; a queue is returned as it is, so that its owner may add to it."""
    return units if isinstance(units, deque) else deque(units)


def units_of(seeds: Iterable[int], size: int = ROWS) -> list[tuple[int, ...]]:
    """The seeds, grouped by `seed // size`."""
    blocks: dict[int, list[int]] = collections.defaultdict(list)
    for seed in seeds:
        blocks[seed // size].append(seed)
    return [tuple(block) for block in blocks.values()]


def shard_of(seeds: Sequence[int], shard: tuple[int, int]) -> list[int]:
    """The seeds of one of several shards; none where there are fewer blocks of 64 than shards.

    Args:
      seeds: all of them, the same for each shard.
      shard: its number, from 1 on, and the number of all shards.

    Raises:
      TypeError: it is no pair of whole numbers.
      ValueError: there is no such shard.
    """
    if isinstance(shard, str) or len(shard) != 2:
        raise TypeError(f"shard is {shard!r}; expected a pair (K, N), such as (1, 2)")
    number, count = map(operator.index, shard)
    if not 1 <= number <= count:
        raise ValueError(f"shard is {number}/{count}; expected K/N with K from 1 to N")
    blocks = units_of(seeds)
    first, end = (len(blocks) * part // count for part in (number - 1, number))
    return [seed for block in blocks[first:end] for seed in block]
