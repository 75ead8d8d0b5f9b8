"""`Domain`: a name, its module, and facts about its tasks that need no import of the module.

A `Row` has the facts about a task; `table.py` lists one for each task of the suite. Where only this
process has a domain, a `NotImportable` takes the place of its module's name:

    pickle.dumps(NotImportable("swing"))    # PicklingError: ... move it into its own module ...
"""

import importlib
import importlib.util
import pickle
import sys
from dataclasses import dataclass
from types import ModuleType
from typing import Literal, NamedTuple, Never

__all__ = ["Domain", "NotImportable", "Row", "import_name_of"]


class Row(NamedTuple):
    """A task of a domain; `table.py` lists one row per suite task."""

    domain: str
    task: str
    tags: tuple[str, ...]
    steps: int | None  # of an episode; None without a time limit
    dof: int  # degrees of freedom of the model
    actions: int | None = None  # numbers of an action; None if unknown
    observations: int | None = None  # numbers of an observation; None if unknown


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
    if not isinstance(module, ModuleType):  # an object with a SUITE, in its place
        return None
    name = module.__name__
    if name == "__main__" or sys.modules.get(name) is not module:
        return None
    return name if getattr(module, "__spec__", None) is not None else None


class NotImportable:
    """Takes the place of a module name when the domain exists only in this process."""

    def __init__(self, domain: str) -> None:
        """Stores the name of the domain."""
        self._domain = domain

    def __repr__(self) -> str:
        return f"<domain {self._domain!r}: no module that can be imported>"

    def __deepcopy__(self, memo: object) -> "NotImportable":
        return self

    def __reduce__(self) -> Never:
        raise pickle.PicklingError(
            f"domain {self._domain!r} is defined in the main program, a notebook or in memory, so "
            "another process cannot import it: move it into its own module, such as "
            f"my_package/{self._domain}.py, and register that"
        )
