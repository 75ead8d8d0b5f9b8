"""The command line as it was typed, for the pages that commands write."""

import shlex
import sys

__all__ = ["command_line"]


def command_line() -> str:
    """The command of this process, quoted for a shell; bytes that are no text are replaced."""
    typed = shlex.join(["limberjack", *sys.argv[1:]])
    return typed.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
