"""Disarms a hook left behind by an older installation.

Pre-release versions of 0.1.0 installed a file `limberjack-gymnasium.pth`, whose line
`import limberjack._gymnasium_plugin` Python runs at every start. `limberjack` detects this and
imports nothing. This module then removes the empty package from `sys.modules`, so that a later
import of `limberjack` loads it in full. Delete the file from `site-packages` to remove the hook.
"""

import sys

__all__: list[str] = []

_PACKAGE = "limberjack"


class _Removal:
    """A finder that, at the next import of anything, removes the package and itself."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        """Finds nothing."""
        sys.meta_path.remove(self)  # pyright: ignore[reportArgumentType]
        for module in [n for n in sys.modules if n.partition(".")[0] == _PACKAGE]:
            del sys.modules[module]


# Otherwise the package was already imported in full.
if f"{_PACKAGE}.gym" not in sys.modules:
    sys.meta_path.insert(0, _Removal())  # pyright: ignore[reportArgumentType]
