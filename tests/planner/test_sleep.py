"""Rows of a model in which islands sleep are loaded as if nothing had happened before."""

import mujoco
import numpy as np

from limberjack import suite
from limberjack.planner.planning_model import enable_sleep
from limberjack.planner.rollouts import Rollouts

_ROWS, _STEPS = 6, 90


def _batch() -> Rollouts:
    """A batch of four boxes each, which may sleep."""
    env = suite.load("stacker", "stack_4", {"random": 0})
    twin = env.physics.copy()
    enable_sleep(twin.model.ptr)
    return Rollouts(twin, _ROWS, 2, env.task.EPISODE_FIELDS)


def _start(seed: int) -> dict[str, np.ndarray]:
    env = suite.load("stacker", "stack_4", {"random": seed})
    env.reset()
    for _ in range(200):  # boxes have fallen, and most lie still
        env.step(np.zeros(5))
    return env.physics.simulation.save(None, env.task.EPISODE_FIELDS)


def _rolled_out(
    batch: Rollouts, start: dict[str, np.ndarray], steps: int = _STEPS
) -> dict[str, np.ndarray]:
    batch.load(start)
    controls = np.random.default_rng(0).uniform(-1, 1, (_ROWS, steps, 5))
    records, diverged = batch.roll_out(controls, ["qpos", "site_xpos"])
    assert not diverged.any()
    return records


def test_a_row_forgets_what_lay_still_before_and_where_a_target_was() -> None:
    first, second = _start(1), _start(2)
    expected = _rolled_out(_batch(), second)
    # After a few steps what lies still is about to sleep, after many it does.
    for before in ((first, _STEPS), (second, 5), (second, _STEPS)):
        used = _batch()
        _rolled_out(used, *before)
        found = _rolled_out(used, second)
        for name, values in expected.items():
            np.testing.assert_array_equal(found[name], values, name)
        assert (used.simulation._official.bind("tree_asleep") >= 0).any()


def test_nothing_sleeps_in_the_suites_own_models() -> None:
    for domain, task in suite.ALL_TASKS:
        model = suite.load(domain, task).physics.model._official
        assert not model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP.value
