"""`converted`: a folder in another format, put in its place when it is complete.

    with converted(root / "walk", is_ours) as partial:
        (partial / "data").write_bytes(...)

An earlier conversion is replaced, and nothing else is.
"""

import contextlib
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from limberjack.utils.files import Hold, flush_folder, random_letters

__all__ = ["converted"]


@contextlib.contextmanager
def converted(
    folder: Path, is_ours: Callable[[Path], bool], choice: str = "another folder"
) -> Iterator[Path]:
    """A new empty folder, which takes the place of `folder` when the context ends.

    What a process that was killed left of an earlier conversion to the same place is removed.

    Args:
      folder: an absolute path; the folders above it are created.
      is_ours: whether a folder is an earlier conversion, which may be replaced.
      choice: what to choose instead, for the message.

    Raises:
      ValueError: `folder` is something else. After this and any other error nothing is left.
      OSError: a file cannot be written.
    """
    if os.path.lexists(folder) and not is_ours(folder):
        raise ValueError(f"{folder} exists: remove it, or choose {choice}")
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.{random_letters()}")
    unfinished = re.compile(rf"\.{re.escape(folder.name)}\.[0-9a-f]{{16}}")
    with Hold(folder):
        for left in folder.parent.iterdir():
            if unfinished.fullmatch(left.name):  # of a process that was killed
                shutil.rmtree(left, ignore_errors=True)
        partial.mkdir()  # fails where anything is
        try:
            yield partial
            if folder.exists():
                shutil.rmtree(folder)
            partial.rename(folder)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
    flush_folder(folder.parent)
