"""Makes a hook that an older installation has left behind harmless.

Version 0.1.0 before its release installed a file `limberjack-gymnasium.pth`, whose line
`import limberjack._gymnasium_plugin` Python runs at each start. `limberjack` recognises that and
imports nothing. This module then removes the empty package again, so that a later import of
`limberjack` is a first one. Remove the file from `site-packages` to be rid of it.
"""

import sys

__all__: list[str] = []

_PACKAGE = "limberjack"


class _Removal:
    """A finder that, at the next import of anything, removes the package and itself."""

    # Arguments as the import system passes them.
    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        """Finds nothing."""
        sys.meta_path.remove(self)  # pyright: ignore[reportArgumentType]
        for module in [n for n in sys.modules if n.partition(".")[0] == _PACKAGE]:
            del sys.modules[module]


# Otherwise the package was imported in full before, and this line came later.
if f"{_PACKAGE}.gym" not in sys.modules:
    sys.meta_path.insert(0, _Removal())  # pyright: ignore[reportArgumentType]
