"""`Domain`: a name, its module, and facts about its tasks that need no import of the module."""

import importlib
import importlib.util
import sys
from dataclasses import dataclass
from types import ModuleType
from typing import Literal

from limberjack.registry.row import Row

__all__ = ["Domain", "import_name_of"]


@dataclass(frozen=True)
class Domain:
    """A domain of the registry.

    Attributes:
      name: the domain's name, such as 'humanoid'.
      module: the module, or its dotted name if it is imported on first use.
      rows: its tasks at the time it was added; episode lengths are unknown for a domain assigned
        to `suite._DOMAINS`.
      source: its origin: the suite, `suite.register`, an assignment to `suite._DOMAINS`, or an
        entry point of an installed package.
    """

    name: str
    module: ModuleType | str
    rows: tuple[Row, ...]
    source: Literal["suite", "registered", "assigned", "installed"]

    def load(self) -> ModuleType:
        """The module, imported if necessary."""
        if isinstance(self.module, str):
            return importlib.import_module(self.module)
        return self.module

    @property
    def import_name(self) -> str | None:
        """Dotted name under which another process can import the module; None if it cannot."""
        return self.module if isinstance(self.module, str) else import_name_of(self.module)


def import_name_of(module: ModuleType) -> str | None:
    """Dotted name under which another process can import a module; None if it cannot.

    The main program, code in a notebook and modules that exist only in memory cannot be imported.
    """
    name = module.__name__
    if name == "__main__" or sys.modules.get(name) is not module:
        return None
    return name if getattr(module, "__spec__", None) is not None else None
