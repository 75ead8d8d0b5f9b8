"""Shared by tests of the viewer: a program that views, in a process of its own, and its page.

view = ["-m", "limberjack", "view", "humanoid", "stand"]
with viewed_by(view, tmp_path, 480, 360) as (page, address):
    ...
"""

import contextlib
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from .chromium import SOFTWARE_WEBGL, Chromium, Page

__all__ = ["LIMIT", "serving", "viewed_by", "wait"]

LIMIT = 180.0  # seconds for anything, on the slowest machine too


@contextlib.contextmanager
def viewed_by(
    arguments: list[str], directory: Path, width: int, height: int, scale: float = 1.0
) -> Iterator[tuple[Page, str]]:
    """The page of such a program, and its address with the token."""
    with (
        Chromium(directory, *SOFTWARE_WEBGL) as browser,
        serving(arguments, directory) as address,
    ):
        yield browser.open(address, width, height, scale), address


@contextlib.contextmanager
def serving(arguments: list[str], directory: Path) -> Iterator[str]:
    """The address that Python, given these arguments, prints first; it ends with the block."""
    with subprocess.Popen(
        [sys.executable, *arguments],
        cwd=directory,
        env={**os.environ, "HOME": str(directory)},
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            found = re.match(r"http://\S+", process.stdout.readline())
            assert found, "no address was printed"
            yield found[0]
            assert process.poll() is None, "the viewer ended"
        finally:
            process.kill()


def wait(until: Callable[[], bool]) -> None:
    """Returns when something is so; fails if it is not for long."""
    end = time.monotonic() + LIMIT
    while not until():
        assert time.monotonic() < end, f"not so after {LIMIT:g} seconds"
        time.sleep(0.05)
