"""Picture of one planning step: the paths of the hand in all plans that were simulated.

    python examples/planner_picture.py --steps 58 --out plans.png

A cost receives every simulated state, so a cost that records positions can show what was simulated.
The plans of least cost are orange, the others blue.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from limberjack import suite
from limberjack.mujoco.camera import Camera
from limberjack.planner import Cost, Planner, cost_for
from limberjack.utils import png

_HEIGHT, _WIDTH = 420, 640  # pixels
_GOOD, _OTHER = ((1.0, 0.55, 0.1, 1.0), 0.003), ((0.35, 0.6, 1.0, 0.35), 0.0015)  # colour, metres
_BEST = 8  # plans that are drawn in the colour of good ones


class Recorded(Cost):
    """Another cost that also records the path of a site in each plan of the last planning step."""

    def __init__(self, cost: Cost, site: str) -> None:
        """Wraps a cost; `site` is the name of the site whose paths are recorded."""
        super().__init__(cost.task)
        self.settings = cost.settings
        self._cost = cost
        self._site = site
        self.paths, self.total = np.zeros((0, 0, 3)), np.zeros(0)
        self.reset, self.proposals, self.stage = cost.reset, cost.proposals, cost.stage

    def update(self, physics: Any) -> None:
        """Updates the wrapped cost."""
        self._cost.update(physics)

    def step_cost(self, physics: Any) -> np.ndarray:
        """The wrapped cost of each state; records the site's positions and the plans' totals."""
        cost = self._cost.step_cost(physics)
        positions = physics.named.data.site_xpos[self._site].copy()
        by_step = -1, self.settings.samples
        self.paths = positions.reshape(*by_step, 3).swapaxes(0, 1)  # (samples, steps, 3)
        self.total = cost.reshape(by_step).sum(axis=0)
        return cost


def draw(env: Any, recorded: Recorded) -> np.ndarray:
    """A picture of the environment with the recorded paths, the best plans last and on top."""
    paths = recorded.paths
    order = np.argsort(recorded.total)[::-1]

    def add_paths(physics: Any, scene: Any) -> None:
        for rank, row in enumerate(order):
            look = _GOOD if len(order) - rank <= _BEST else _OTHER
            for start, end in zip(paths[row, :-2:2], paths[row, 2::2], strict=False):
                _add_line(scene, start, end, *look)

    most = env.physics.model.ngeom + paths[..., 0].size
    camera = Camera(env.physics, _HEIGHT, _WIDTH, "fixed", most, add_paths)
    return camera.render()


def _add_line(
    scene: Any, start: np.ndarray, end: np.ndarray, colour: Sequence[float], width: float
) -> None:
    scene.ngeom += 1
    geom = scene.geoms[scene.ngeom - 1]
    capsule, no_size = mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3)
    mujoco.mjv_initGeom(geom, capsule, no_size, no_size, np.eye(3).ravel(), np.array(colour, "f"))
    mujoco.mjv_connector(geom, capsule, width, start, end)


def main() -> None:
    """Plays the first steps of an episode, then draws the last planning step."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=58, help="control steps to play first")
    parser.add_argument("--seed", type=int, default=1003)
    parser.add_argument("--out", type=Path, default=Path("plans.png"))
    given = parser.parse_args()
    env = suite.load("manipulator", "bring_ball", task_kwargs={"random": given.seed})
    recorded = Recorded(cost_for(env.task), "grasp")
    planner = Planner(env, cost=recorded, seed=given.seed)
    env.reset()
    for _ in range(given.steps):
        env.step(planner.act())
    given.out.write_bytes(png.encode(draw(env, recorded)))
    print(f"{len(recorded.total)} plans of {recorded.paths.shape[1]} steps drawn in {given.out}")


if __name__ == "__main__":
    main()
