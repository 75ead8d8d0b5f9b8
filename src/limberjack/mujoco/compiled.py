"""Compiled models by their source: shared while they are in use, and kept for the next load.

    shared = compiled(source, compile_it)
    assert compiled(source, compile_it) is shared     # `compile_it` was not called again

Compiling a model of the suite takes about 70 ms. The models that were used last are kept, up to a
number of bytes, even if no simulation uses them any more.
"""

import collections
import weakref
from collections.abc import Callable, Hashable

import mujoco

from limberjack.mujoco.wrapper.sharing import SharedModel

__all__ = ["compiled", "drop_unused"]

_MOST_KEPT = 256 * 2**20  # bytes of models that no simulation may be using

_in_use: "weakref.WeakValueDictionary[Hashable, SharedModel]" = weakref.WeakValueDictionary()
_last_used: "collections.OrderedDict[Hashable, SharedModel]" = collections.OrderedDict()


def compiled(source: Hashable, compile_it: Callable[[], mujoco.MjModel]) -> SharedModel:
    """The model that `compile_it` made for this source: now, or earlier if it is still there."""
    shared = _in_use.get(source)
    if shared is None:
        shared = _in_use[source] = SharedModel(compile_it())
    _last_used[source] = shared
    _last_used.move_to_end(source)
    sizes = [mujoco.mj_sizeModel(kept.model) for kept in _last_used.values()]
    while len(sizes) > 1 and sum(sizes) > _MOST_KEPT:
        _last_used.popitem(last=False)
        del sizes[0]
    return shared


def drop_unused() -> None:
    """Drops the models that no simulation uses."""
    _last_used.clear()
