"""The command line as it was typed, for the pages that commands write."""

import shlex
import sys

__all__ = ["command_line"]


def command_line() -> str:
    """The command of this process, quoted for a shell."""
    return shlex.join(["limberjack", *sys.argv[1:]])
