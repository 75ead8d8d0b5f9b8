"""How many processor cores this process may really use."""

import math
import os
import pathlib
from collections.abc import Iterator

__all__ = ["usable_cores"]

_CGROUPS = pathlib.Path("/sys/fs/cgroup")
_OWN_CGROUPS = pathlib.Path("/proc/self/cgroup")


def usable_cores() -> int:
    """Cores that the scheduler grants: by affinity and by the container's quota, at least 1."""
    try:
        cores = len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        cores = os.cpu_count() or 1
    return max(1, min([cores, *_quotas()]))


def _quotas() -> Iterator[int]:
    """The quotas of the control groups that this process is in, whole cores."""
    for quota, period in (*_limits(), *_old_limits()):
        try:
            if int(quota) > 0:  # -1 is no limit in the old kind
                yield math.ceil(int(quota) / int(period))
        except (ValueError, ZeroDivisionError):  # 'max': no limit
            pass


def _limits() -> Iterator[tuple[str, str]]:
    """Quota and period of the process' group and of those around it; see cgroups(7)."""
    own = next((line[3:] for line in _lines(_OWN_CGROUPS) if line.startswith("0::/")), "/")
    group = pathlib.PurePosixPath(own)
    for around in (group, *group.parents):
        for line in _lines(_CGROUPS / str(around).lstrip("/") / "cpu.max"):
            quota, _, period = line.partition(" ")
            yield quota, period


def _old_limits() -> Iterator[tuple[str, str]]:
    """The same in the first version of control groups, as a container sees them."""
    names = "cpu.cfs_quota_us", "cpu.cfs_period_us"
    yield from zip(*(_lines(_CGROUPS / "cpu" / name) for name in names), strict=False)


def _lines(path: pathlib.Path) -> list[str]:
    try:
        return path.read_text().splitlines()
    except OSError:  # no such file
        return []
