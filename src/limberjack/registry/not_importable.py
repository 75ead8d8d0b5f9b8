"""`NotImportable`: stands for a domain that only this process has, and says so when it is pickled.

pickle.dumps(NotImportable("swing"))    # PicklingError: ... move it into a module of its own ...
"""

import pickle
from typing import Never

__all__ = ["NotImportable"]


class NotImportable:
    """In place of the name of a module: the domain is in the main program or in memory."""

    def __init__(self, domain: str) -> None:
        """Takes the name of the domain."""
        self._domain = domain

    def __repr__(self) -> str:
        return f"<domain {self._domain!r}: no module that can be imported>"

    def __deepcopy__(self, memo: object) -> "NotImportable":
        return self

    def __reduce__(self) -> Never:
        raise pickle.PicklingError(
            f"domain {self._domain!r} is defined in the main program, a notebook or in memory, so "
            "another process cannot import it: move it into a module of its own, such as "
            f"my_package/{self._domain}.py, and register that"
        )
