"""Memory of this process, alone or with environments, to be measured in a fresh process.

Only the standard library is imported at module level, so that each figure includes nothing else.
"""

import importlib
from pathlib import Path

__all__ = ["megabytes", "megabytes_of_all", "megabytes_of_batch"]

_SEED = 0


def megabytes_of_all() -> float | None:
    """Peak memory once every task of the suite is loaded and has begun an episode."""
    suite = importlib.import_module("limberjack.suite")
    environments = [suite.load(domain, task) for domain, task in suite.ALL_TASKS]
    for environment in environments:
        environment.reset()
    return megabytes("VmHWM")


def megabytes_of_batch(domain: str, task: str, num_envs: int, num_steps: int) -> float | None:
    """Resident memory with a batch that has taken random steps."""
    numpy = importlib.import_module("numpy")
    suite = importlib.import_module("limberjack.suite")
    environment = suite.load_batch(domain, task, num_envs, num_threads=2, seed=_SEED)
    environment.reset()
    random = numpy.random.RandomState(_SEED)
    for _ in range(num_steps):
        environment.step(random.uniform(-1, 1, environment.action_spec().shape))
    return megabytes()


def megabytes(kind: str = "VmRSS") -> float | None:
    """Memory of this process; None if the system does not report it.

    Args:
      kind: 'VmRSS' for the memory now, 'VmHWM' for its peak; the peak of Python's `resource` is at
        least the memory of the process that started this one.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    kibibytes = next(line.split()[1] for line in lines if line.startswith(f"{kind}:"))
    return round(int(kibibytes) * 1024 / 1e6, 3)
