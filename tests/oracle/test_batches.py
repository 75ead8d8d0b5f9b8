"""Row i of a batch is dm_control's own environment with seed + i, bit for bit."""

import numpy as np
import pytest

from . import twins
from .oracle import BOTH

pytestmark = pytest.mark.oracle

_SEED = 21


@pytest.mark.parametrize("num_envs", [2, 7])
@pytest.mark.parametrize("task", twins.TASKS, ids="-".join)
def test_rows_are_dm_controls_environments(task: tuple[str, str], num_envs: int) -> None:
    ours, theirs = (import_package("suite") for import_package in BOTH)
    limit = {"time_limit": 40 * ours.load(*task).control_timestep()}
    batch = ours.load_batch(*task, num_envs, 2, _SEED, task_kwargs=limit)
    singles = [theirs.load(*task, {"random": _SEED + i, **limit}) for i in range(num_envs)]
    batched, told = batch.reset(), [env.reset() for env in singles]
    actions = np.random.RandomState(0).uniform(-1, 1, (130, *batch.action_spec().shape))
    for step, action in enumerate(actions):
        for row, single in enumerate(told):
            where = f"{task} row {row} step {step}"
            assert batched.step_type[row] == int(single.step_type), where
            if not single.first():
                assert batched.reward[row] == single.reward, where
                assert batched.discount[row] == single.discount, where
            for name, value in single.observation.items():
                np.testing.assert_array_equal(batched.observation[name][row], value, where)
        if step == 25:  # from here on the rows' episodes end at different times
            batch.reset([1])
            told[1] = singles[1].reset()
        batched = batch.step(action)
        told = [env.step(a) for env, a in zip(singles, action, strict=True)]
