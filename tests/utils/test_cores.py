"""Usable cores, according to affinity and cgroup quotas."""

import os
from pathlib import Path

import pytest

from limberjack.utils import cores


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine of 16 cores without quotas; its control groups are files below the path."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(16)), raising=False)
    monkeypatch.setattr(cores, "_CGROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(cores, "_OWN_CGROUPS", tmp_path / "own")
    return tmp_path


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_without_a_quota_all_cores_may_be_used(machine: Path) -> None:
    assert cores.usable_cores() == 16
    _write(machine / "cgroup/cpu.max", "max 100000\n")
    assert cores.usable_cores() == 16


def test_a_container_sees_its_quota_at_the_root(machine: Path) -> None:
    _write(machine / "own", "0::/\n")
    _write(machine / "cgroup/cpu.max", "250000 100000\n")
    assert cores.usable_cores() == 3


@pytest.mark.parametrize(("own", "expected"), [("/jobs/7", 2), ("/jobs/8", 4), ("/other", 16)])
def test_the_least_of_all_groups_around_counts(machine: Path, own: str, expected: int) -> None:
    _write(machine / "own", f"12:cpuset:/elsewhere\n0::{own}\n")
    _write(machine / "cgroup/jobs/cpu.max", "400000 100000\n")
    _write(machine / "cgroup/jobs/7/cpu.max", "150000 100000\n")
    _write(machine / "cgroup/jobs/8/cpu.max", "max 100000\n")
    assert cores.usable_cores() == expected


def test_the_first_version_of_control_groups_counts_too(machine: Path) -> None:
    _write(machine / "cgroup/cpu/cpu.cfs_quota_us", "-1\n")
    _write(machine / "cgroup/cpu/cpu.cfs_period_us", "100000\n")
    assert cores.usable_cores() == 16
    _write(machine / "cgroup/cpu/cpu.cfs_quota_us", "50000\n")
    assert cores.usable_cores() == 1
