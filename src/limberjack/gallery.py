"""Pictures of the suite: one of each task, and a sheet of all of them.

    gallery.write(Path("pictures"))  # humanoid-run.png, ..., stacker-stack_4.png, suite.png

They are drawn from the models that are simulated, in the step of an episode that `PICTURES` of a
domain's module names, so they show the tasks as they are now. With the same OpenGL driver every
call draws the same pictures.
"""

import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from limberjack import suite
from limberjack.mujoco import TextOverlay
from limberjack.rl.action_specs import bounds_to_try
from limberjack.see.video import first_camera, mosaic
from limberjack.suite import base
from limberjack.utils import png
from limberjack.utils.files import open_regular, write_whole

__all__ = ["draw", "write"]

_SHEET = "suite.png"
_COLUMNS = 9  # of the sheet
_SHEET_PICTURE = 160, 160  # pixels; wide enough for the names of tasks
_PICTURE = 480, 480  # pixels
_ACTION_SCALE = 0.3  # of the range of actions: bodies move, and nothing is thrown about

# Called with a domain and a task that is drawn next, the number of tasks drawn, and that of all.
_OnProgress = Callable[[str, str, int, int], object]


def draw(
    domain: str, task: str, height: int = 480, width: int = 480, label: bool = False
) -> np.ndarray:
    """A picture of a task, (height, width, 3) uint8.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      height: pixels.
      width: pixels.
      label: write the task's name into a corner.

    Raises:
      RenderingError: OpenGL is not available.
      ValueError: there is no such task, or the size is not positive or too large.
    """
    return _draw_sizes(domain, task, [(height, width, label)])[0]


def write(
    directory: Path, columns: int = _COLUMNS, on_progress: _OnProgress | None = None
) -> list[Path]:
    """Writes a picture of each task and the sheet into a directory.

    Args:
      directory: it is made if there is none.
      columns: number of pictures side by side in the sheet.
      on_progress: called before each task is drawn, with its domain and name, the number of tasks
        drawn so far, and that of all.

    Returns:
      The files, the sheet last.

    Raises:
      ValueError: a file of such a name is there that is no picture of an earlier call, or `columns`
        is less than 1; nothing was written.
      OSError: a file cannot be written.
      RenderingError: OpenGL is not available.
    """
    if columns < 1:
        raise ValueError(f"columns is {columns}; expected at least 1")
    for domain, task in suite.tasks():
        _check_replaceable(directory / _name(domain, task))
    _check_replaceable(directory / _SHEET)
    sizes = [(*_PICTURE, False), (*_SHEET_PICTURE, True)]
    tasks, drawn = suite.tasks(), {}
    for domain, task in tasks:
        if on_progress is not None:
            on_progress(domain, task, len(drawn), len(tasks))
        drawn[domain, task] = _draw_sizes(domain, task, sizes)
        # After the first picture: without OpenGL nothing is left, and a bad name costs no time.
        directory.mkdir(parents=True, exist_ok=True)
    files = {_name(domain, task): large for (domain, task), (large, _) in drawn.items()}
    files[_SHEET] = mosaic([small for _, small in drawn.values()], columns)
    return _write_all(directory, files)


def _draw_sizes(domain: str, task: str, sizes: list[tuple[int, int, bool]]) -> list[np.ndarray]:
    """Pictures of one step, each of a height and a width, with the task's name or without."""
    pictures_of = getattr(suite.module_of(domain), "PICTURES", {})
    shown = pictures_of.get(task, base.Picture())
    environment = suite.load(domain, task, {"random": shown.seed})
    environment.reset()
    stream = np.random.RandomState(0)
    spec = environment.action_spec()
    low, high = bounds_to_try(spec)
    for _ in range(shown.steps):
        environment.step(_ACTION_SCALE * stream.uniform(low, high, spec.shape))
    name = TextOverlay(f"{domain}\n{task}", position="bottom left")
    camera = shown.camera or first_camera(environment.physics.model)
    pictures = [
        environment.physics.render(height, width, camera, [name] if label else [])
        for height, width, label in sizes
    ]
    environment.close()
    return pictures


def _name(domain: str, task: str) -> str:
    """The file of a task's picture."""
    return f"{domain}-{task}.png"


def _check_replaceable(path: Path) -> None:
    """Raises ValueError if a file is there that no earlier call can have written."""
    if not os.path.lexists(path):
        return
    with open_regular(path) as file:
        if not png.is_encoded(file.read(png.BEGINNING)):
            raise ValueError(
                f"{path} is not a picture that an earlier call wrote: choose another folder, or "
                "remove that file"
            )


def _write_all(directory: Path, files: Mapping[str, np.ndarray]) -> list[Path]:
    paths = []
    for name, picture in files.items():
        write_whole(directory / name, png.encode(picture))
        paths.append(directory / name)
    return paths
