"""Every task on a device beside the CPU: starts, one control step, and the steps of an episode."""

import functools
from typing import Any

import pytest

from limberjack import suite

from .on_device import torch

pytestmark = pytest.mark.gpu
compared: Any = pytest.importorskip("tests.gpu.compared")

# Where float32 makes larger differences; docs/gpu.md has the cause.
_REWARD = {("dog", "stand"): 1e-5, ("dog", "walk"): 1e-5, ("dog", "trot"): 1e-5}


@functools.cache
def _figures(domain: str, task: str) -> Any:
    return compared.compared(domain, task)


_EVERY = pytest.mark.parametrize(
    ("domain", "task"), [task for task in suite.ALL_TASKS if task in compared.SUPPORTED]
)


@_EVERY
def test_starts_are_the_cpus_and_episodes_end_when_the_cpus_do(domain: str, task: str) -> None:
    figures = _figures(domain, task)
    assert figures.start <= 0  # beyond 1e-6 + 1e-5 of the value
    assert figures.endings == 0
    assert figures.overflows == 0
    assert torch is not None


@_EVERY
def test_a_control_step_from_a_start_agrees_with_the_cpu(domain: str, task: str) -> None:
    figures = _figures(domain, task)
    assert figures.first <= 1e-5
    assert figures.first_reward <= 1e-6


@_EVERY
def test_steps_along_an_episode_agree_with_the_cpu(domain: str, task: str) -> None:
    figures = _figures(domain, task)
    assert figures.p90 <= 2e-4
    assert figures.flips <= 0.005
    assert figures.reward <= _REWARD.get((domain, task), 2e-6)
