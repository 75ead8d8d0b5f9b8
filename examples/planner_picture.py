"""What the planner looked at before it acted: the ways of the hand in all plans that it tried.

    python examples/planner_picture.py --steps 58 --out plans.png

A cost sees every simulated state, so one that keeps notes shows what was simulated. Orange are the
ways of plans that cost least, blue those of the others.
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
_BEST = 8  # plans that are drawn as good ones


class Watched(Cost):
    """Another cost, and the ways that a site takes while it is asked."""

    def __init__(self, cost: Cost, site: str) -> None:
        """Takes the cost that is planned with, and the site's name."""
        super().__init__(cost.task)
        self.settings = cost.settings
        self._cost = cost
        self._site = site
        self.ways, self.total = np.zeros((0, 0, 3)), np.zeros(0)
        self.reset, self.proposals, self.stage = cost.reset, cost.proposals, cost.stage

    def update(self, physics: Any) -> None:
        """As the other cost."""
        self._cost.update(physics)

    def step_cost(self, physics: Any) -> np.ndarray:
        """The other cost, noted with the site's ways."""
        cost = self._cost.step_cost(physics)
        places = physics.named.data.site_xpos[self._site].copy()
        moments = -1, self.settings.samples
        self.ways = places.reshape(*moments, 3).swapaxes(0, 1)  # (samples, moments, 3)
        self.total = cost.reshape(moments).sum(axis=0)
        return cost


def draw(env: Any, watched: Watched) -> np.ndarray:
    """A picture of the environment with the noted ways in it."""
    ways = watched.ways
    order = np.argsort(watched.total)[::-1]  # the best last: it is drawn over the others

    def add_ways(physics: Any, scene: Any) -> None:
        for rank, row in enumerate(order):
            look = _GOOD if len(order) - rank <= _BEST else _OTHER
            for start, end in zip(ways[row, :-2:2], ways[row, 2::2], strict=False):
                _add_line(scene, start, end, *look)

    most = env.physics.model.ngeom + ways[..., 0].size  # that can be drawn
    camera = Camera(env.physics, _HEIGHT, _WIDTH, "fixed", most, add_ways)
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
    """Plays, then draws."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=58, help="to play first")
    parser.add_argument("--seed", type=int, default=1003)
    parser.add_argument("--out", type=Path, default=Path("plans.png"))
    given = parser.parse_args()
    env = suite.load("manipulator", "bring_ball", task_kwargs={"random": given.seed})
    watched = Watched(cost_for(env.task), "grasp")
    planner = Planner(env, cost=watched, seed=given.seed)
    env.reset()
    for _ in range(given.steps):
        env.step(planner.act())
    given.out.write_bytes(png.encode(draw(env, watched)))
    print(f"{len(watched.total)} plans of {watched.ways.shape[1]} steps drawn in {given.out}")


if __name__ == "__main__":
    main()
