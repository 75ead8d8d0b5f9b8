"""`compiled`: a cache of compiled models by source, shared while in use.

    shared = compiled(source, compile_it)
    assert compiled(source, compile_it) is shared     # `compile_it` was not called again

Compiling a suite model takes about 70 ms. The most recently used models stay in the cache, up to a
total size, even if no simulation uses them.
"""

import weakref
from collections.abc import Callable, Hashable

import mujoco

from limberjack.mujoco.wrapper.sharing import SharedModel

__all__ = ["compiled", "drop_unused"]

_MOST_KEPT = 128 * 2**20  # bytes; total size of the cached models

_in_use: "weakref.WeakValueDictionary[Hashable, SharedModel]" = weakref.WeakValueDictionary()
_last_used: dict[Hashable, SharedModel] = {}  # the most recent one last


def compiled(source: Hashable, compile_it: Callable[[], mujoco.MjModel]) -> SharedModel:
    """The cached model for this source, compiled by `compile_it` if necessary."""
    shared = _in_use.get(source)
    if shared is None:
        shared = _in_use[source] = SharedModel(compile_it())
    # Other threads may do the same at any point, so nothing relies on the entries found before.
    _last_used.pop(source, None)
    _last_used[source] = shared
    kept = [(name, mujoco.mj_sizeModel(each.model)) for name, each in tuple(_last_used.items())]
    total = sum(size for _, size in kept)
    for name, size in kept[:-1]:
        if total <= _MOST_KEPT:
            break
        _last_used.pop(name, None)
        total -= size
    return shared


def drop_unused() -> int:
    """Drops cached models that no simulation uses; returns how many are still in use."""
    _last_used.clear()
    return len(_in_use)
