"""The test class for batches: a correct task passes, and flawed ones fail."""

import collections
import unittest
from typing import Any

import numpy as np
import pytest

from limberjack import mujoco
from limberjack.rl import control
from limberjack.rl.batch_test_utils import BatchEnvironmentTestMixin
from limberjack.suite import base

from .odd_environments import SLIDER


class _Task(base.Task):
    """Pushes a ball along a rail."""

    def initialize_episode(self, physics: Any) -> None:
        physics.named.data.qpos["slide"] = self.random.uniform(-1, 1)

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        return collections.OrderedDict(position=physics.position())

    def get_reward(self, physics: Any) -> Any:
        return physics.position()[..., 0]


class _Remembering(_Task):
    """Counts its own calls, so rows of a batch share a counter, unlike single environments."""

    calls = 0

    def before_step(self, action: Any, physics: Any) -> None:
        super().before_step(action, physics)
        self.calls += 1

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) + (self.calls > 20)


class _Shared(_Task):
    """Draws from one stream for all rows."""

    stream = np.random.RandomState(0)

    def initialize_episode(self, physics: Any) -> None:
        physics.named.data.qpos["slide"] = self.stream.uniform(-1, 1)


def _result(task: type[_Task]) -> unittest.TestResult:
    class Laws(BatchEnvironmentTestMixin, unittest.TestCase):
        def make_single(self, seed: int) -> control.Environment:
            physics = mujoco.Physics.from_xml_string(SLIDER)
            return control.Environment(physics, task(seed), time_limit=0.02)

    result = unittest.TestResult()
    unittest.defaultTestLoader.loadTestsFromTestCase(Laws).run(result)
    return result


def test_a_task_whose_rows_are_its_single_environments_passes() -> None:
    result = _result(_Task)
    assert result.testsRun >= 4
    assert result.wasSuccessful(), result.failures + result.errors


@pytest.mark.parametrize("task", [_Remembering, _Shared])
def test_a_task_whose_rows_depend_on_each_other_fails(task: type[_Task]) -> None:
    result = _result(task)
    wrong = [*result.failures, *result.errors]
    failed = [test.id().rpartition(".")[2] for test, _ in wrong]
    assert "test_a_row_is_the_single_environment" in failed


def test_a_class_without_make_single_raises_with_advice() -> None:
    class Laws(BatchEnvironmentTestMixin):
        pass

    with pytest.raises(NotImplementedError, match=r"Laws does not define make_single\(seed\)"):
        Laws().make_single(0)
