"""Tasks that map their actions to the actuators themselves run as in dm_control."""

from typing import Any

import numpy as np
import pytest

from tests import two_arms

from .oracle import BOTH
from .same import assert_same

pytestmark = pytest.mark.oracle


def _actions(size: int, steps: int) -> np.ndarray:
    return np.random.RandomState(1).uniform(-0.5, 0.5, (steps, size))


@pytest.mark.parametrize(
    ("make", "size", "actuators"), [(two_arms.by_joints, 14, 16), (two_arms.by_pose, 16, 4)]
)
def test_an_action_may_have_another_shape_than_the_actuators(
    make: Any, size: int, actuators: int
) -> None:
    ours, theirs = (make(package) for package in BOTH)
    assert ours.physics.model.nu == actuators
    assert ours.action_spec().shape == theirs.action_spec().shape == (actuators,)
    for _ in range(2):
        assert_same(ours.reset(), theirs.reset(), "start")
        for number, action in enumerate(_actions(size, 50)):
            assert_same(ours.step(action), theirs.step(action), f"step {number}")
