"""Registers the environments as soon as Gymnasium is imported, so that its ids need no import.

Gymnasium loaded plugins by entry points until 1.0, which removed that. Instead,
`limberjack-gymnasium.pth`, which is installed beside this package, has Python import this module
when it starts. It imports nothing: it waits until the program imports `gymnasium`, has
`limberjack.gym` imported after it, and leaves no trace.
"""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # as in `typing`, whose import would cost every start of Python some time
if TYPE_CHECKING:
    from typing import Any

__all__: list[str] = []


class _Waiting:
    """A finder of modules that notices when Gymnasium is looked for."""

    # Any: importlib's types.
    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """The spec of Gymnasium, whose loader then registers; None for everything else."""
        if name != "gymnasium":
            return None
        sys.meta_path.remove(self)
        import importlib.util

        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            _register_after(spec.loader)
        return spec


def _register_after(loader: Any) -> None:
    """Lets a loader, which is Gymnasium's, register once it has run the module."""
    run = loader.exec_module

    def run_and_register(module: Any) -> None:
        del loader.exec_module  # as it was
        run(module)
        import limberjack.gym  # noqa: F401 (registers)

    loader.exec_module = run_and_register


if "gymnasium" not in sys.modules:
    sys.meta_path.insert(0, _Waiting())
