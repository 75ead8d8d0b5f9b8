"""SHA-256 of the Python source of a function or class, to detect changed code.

    hash_of_module("my_package.policies")   # of all Python files of my_package
    hash_of_module("my_policies")           # of my_policies.py
    source_of_module("my_policies").files   # {'my_policies.py': b'...'}

A package is hashed as a whole, so imports between its modules are covered, whatever their form.
Data files such as weights, and imports from other packages, are not covered.
"""

import dataclasses
import functools
import hashlib
import inspect
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

__all__ = [
    "Source",
    "defined_in",
    "hash_of_files",
    "hash_of_module",
    "hash_of_source",
    "imported",
    "source_of_module",
]


@dataclasses.dataclass(frozen=True)
class Source:
    """The Python files of a package, or a single module.

    Attributes:
      package: dotted name of the folder that the files' names are relative to; empty for a module
        outside of packages.
      files: contents by name, such as 'networks/small.py', in the order of the hash.
    """

    package: str
    files: Mapping[str, bytes]

    @property
    def sha256(self) -> str:
        """Hash of the names and contents, in hex."""
        digest = hashlib.sha256()
        for name, content in self.files.items():
            digest.update(f"{name} {len(content)}\n".encode())
            digest.update(content)
        return digest.hexdigest()


def hash_of_files(files: Iterable[Path]) -> str:
    """Hash of the names and contents of one or more files, in hex.

    Names are relative to the files' common folder, so its location does not affect the hash.
    """
    return _source("", files).sha256


def hash_of_module(name: str) -> str | None:
    """Hash of an imported module's package; None for a module without a file.

    The package is the outermost one with an `__init__.py`. For a module in a namespace package, all
    Python files of its folder are hashed; for a top-level module, only its own file.
    """
    source = source_of_module(name)
    return None if source is None else source.sha256


def source_of_module(name: str) -> Source | None:
    """The files that `hash_of_module` covers; None for a module without a file."""
    file = getattr(sys.modules.get(name), "__file__", None)
    if file is None or not Path(file).is_file():
        return None
    parents = name.split(".")
    for depth in range(1, len(parents) + 1):
        package = ".".join(parents[:depth])
        beginning = getattr(sys.modules.get(package), "__file__", None)
        if beginning is not None and Path(beginning).stem == "__init__":
            return _source(package, _files_in(Path(beginning).parent))
    if len(parents) > 1:  # a namespace package
        return _source(name.rpartition(".")[0], [Path(file), *_files_in(Path(file).parent)])
    return _source("", [Path(file)])


def hash_of_source(target: object) -> str | None:
    """Hash of the module that defines a function, class or object.

    Without a module file, as in a notebook, the hash covers only the source text of the function or
    class; None if that is not available either.
    """
    named = defined_in(target)
    of_module = hash_of_module(named.__module__)
    if of_module is not None:
        return of_module
    try:
        return hashlib.sha256(inspect.getsource(named).encode()).hexdigest()
    except (OSError, TypeError):
        return None


def defined_in(target: object) -> type:
    """The function or class that `target` is, is a partial of, or is an instance of."""
    while isinstance(target, functools.partial):
        target = target.func
    if not (hasattr(target, "__qualname__") and hasattr(target, "__module__")):
        return type(target)
    # Typed as a class: a function has the same `__module__`, `__qualname__` and source.
    return target  # pyright: ignore[reportReturnType]


def imported(name: str) -> object:
    """The object of an imported module that MODULE:NAME names; None if it does not exist."""
    module, _, path = name.partition(":")
    target: object = sys.modules.get(module)
    for part in path.split("."):
        target = getattr(target, part, None)
    return target


def _files_in(folder: Path) -> Iterator[Path]:
    """The Python files of a folder and those below it."""
    # Not folders, nor the dangling links with which some editors lock a file.
    return (path for path in folder.rglob("*.py") if path.is_file())


def _source(package: str, files: Iterable[Path]) -> Source:
    ordered = sorted(set(files))
    root = Path(os.path.commonpath([file.parent for file in ordered]))
    return Source(package, {f.relative_to(root).as_posix(): f.read_bytes() for f in ordered})
