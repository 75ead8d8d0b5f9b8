"""The optimal policy and value of an LQR task are dm_control's."""

import numpy as np
import pytest

from . import twins
from .oracle import ours, theirs

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize("task", ["lqr_2_1", "lqr_6_2"])
@pytest.mark.parametrize("seed", range(10))
def test_the_solution_is_the_same(task: str, seed: int) -> None:
    env = twins.load("lqr", task, seed)
    found = ours("suite.lqr_solver").solve(env.ours)
    expected = theirs("suite.lqr_solver").solve(env.theirs)
    for our_part, their_part in zip(found, expected, strict=True):
        assert type(our_part) is type(their_part)
        # SciPy solves the same equation by another algorithm.
        scale = np.max(np.abs(their_part))
        np.testing.assert_allclose(our_part, their_part, rtol=0, atol=1e-9 * scale)


def test_the_task_evaluates_states_as_dm_control_does() -> None:
    env = twins.load("lqr", "lqr_2_1")
    env.reset()
    for size in (0.02, 0.01, 0.005, 1e-6, 9e-7, 0.0):
        for one in (env.ours, env.theirs):
            with one.physics.reset_context():
                one.physics.data.qpos[:] = size, 0.0
        for method in ("get_evaluation", "get_termination"):
            values = [getattr(one.task, method)(one.physics) for one in (env.ours, env.theirs)]
            assert repr(values[0]) == repr(values[1]), (method, size)
