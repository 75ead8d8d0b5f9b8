"""`NotImportable`: placeholder for a domain that only this process has; pickling it raises.

pickle.dumps(NotImportable("swing"))    # PicklingError: ... move it into its own module ...
"""

import pickle
from typing import Never

__all__ = ["NotImportable"]


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
