"""`illustrate`: draws the median episode of a dataset for its card.

    illustrate(Path("walk"))        # median-SEED.png, median-SEED.mp4, and the card shows them

The episode is drawn once: where both files are there, nothing is done. Pictures depend on OpenGL,
and no file of episodes does. What cannot be drawn is logged and left out, because the dataset is
complete without it.
"""

import contextlib
import re
import tempfile
from pathlib import Path

from limberjack.episodes.card import median_seed, names_of, write_card
from limberjack.episodes.dataset import Dataset
from limberjack.episodes.environments import inside
from limberjack.episodes.films import drawable, film
from limberjack.episodes.loading import load
from limberjack.episodes.manifest import MANIFEST, NOT_DRAWN, Manifest
from limberjack.episodes.places import Place, exists, filling, named
from limberjack.episodes.recipe import environments_of
from limberjack.mujoco.rendering import RenderingError
from limberjack.rl.contract import PhysicsError
from limberjack.see.video import first_camera
from limberjack.utils import png
from limberjack.utils.log import log
from limberjack.workers.factories import Make

__all__ = ["illustrate"]

_SIZE = 240, 320  # height and width, pixels: a card is a page with text; drawing takes less time
_DRAWN = re.compile(r"median-\d{10}\.(png|mp4)")  # see `card.names_of`
_FAILURES = (ImportError, OSError, PhysicsError, RenderingError, ValueError)  # of `film`


def illustrate(directory: Place, make: Make | None = None) -> None:
    """Draws a picture and a film of the median episode, unless they are there.

    Args:
      directory: of a dataset, which no other process writes to.
      make: as for `limberjack.data.replay`.

    Raises:
      OSError: the folder cannot be read, or the card not written.
      ValueError: a file of the dataset is damaged.
    """
    dataset = load(directory if isinstance(directory, Path) else str(directory))
    manifest = Manifest.read(directory / MANIFEST)
    assert manifest is not None  # `load` has read it
    figures = [shard.figures() for shard in dataset.shards]
    seed = median_seed(manifest, figures)
    names = names_of(seed)
    if all(exists(directory / name) for name in names):
        return
    for name, draw in zip(names, (_first_picture, _film), strict=True):
        try:
            content = draw(dataset, seed, make)
            with filling(directory / name, directory) as partial:
                partial.write_bytes(content)
        except _FAILURES as error:
            log.warning(NOT_DRAWN, directory, name, error)
    for other in named(directory, "median-*"):
        if other.name not in names and _DRAWN.fullmatch(other.name):  # of the median before
            other.unlink()
    write_card(directory, manifest, figures)


def _first_picture(dataset: Dataset, seed: int, make: Make | None) -> bytes:
    """The picture of an episode's start, as a PNG."""
    environment, factory = environments_of(dataset.recipe, make)
    environment.close()
    with contextlib.closing(drawable(factory.make, *_SIZE)(seed)) as one:
        one.reset()
        physics = inside(one).physics
        picture = physics.render(*_SIZE, camera_id=first_camera(physics.model))
    return png.encode(picture)


def _film(dataset: Dataset, seed: int, make: Make | None) -> bytes:
    """The film of an episode, as an MP4."""
    height, width = _SIZE
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        film(dataset, seed, make, out=path, height=height, width=width)
        return path.read_bytes()
