"""SHA-256 of the Python source that a function or class comes from, to tell versions of it apart.

    hash_of_module("my_package.policies")   # of all Python files of my_package
    hash_of_module("my_policies")           # of my_policies.py

A package counts as a whole: what its modules import of each other is covered, however they import
it. Weights and other data files, and packages that are imported from elsewhere, are not.
"""

import functools
import hashlib
import inspect
import os
import sys
from collections.abc import Iterable
from pathlib import Path

__all__ = ["defined_in", "hash_of_files", "hash_of_module", "hash_of_source"]


def hash_of_files(files: Iterable[Path]) -> str:
    """The hash over names and contents of at least one file, in hex.

    Names are relative to the folder that all files have in common, so that it does not matter where
    that folder lies.
    """
    ordered = sorted(set(files))
    root = Path(os.path.commonpath([file.parent for file in ordered]))
    digest = hashlib.sha256()
    for file in ordered:
        content = file.read_bytes()
        digest.update(f"{file.relative_to(root).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


def hash_of_module(name: str) -> str | None:
    """The hash of an imported module's package; None for a module without a file.

    The package is the outermost one that has an `__init__.py`. A module in a folder without one is
    taken with all Python files of that folder; a module in no package stands for itself.
    """
    files = _files_of(name)
    return hash_of_files(files) if files else None


def hash_of_source(target: object) -> str | None:
    """The hash of the module that defines a function, class or object.

    Without a module's file, as in a notebook, it is that of the text that was typed in for the
    function or class alone; None where that is not known either.
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
    # A function has what is read here of a class: a module, a qualified name and a source.
    return target if hasattr(target, "__qualname__") else type(target)  # pyright: ignore[reportReturnType]


def _files_of(name: str) -> list[Path]:
    file = getattr(sys.modules.get(name), "__file__", None)
    if file is None or not Path(file).is_file():
        return []
    parents = name.split(".")
    for depth in range(1, len(parents) + 1):
        package = getattr(sys.modules.get(".".join(parents[:depth])), "__file__", None)
        if package is not None and Path(package).stem == "__init__":
            return sorted(Path(package).parent.rglob("*.py"))
    if len(parents) > 1:  # a folder that is a package without saying so
        return sorted({Path(file), *Path(file).parent.rglob("*.py")})
    return [Path(file)]
