"""Import machinery behind `limberjack.install_as_dm_control`.

`alias` gives every Limberjack module a second name; `stand_ins` makes the parts of dm_control that
are not implemented importable. Neither imports other Limberjack modules beyond the package itself.
"""

from limberjack._compat.alias import install

__all__ = ["install"]
