"""What makes Limberjack answer to the name dm_control: see `limberjack.install_as_dm_control`.

`alias` gives every module of Limberjack a second name; `stand_ins` makes what is not built
importable. Neither imports anything of Limberjack but the package itself.
"""

from limberjack._compat.alias import install

__all__ = ["install"]
