"""Specifications from which Gymnasium makes environments again."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from limberjack.gym.specs import spec_of


def test_a_specification_makes_the_environment_also_from_json() -> None:
    spec = spec_of("pendulum", "swingup", steps=3, flat=True, dtype="float32")
    for one in (spec, EnvSpec.from_json(spec.to_json())):
        env = gymnasium.make(one)
        observation, _ = env.reset(seed=0)
        assert observation.dtype == np.float32
        ends = [env.step(env.action_space.sample())[3] for _ in range(3)]
        assert ends == [False, False, True]
        env.close()


def test_the_registered_specification_is_not_changed() -> None:
    before = gymnasium.spec("limberjack/pendulum-swingup-v0").kwargs
    spec_of("pendulum", "swingup", steps=3, flat=True)
    assert gymnasium.spec("limberjack/pendulum-swingup-v0").kwargs == before
    assert spec_of("pendulum", "swingup").max_episode_steps == 1000


def test_a_task_that_gymnasium_does_not_know_is_an_error() -> None:
    with pytest.raises(gymnasium.error.Error):
        spec_of("pendulum", "walk")
