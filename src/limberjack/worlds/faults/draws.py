"""Random numbers of many rows at once, each a function of a key, a step and an index.

    uniform(keys, steps, kind, count)     # (n, count), for keys and steps of (n,)
    normal(keys, steps, kind, count)

A generator with a state, such as NumPy's, would be called once for each row and step, and a
snapshot would hold each one's state. Here row i's numbers depend only on its own key and step, so a
batch draws the numbers that single environments draw. The key is mixed with the position by the
output function of SplitMix64 (Steele, Lea and Flood, 2014, https://doi.org/10.1145/2660193.2660195).
"""

import hashlib
import math

import numpy as np

__all__ = ["key_of", "normal", "uniform"]

# Of SplitMix64: the increment of its state, and the two multipliers of its output function.
_INCREMENT = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_SHIFTS = tuple(np.uint64(shift) for shift in (30, 27, 31))
_UNUSED = np.uint64(11)  # bits of a 64-bit number beyond the 53 of a float's fraction
_SPACING = 2.0**-53  # of the floats in [0.5, 1)
_KINDS = 16  # more than there are kinds of draws


def key_of(stream: np.random.RandomState, episodes: int) -> np.uint64:
    """The key of an episode.

    Args:
      stream: from which the episode is going to be drawn; it is not advanced.
      episodes: number of earlier episodes of the stream, for a task that draws nothing.
    """
    _, key, *rest = stream.get_state(legacy=True)
    text = np.asarray(key, np.uint32).tobytes() + repr((*rest, episodes)).encode()
    digest = hashlib.blake2b(text, digest_size=8, person=b"faults").digest()
    return np.uint64(int.from_bytes(digest, "little"))


def uniform(keys: np.ndarray, steps: np.ndarray, kind: int, count: int) -> np.ndarray:
    """Numbers from [0, 1), (n, count).

    Args:
      keys: of the rows, (n,) uint64.
      steps: of the rows, (n,).
      kind: of draw, from 0 to 15; draws of different kinds are independent.
      count: numbers in a row.
    """
    places = steps.astype(np.uint64) * np.uint64(_KINDS) + np.uint64(kind)
    starts = _mixed(keys ^ _mixed(places * _INCREMENT))
    numbers = starts[:, None] + np.arange(1, count + 1, dtype=np.uint64) * _INCREMENT
    return (_mixed(numbers) >> _UNUSED) * _SPACING


def normal(keys: np.ndarray, steps: np.ndarray, kind: int, count: int) -> np.ndarray:
    """Numbers of the standard normal distribution, (n, count), by the method of Box and Muller."""
    both = uniform(keys, steps, kind, 2 * count)
    # Of 1 - u, which is never 0. Contiguous, since NumPy's routines for strided arrays may round
    # differently.
    first, second = 1.0 - both[:, :count], np.ascontiguousarray(both[:, count:])
    return np.sqrt(-2.0 * np.log(first)) * np.cos(2.0 * math.pi * second)


def _mixed(numbers: np.ndarray) -> np.ndarray:
    """The output function of SplitMix64, modulo 2**64."""
    numbers = (numbers ^ (numbers >> _SHIFTS[0])) * _FIRST
    numbers = (numbers ^ (numbers >> _SHIFTS[1])) * _SECOND
    return numbers ^ (numbers >> _SHIFTS[2])
