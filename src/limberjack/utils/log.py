"""The package's logger: silent unless the program sets up logging.

logging.basicConfig()       # shows MuJoCo's warnings and which rows of a batch diverged
"""

import logging

__all__ = ["log"]

log = logging.getLogger("limberjack")
# Without a handler, Python would print warnings even if the program has not set up logging.
log.addHandler(logging.NullHandler())
