"""`replacing`: a file appears whole or not at all.

    with replacing(Path("result.json")) as partial:
        partial.write_text(text)

It guards against failures and interrupts, not against a loss of power: nothing is flushed to disk.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

__all__ = ["partial_path", "replacing"]


def partial_path(path: Path) -> Path:
    """Where to write a file that is to take the place of `path` when it is whole.

    It lies beside `path`, hidden, and ends alike, for programs that choose a format by the ending.
    """
    return path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to; on a clean exit what was written takes the place of `path`.

    If the body raises, what was written is removed and `path` stays as it was. An error of writing,
    as on a full disk, which does not say where, is given the file's name.
    """
    partial = partial_path(path)
    try:
        yield partial
        os.replace(partial, path)
    except BaseException as error:
        partial.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise
