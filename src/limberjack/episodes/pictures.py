"""`pictures`: an episode of a dataset as pictures, drawn from its states.

    drawn = pictures(load("walk"), seed=3, pixels=Pixels(camera="side"))    # (T + 1, 84, 84, 3)

They equal those that `collect --pixels` keeps, byte for byte with the same OpenGL, and need neither
the policy nor the versions of the recipe.
"""

import contextlib

import numpy as np

from limberjack.episodes.dataset import Dataset
from limberjack.episodes.environments import inside
from limberjack.episodes.recipe import environments_of
from limberjack.mujoco.simulation import STATE
from limberjack.rl.pixels import Pixels
from limberjack.workers.factories import Make

__all__ = ["pictures"]


def pictures(
    dataset: Dataset, seed: int, pixels: Pixels | None = None, make: Make | None = None
) -> np.ndarray:
    """The pictures before each step and after the last one, (T + 1, height, width, 3) uint8.

    Args:
      dataset: with states, of a domain that is known here, or of environments that `make` makes.
      seed: of the episode.
      pixels: camera, size and quality; by default those of the pictures that the dataset keeps, or
        of `Pixels()`.
      make: as for `limberjack.data.replay`.

    Raises:
      KeyError: there is no such episode.
      ValueError: the dataset has no states, or there is no such camera; or see `replay`.
      RenderingError: OpenGL is not available.
    """
    if not dataset.recipe.kept.states:
        raise ValueError(
            "the dataset has no states to draw: collect it with states (--states), or film an "
            "episode, which simulates it again"
        )
    episode = dataset.episode(seed)
    assert episode.states is not None
    pixels = pixels or dataset.recipe.kept.pixels or Pixels()
    environment, factory = environments_of(dataset.recipe, make)
    environment.close()
    with contextlib.closing(factory.make(seed)) as one:
        one.reset()  # draws the model fields
        physics = inside(one).physics
        drawn = []
        for state in episode.states:
            physics.set_state(state, STATE)
            physics.forward()
            drawn.append(physics.render(**pixels.render_kwargs))
    return np.stack(drawn)
