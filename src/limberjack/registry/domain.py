"""`Domain`: a name, the module behind it, and what is known of its tasks without importing it."""

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
      name: such as 'humanoid'.
      module: the module, or its dotted name if it is imported on first use.
      rows: its tasks when it was added; for one that was assigned to `suite._DOMAINS` the lengths
        of episodes are not known.
      source: where it comes from: the suite, `suite.register`, an assignment to `suite._DOMAINS`,
        or an entry point of an installed package.
    """

    name: str
    module: ModuleType | str
    rows: tuple[Row, ...]
    source: Literal["suite", "registered", "assigned", "installed"]

    def load(self) -> ModuleType:
        """The module, imported if it was not."""
        if isinstance(self.module, str):
            return importlib.import_module(self.module)
        return self.module

    @property
    def import_name(self) -> str | None:
        """The dotted name by which another process imports the module; None if it cannot."""
        return self.module if isinstance(self.module, str) else import_name_of(self.module)


def import_name_of(module: ModuleType) -> str | None:
    """The dotted name by which another process imports a module; None if it cannot.

    It cannot import the main program, what a notebook defines, or a module that was only made in
    memory.
    """
    name = module.__name__
    if name == "__main__" or sys.modules.get(name) is not module:
        return None
    return name if getattr(module, "__spec__", None) is not None else None
