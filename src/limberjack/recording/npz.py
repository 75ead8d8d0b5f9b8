"""`read_arrays`: safe reading of an .npz file from an untrusted source.

    arrays = read_arrays(Path("episode-3.npz"))    # {"actions": array(...), ...}

`numpy.load` trusts the sizes in a file, and reports damage as a dozen kinds of errors. Here memory
use is bounded by the file's verified size, nothing is unpickled, and a damaged file raises
ValueError.
"""

import math
import warnings
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from limberjack.utils.regular import open_regular

__all__ = ["read_arrays"]

_ENDING = ".npy"
_MOST_BYTES = 2**30  # of all arrays; an hour of a humanoid's steps fills a third of it
_FORMATS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays in a file, by name.

    Raises:
      OSError: the file cannot be read.
      ValueError: it is not an .npz of plain arrays, is damaged, or holds more than 1 GiB.
    """
    with open_regular(path) as file:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # NumPy warns about headers that only damage causes
                return _read(file)
        except (OSError, ValueError):
            raise
        # Damage can raise anything in the parsers of zip files and headers: zlib's errors,
        # EOFError, KeyError, NotImplementedError, RuntimeError, struct's errors, MemoryError...
        except Exception as error:
            raise ValueError(f"{type(error).__name__}: {error}") from error


def _read(file: IO[bytes]) -> dict[str, np.ndarray]:
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        size = sum(entry.file_size for entry in entries)
        if size > _MOST_BYTES:
            raise ValueError(f"its arrays fill {size:,} bytes; expected at most {_MOST_BYTES:,}")
        arrays = {}
        for entry in entries:
            name = entry.filename.removesuffix(_ENDING)
            if name == entry.filename or name in arrays:
                raise ValueError(f"it holds {entry.filename!r}; expected one {_ENDING} per array")
            with archive.open(entry) as content:
                arrays[name] = _array(name, content, entry.file_size)
        return arrays


def _array(name: str, content: IO[bytes], size: int) -> np.ndarray:
    """The array of a .npy file of so many bytes, whose header must agree."""
    version = np.lib.format.read_magic(content)
    if version not in _FORMATS:
        raise ValueError(f"{name!r} is in version {version} of the format; expected 1.0 or 2.0")
    shape, fortran_order, dtype = _FORMATS[version](content)
    if dtype.hasobject:
        raise ValueError(f"{name!r} holds pickled objects; expected numbers")
    expected = math.prod(shape) * dtype.itemsize
    fits = expected == size - content.tell() and min(shape, default=1) >= 0
    if not fits or not dtype.itemsize:
        raise ValueError(f"{name!r} has shape {shape} and dtype {dtype}, which do not fit its size")
    # To the end, where the zip file's own check of the content is.
    values = np.zeros(math.prod(shape), dtype)
    values.view(np.uint8)[:] = np.frombuffer(content.read(), np.uint8)
    return values.reshape(shape, order="F" if fortran_order else "C")
