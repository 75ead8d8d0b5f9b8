"""Sends policies to workers: built-in ones by name, modules by source, models as bytes.

    shipped = ship("my_policies:still")       # in the driver
    actor = unpack(shipped, environment, 1)   # in a worker

A worker imports MODULE:CALLABLE from its own files if it has that module, so that weights beside it
are found; a worker without it imports the source that was shipped, and writes nothing to a file.
The policy's hash shows whether both have the same module; see `limberjack.workers.setup`.
"""

import dataclasses
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import inspect
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType

import dm_env

from limberjack import policies
from limberjack.policies import Actor, PolicyError
from limberjack.policies.saved import read_model
from limberjack.utils.sources import Source, imported, source_of_module

__all__ = ["Shipped", "ship", "unpack"]

_INIT = "__init__"


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
      PolicyError: no policy has that name, or other processes cannot import it.
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
        _import_shipped(module, shipped.source)
    # An executor, such as Dask's, may play units in a thread that is not the main one.
    is_shared = threading.current_thread() is not threading.main_thread()
    actor = policies.find(shipped.name, environment, num_threads=num_threads, is_shared=is_shared)
    if source_of_module(module) is None:  # imported from what was shipped
        actor.sha256 = shipped.source.sha256
    return actor


def _name_of(policy: object) -> str:
    """MODULE:CALLABLE of a function or class; raises PolicyError unless it has that name."""
    name = policies.name_of(policy)
    if imported(name) is not policy:
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
    except ModuleNotFoundError:  # or a package that it needs: it is imported again, and says so
        return False
    return True


def _import_shipped(module: str, source: Source) -> None:
    """Imports a module that this process lacks, and makes its package's modules importable.

    Raises:
      ImportError: a package that it needs is not installed.
    """
    finder = _Finder(source)
    sys.meta_path.append(finder)  # last: installed modules come first
    try:
        importlib.import_module(module)
    except BaseException:
        sys.meta_path.remove(finder)
        raise


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Finds and loads the modules of one source."""

    def __init__(self, source: Source) -> None:
        self._code: dict[str, bytes] = {}
        self._packages: set[str] = set()
        for name, content in source.files.items():
            parts = [*source.package.split("."), *name.removesuffix(".py").split("/")]
            dotted = [part for part in parts if part]
            if dotted[-1] == _INIT:
                dotted.pop()
                self._packages.add(".".join(dotted))
            self._code[".".join(dotted)] = content
            # Folders without an `__init__.py` are packages without code.
            self._packages.update(".".join(dotted[:depth]) for depth in range(1, len(dotted)))

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """See `importlib.abc.MetaPathFinder`."""
        if fullname not in self._code and fullname not in self._packages:
            return None
        return importlib.util.spec_from_loader(
            fullname, self, origin="shipped", is_package=fullname in self._packages
        )

    def is_package(self, fullname: str) -> bool:
        """See `importlib.abc.InspectLoader`."""
        return fullname in self._packages

    def get_source(self, fullname: str) -> str:
        """See `importlib.abc.InspectLoader`."""
        return importlib.util.decode_source(self._code.get(fullname, b""))
