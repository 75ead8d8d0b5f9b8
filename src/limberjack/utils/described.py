"""Errors of a user's code on one line: notes, kind, text, and the line of code that raised them.

    described(error)    # "policy 'my:act', step 3: KeyError: 'x' (my.py, line 7, in act)"

If the traceback passes through the user's own code, the innermost line there is named, and not one
in a library that it called.
"""

import os
import sysconfig
import traceback
from pathlib import Path

__all__ = ["described", "is_of_user", "place_of"]

_PACKAGE = str(Path(__file__).parents[1])
_LONGEST_TEXT = 1000  # characters of an error's own text that a line shows
_STANDARD = sysconfig.get_path("stdlib")
_LIBRARIES = tuple({sysconfig.get_path(name) for name in ("purelib", "platlib")})


def described(error: BaseException) -> str:
    """The error on one line."""
    text = " ".join(str(error).split())
    text = text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}..."
    notes = [" ".join(note.split()) for note in getattr(error, "__notes__", [])]
    line = ": ".join([*notes, type(error).__name__, *([text] if text else [])])
    place = place_of(error)
    return line if place is None else f"{line} ({place})"


def is_of_user(error: BaseException) -> bool:
    """Whether the traceback passes through code that is neither this package's nor installed."""
    return any(map(_is_of_user, traceback.extract_tb(error.__traceback__)))


def place_of(error: BaseException) -> str | None:
    """File, line and function of the innermost frame in the user's code.

    Without one, of that in an installed library; None if there is none either.
    """
    frames = traceback.extract_tb(error.__traceback__)
    libraries = [frame for frame in frames if any(_is_in(frame.filename, f) for f in _LIBRARIES)]
    chosen = [frame for frame in frames if _is_of_user(frame)] or libraries
    if not chosen:
        return None
    frame = chosen[-1]
    return f"{_short(frame.filename)}, line {frame.lineno}, in {frame.name}"


def _is_of_user(frame: traceback.FrameSummary) -> bool:
    file = frame.filename
    if file.startswith("<frozen "):
        return False
    return not any(_is_in(file, folder) for folder in (_PACKAGE, _STANDARD, *_LIBRARIES))


def _is_in(file: str, folder: str) -> bool:
    return file.startswith(folder + os.sep)


def _short(file: str) -> str:
    """The path from the working directory, if it is below it."""
    try:
        return str(Path(file).relative_to(Path.cwd()))
    except (OSError, ValueError):
        return file
