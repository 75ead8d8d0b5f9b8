"""`Turn`: a lock for what belongs to the whole process; a forked process begins with a free one.

_turn = Turn()
with _turn.lock:
    ...
"""

import os
import threading

__all__ = ["Turn"]


class Turn:
    """See the module's docstring.

    Attributes:
      lock: the one of this process.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()
        if hasattr(os, "register_at_fork"):  # not on Windows, which does not fork
            os.register_at_fork(after_in_child=self._free)

    def _free(self) -> None:
        """Replaces the lock: a thread that had it does not exist in the child."""
        self.lock = threading.RLock()
