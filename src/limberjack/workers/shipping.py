"""Policies on their way to a worker: built-in ones by name, modules by source, models as bytes.

    shipped = ship("my_policies:still")       # in the driver
    actor = unpack(shipped, environment, 1)   # in a worker

A worker imports MODULE:CALLABLE from its own files if it has that module, so that weights beside it
are found; a worker without it imports the source that was shipped. Whether the module is the same
one, the policy's hash decides: see `limberjack.workers.setup`.
"""

import dataclasses
import importlib
import inspect
import sys
import threading
from collections.abc import Mapping
from pathlib import Path

import dm_env

from limberjack import policies
from limberjack.policies import Actor, PolicyError
from limberjack.policies.saved import read_model
from limberjack.utils.sources import Source, source_of_module
from limberjack.workers.shipped_modules import import_shipped

__all__ = ["Shipped", "ship", "unpack"]


@dataclasses.dataclass(frozen=True)
class Shipped:
    """A policy that can be pickled.

    Attributes:
      name: 'zero', 'random', 'planner', 'MODULE:CALLABLE' or 'sb3:PATH'.
      source: of the module; None for the others.
      files: of a saved model, by path.
    """

    name: str
    source: Source | None = None
    files: Mapping[Path, bytes] | None = None


def ship(policy: object) -> Shipped:
    """A policy that other processes can use, given as to `policies.find`.

    Raises:
      PolicyError: there is none of that name, or other processes cannot import it.
    """
    name = policy if isinstance(policy, str) else _name_of(policy)
    if policies.is_saved_model(name):
        return Shipped(name, files=read_model(name))
    module, colon, _ = name.partition(":")
    if not colon:
        return Shipped(name)
    policies.find(name)  # imports the module
    if module == "__main__":
        raise PolicyError(
            f"policy {name!r} is defined in the main program or a notebook, which other processes "
            "cannot import: move it into a module, such as my_policies.py"
        )
    return Shipped(name, source_of_module(module))


def unpack(shipped: Shipped, environment: dm_env.Environment, num_threads: int | None) -> Actor:
    """The policy, in a worker.

    Args:
      shipped: the policy.
      environment: that it is to act in.
      num_threads: that the planner simulates with.

    Raises:
      PolicyError: it cannot be used here.
    """
    if shipped.source is None:
        return policies.find(
            shipped.name, environment, num_threads=num_threads, files=shipped.files
        )
    module = shipped.name.partition(":")[0]
    if module not in sys.modules and not _has(module):
        import_shipped(module, shipped.source)
    # Threads of an executor, such as those of a worker of Dask, are not the main one.
    is_shared = threading.current_thread() is not threading.main_thread()
    actor = policies.find(shipped.name, environment, num_threads=num_threads, is_shared=is_shared)
    if source_of_module(module) is None:  # imported from what was shipped
        actor.sha256 = shipped.source.sha256
    return actor


def _name_of(policy: object) -> str:
    """MODULE:CALLABLE of a function or class; raises PolicyError unless it has that name."""
    name = policies.name_of(policy)
    module, _, path = name.partition(":")
    target: object = sys.modules.get(module)
    for part in path.split("."):
        target = getattr(target, part, None)
    if target is not policy:
        kind = "a function" if inspect.isroutine(policy) else "an object"
        raise PolicyError(
            f"policy {name!r} is {kind} that other processes cannot import by that name: define "
            "it at the top level of a module and pass its name, 'MODULE:CALLABLE'"
        )
    return name


def _has(module: str) -> bool:
    """Whether this process finds the module by itself."""
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if module == missing or module.startswith(f"{missing}."):
            return False
        raise  # a package that the module needs
    return True
