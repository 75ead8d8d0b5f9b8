"""`REFUSED`: the suite's tasks that cannot run on a device, with the reason.

Loading one raises ValueError with the reason. A test compares the list with the tasks that load.
"""

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["REFUSED"]

REFUSED: Mapping[tuple[str, str], str] = MappingProxyType(
    {
        ("point_mass", "hard"): (
            "each episode draws the directions of the controls (wrap_prm), which MuJoCo Warp "
            "shares between all rows"
        ),
        ("quadruped", "escape"): (
            "each episode draws a terrain (hfield_data), which MuJoCo Warp shares between all rows"
        ),
    }
)
