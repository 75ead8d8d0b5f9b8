"""Every time step of every task equals dm_control's in every bit.

One seed of 130 steps, with random, zero and bang-bang actions in turn, across the end of an
episode. `make test-exactness` compares whole episodes of several seeds and every argument.
"""

import itertools

import pytest

from . import twins
from .oracle import ours

pytestmark = [pytest.mark.oracle, pytest.mark.usefixtures("compiled_once")]

_STEPS = 130
_STEPS_OF_AN_EPISODE = 80


@pytest.mark.parametrize(("domain", "task"), twins.TASKS)
def test_every_time_step_is_the_same_across_the_end_of_an_episode(domain: str, task: str) -> None:
    limit = _STEPS_OF_AN_EPISODE * ours("suite").load(domain, task).control_timestep()
    env = twins.load(domain, task, task_kwargs={"time_limit": limit})
    env.reset()
    ends = []
    for number, action in enumerate(itertools.islice(env.actions("mixed", seed=0), _STEPS)):
        if env.step(action).last():
            ends.append(number + 1)
            env.assert_same_physics("data.qpos", "data.qvel")
    assert ends == [_STEPS_OF_AN_EPISODE]
