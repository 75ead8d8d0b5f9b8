"""The package's logger: silent unless the program sets up logging.

logging.basicConfig()       # shows MuJoCo's warnings and diverged rows of a batch
"""

import logging

__all__ = ["log"]

log = logging.getLogger("limberjack")
# Without a handler of its own Python would print warnings of a program that set up none.
log.addHandler(logging.NullHandler())
