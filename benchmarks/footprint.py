"""Memory of a process with environments; each function runs in a fresh process.

Only the standard library is imported at module level, so that each figure includes nothing else.
"""

import importlib
import os
import re
from pathlib import Path

__all__ = ["megabytes_of_all", "megabytes_of_batch"]

_SEED = 0


def megabytes_of_all() -> float:
    """Peak memory once every task of the suite is loaded and has begun an episode, on Linux."""
    suite = importlib.import_module("limberjack.suite")
    environments = [suite.load(domain, task) for domain, task in suite.ALL_TASKS]
    for environment in environments:
        environment.reset()
    # Not from `resource`, whose peak is at least the memory of the process that started this one.
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (kibibytes,) = re.findall(r"^VmHWM:\s+(\d+) kB$", status, re.MULTILINE)
    return int(kibibytes) * 1024 / 1e6


def megabytes_of_batch(domain: str, task: str, num_envs: int, num_steps: int) -> float | None:
    """Resident memory with a batch that has taken random steps; None if it is not reported."""
    numpy = importlib.import_module("numpy")
    suite = importlib.import_module("limberjack.suite")
    environment = suite.load_batch(domain, task, num_envs, num_threads=2, seed=_SEED)
    environment.reset()
    random = numpy.random.RandomState(_SEED)
    for _ in range(num_steps):
        environment.step(random.uniform(-1, 1, environment.action_spec().shape))
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
