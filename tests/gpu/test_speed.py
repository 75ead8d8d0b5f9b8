"""The speed of a task on a device is measured beside MuJoCo Warp alone."""

from typing import Any

import pytest

from .on_device import torch

pytestmark = pytest.mark.gpu
speed: Any = pytest.importorskip("limberjack.gpu.speed")


def test_a_measurement_has_both_speeds_and_the_memory() -> None:
    told: list[str] = []
    found = speed.measure(
        *("cartpole", "balance", 4, "cpu", 0.05), on_progress=lambda what, share: told.append(what)
    )
    assert (found.task, found.num_envs, found.overflows) == ("cartpole:balance", 4, 0)
    assert found.steps_per_second > 0
    assert found.bare_steps_per_second > 0
    assert 0 < found.ratio < 1.5
    assert found.bytes_per_row > 1_000
    assert told[0] == "compiling kernels"
    assert "measuring" in told
    assert torch is not None


def test_a_time_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match=r"seconds is 0\.0"):
        speed.measure("cartpole", "balance", 4, "cpu", 0.0)
