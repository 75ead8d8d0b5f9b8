"""Rows of a device go on on the CPU."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.randomize import scale

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
gpu: Any = pytest.importorskip("limberjack.gpu.vector")

_CASES: list[tuple[str, str, dict[str, Any]]] = [
    ("humanoid", "walk", {}),
    ("manipulator", "bring_ball", {}),
    ("cheetah", "run", {"randomize": {"body_mass": scale(0.5, 2.0)}}),
]


@pytest.mark.parametrize(("domain", "task", "kwargs"), _CASES)
def test_a_batch_and_an_environment_on_the_cpu_continue_from_rows_of_a_device(
    domain: str, task: str, kwargs: dict[str, Any]
) -> None:
    envs = gpu.load_vector(domain, task, 4, device="cpu", seed=0, flat=False, **kwargs)
    envs.reset()
    actions = torch.full(envs.action_space.shape, 0.1)
    for _ in range(4):
        envs.step(actions)
    found, *_ = envs.step(actions)
    snapshot = envs.to_cpu([1, 3])
    assert list(snapshot.step_count) == [5, 5]
    batch = suite.load_batch(domain, task, 2, 1, environment_kwargs=kwargs)
    batch.restore(snapshot)
    now = batch.task.get_observation(batch.physics)
    for name, values in now.items():
        # The same state in float32 and in float64.
        np.testing.assert_allclose(as_numpy(found[name])[[1, 3]], values, rtol=1e-3, atol=1e-4)
    found, reward, *_ = envs.step(actions)
    expected = batch.step(as_numpy(actions)[:2])
    np.testing.assert_allclose(as_numpy(reward)[[1, 3]], expected.reward, atol=1e-4)
    np.testing.assert_array_equal(as_numpy(envs.batch.counter.steps)[[1, 3]], batch._counter.steps)
    single = suite.load(domain, task, environment_kwargs=kwargs)
    single.restore(envs.to_cpu([2]))
    assert single.is_running
    batch.reset()  # the rows' next episodes are the first ones of their seeds
    again = suite.load_batch(domain, task, 4, 1, seed=0, environment_kwargs=kwargs).reset()
    for name, values in batch.task.get_observation(batch.physics).items():
        np.testing.assert_array_equal(values, again.observation[name][[1, 3]])
    envs.close()
