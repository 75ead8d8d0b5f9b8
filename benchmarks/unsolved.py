"""Pictures of the starts that a policy did not solve, each with its seed.

picture = draw(json.loads(Path("result.json").read_text()))  # (height, width, 3), or None
"""

from typing import Any

import numpy as np

from limberjack import suite
from limberjack.mujoco import TextOverlay
from limberjack.see.video import mosaic

__all__ = ["draw", "seeds_of"]

_SIZE = 150, 200  # pixels of one
_COLUMNS = 5
_CAMERA = "fixed"  # of the arm's domains


def seeds_of(result: dict[str, Any]) -> list[int]:
    """Seeds of the episodes that were not solved."""
    return [episode["seed"] for episode in result["episodes"] if not episode["success"]]


def draw(result: dict[str, Any]) -> np.ndarray | None:
    """Starts of unsolved episodes side by side, (height, width, 3) uint8; None without any."""
    pictures = [_start(result["domain"], result["task"], seed) for seed in seeds_of(result)]
    return mosaic(pictures, columns=min(_COLUMNS, len(pictures))) if pictures else None


def _start(domain: str, task: str, seed: int) -> np.ndarray:
    environment = suite.load(domain, task, task_kwargs={"random": seed})
    environment.reset()
    label = TextOverlay(str(seed), position="bottom left")
    picture = environment.physics.render(*_SIZE, _CAMERA, [label])
    environment.close()
    return picture
