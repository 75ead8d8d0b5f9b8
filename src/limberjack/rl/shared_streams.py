"""`put_back_after`: exclusive use of the random streams that all environments share.

    with put_back_after():
        ...                     # may seed and draw from NumPy's and Python's global streams

Checks seed the global streams to see whether a hook draws from them. Two threads that make
environments at the same time would see each other's draws and keep each other's seeds, so one waits
for the other. Draws by other threads of a program are taken for the hook's, and are undone.
"""

import contextlib
import ctypes
import functools
import pickle
import random
from collections.abc import Callable, Iterator, Mapping
from typing import cast

import numpy as np

from limberjack.utils.turns import Turn

__all__ = ["GLOBAL_STREAMS", "drawn_from", "fingerprint", "put_back_after", "state_of"]

GLOBAL_STREAMS: Mapping[str, object] = {
    "NumPy's global stream": np.random,
    "the stream of random": random,
}


# NumPy's mt19937_state: 624 numbers of 32 bits, and the position.
_BYTES_OF_STATE = (624 + 1) * 4


_TURN = Turn()


@contextlib.contextmanager
def put_back_after(streams: Mapping[str, object] = GLOBAL_STREAMS) -> Iterator[None]:
    """Locks the shared streams for the time of the context, and puts them back at the end.

    Args:
      streams: modules and streams, by name.
    """
    with _TURN.lock:
        put_back = [_putting_back(stream) for stream in streams.values()]
        try:
            yield
        finally:
            for each in put_back:
                each()


def drawn_from(streams: Mapping[str, object], play: Callable[[], object]) -> str | None:
    """The first of some streams that a function draws from; the streams are put back.

    Args:
      streams: modules and streams, by name.
      play: called once, without arguments.
    """
    with put_back_after(streams):
        before = {name: state_of(stream) for name, stream in streams.items()}
        play()
        drawn = [name for name, stream in streams.items() if state_of(stream) != before[name]]
    return drawn[0] if drawn else None


def fingerprint(stream: object) -> bytes:
    """The state of a stream as bytes that every draw changes.

    That of a `RandomState`, or of NumPy's global one, is read where NumPy keeps it, in a
    microsecond; `get_state` takes thirty.
    """
    if stream is random:
        return state_of(stream)
    owner = np.random.mtrand._rand if stream is np.random else cast(np.random.RandomState, stream)
    generator = owner._bit_generator
    if isinstance(generator, np.random.MT19937):
        return ctypes.string_at(generator.ctypes.state_address, _BYTES_OF_STATE)
    return state_of(stream)


def state_of(stream: object) -> bytes:
    """The state of a stream in a form that can be compared."""
    if isinstance(stream, np.random.Generator):
        return pickle.dumps(stream.bit_generator.state)
    if isinstance(stream, np.random.RandomState) or stream is np.random:
        return pickle.dumps(cast(np.random.RandomState, stream).get_state(legacy=False))
    return pickle.dumps(cast(random.Random, stream).getstate())


def _putting_back(stream: object) -> Callable[[], object]:
    """A function that puts a stream back to where it is now."""
    if isinstance(stream, np.random.Generator):
        state = stream.bit_generator.state
        return lambda: setattr(stream.bit_generator, "state", state)
    if isinstance(stream, np.random.RandomState) or stream is np.random:
        legacy = cast(np.random.RandomState, stream)
        return functools.partial(legacy.set_state, legacy.get_state(legacy=False))
    own = cast(random.Random, stream)
    return functools.partial(own.setstate, own.getstate())
