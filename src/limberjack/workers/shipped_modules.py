"""Modules imported from source that another process has shipped; nothing is written to a file.

import_shipped("my_policies", Source("", {"my_policies.py": b"..."}))
"""

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Sequence
from types import ModuleType

from limberjack.utils.sources import Source

__all__ = ["import_shipped"]

_INIT = "__init__"


def import_shipped(module: str, source: Source) -> None:
    """Imports a module that this process has no file of; its package's modules can be imported too.

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
