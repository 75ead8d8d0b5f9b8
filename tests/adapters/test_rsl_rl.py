"""The adapter for rsl_rl, alone and under its own runner."""

from typing import Any

import numpy as np
import pytest

from tests.gpu.on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
pytest.importorskip("rsl_rl", reason="needs the extra 'rsl-rl'")
adapter: Any = pytest.importorskip("limberjack.adapters.rsl_rl")
gpu: Any = pytest.importorskip("limberjack.gpu.vector")


def _envs(**kwargs: Any) -> Any:
    given = {"autoreset_mode": "SameStep", "time_limit": 0.06, **kwargs}
    return gpu.load_vector("cheetah", "run", 4, device="cpu", seed=0, **given)


def test_steps_have_the_form_that_rsl_rl_reads() -> None:
    envs = adapter.RslRlVecEnv(_envs())
    assert (envs.num_envs, envs.num_actions, envs.max_episode_length) == (4, 6, 6)
    assert envs.get_observations()["policy"].shape == (4, 17)
    for _ in range(5):
        envs.step(torch.full((4, 6), 7.0))
    observations, rewards, dones, extras = envs.step(torch.full((4, 6), 7.0))
    assert as_numpy(dones).all()
    assert as_numpy(extras["time_outs"]).all()
    assert rewards.shape == (4,)
    assert list(extras["log"]) == ["/speed"]
    assert not as_numpy(envs.episode_length_buf).any()
    envs.episode_length_buf = torch.tensor([5, 0, 5, 0])
    _, _, dones, _ = envs.step(torch.zeros(4, 6))
    np.testing.assert_array_equal(as_numpy(dones), [True, False, True, False])
    assert observations["policy"].dtype == torch.float32


def test_environments_that_do_not_fit_are_refused() -> None:
    for kwargs in ({"autoreset_mode": "NextStep"}, {"flat": False}):
        with pytest.raises(ValueError, match="does not fit rsl_rl"):
            adapter.RslRlVecEnv(_envs(**kwargs))
