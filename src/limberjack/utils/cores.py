"""`usable_cores`: the number of processor cores available to this process."""

import math
import os
import pathlib
from collections.abc import Iterator

__all__ = ["usable_cores"]

_CGROUPS = pathlib.Path("/sys/fs/cgroup")
_OWN_CGROUPS = pathlib.Path("/proc/self/cgroup")


def usable_cores() -> int:
    """Cores available under the CPU affinity and the container's quota; at least 1."""
    try:
        cores = len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        cores = os.cpu_count() or 1
    return max(1, min([cores, *_quotas()]))


def _quotas() -> Iterator[int]:
    """Quotas of this process's control groups, rounded up to whole cores."""
    for quota, period in (*_limits(), *_old_limits()):
        try:
            if int(quota) > 0:  # in cgroups v1, -1 means no limit
                yield math.ceil(int(quota) / int(period))
        except (ValueError, ZeroDivisionError):  # 'max': no limit
            pass


def _limits() -> Iterator[tuple[str, str]]:
    """Quota and period of the process's cgroup and its ancestors (v2); see cgroups(7)."""
    own = next((line[3:] for line in _lines(_OWN_CGROUPS) if line.startswith("0::/")), "/")
    group = pathlib.PurePosixPath(own)
    for around in (group, *group.parents):
        for line in _lines(_CGROUPS / str(around).lstrip("/") / "cpu.max"):
            quota, _, period = line.partition(" ")
            yield quota, period


def _old_limits() -> Iterator[tuple[str, str]]:
    """Quota and period in cgroups v1, as seen from within a container."""
    names = "cpu.cfs_quota_us", "cpu.cfs_period_us"
    yield from zip(*(_lines(_CGROUPS / "cpu" / name) for name in names), strict=False)


def _lines(path: pathlib.Path) -> list[str]:
    try:
        return path.read_text().splitlines()
    except OSError:  # no such file
        return []
