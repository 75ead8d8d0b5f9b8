"""What tests of the viewer share: a program that views, in a process of its own, and its page.

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

__all__ = ["LIMIT", "viewed_by", "wait"]

LIMIT = 60.0  # seconds for anything, on the slowest machine too


@contextlib.contextmanager
def viewed_by(
    arguments: list[str], directory: Path, width: int, height: int, scale: float = 1.0
) -> Iterator[tuple[Page, str]]:
    """The page whose address is the first line that Python prints, given these arguments."""
    with (
        Chromium(directory, *SOFTWARE_WEBGL) as browser,
        subprocess.Popen(
            [sys.executable, *arguments],
            cwd=directory,
            env={**os.environ, "HOME": str(directory)},  # Studio keeps its settings there
            stdout=subprocess.PIPE,
            text=True,
        ) as process,
    ):
        try:
            assert process.stdout is not None
            found = re.match(r"http://\S+", process.stdout.readline())
            assert found, "no address was printed"
            yield browser.open(found[0], width, height, scale), found[0]
        finally:
            process.kill()


def wait(until: Callable[[], bool]) -> None:
    """Returns when something is so; fails if it is not for long."""
    end = time.monotonic() + LIMIT
    while not until():
        assert time.monotonic() < end, f"not so after {LIMIT:g} seconds"
        time.sleep(0.05)
