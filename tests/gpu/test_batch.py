"""A user's own tasks run on a device as they are, or are refused with the reason."""

from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import suite
from limberjack.gpu.sizes import Sizes
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import cheetah

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
batches: Any = pytest.importorskip("limberjack.gpu.batch")


class _Glide(cheetah.Cheetah):
    """Maps one action to all actuators, reads forces, ends episodes, and has a plain reward."""

    def action_spec(self, physics: Any) -> Any:
        return specs.BoundedArray((1,), float, -1.0, 1.0)

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(np.concatenate([action, -action] * 3, axis=-1))

    def get_observation(self, physics: Any) -> Any:
        observation = super().get_observation(physics)
        observation["forces"] = physics.data.qfrc_actuator.copy()
        return observation

    def get_reward(self, physics: Any) -> Any:
        return 2.0 * physics.data.qpos[..., 0]

    def get_termination(self, physics: Any) -> Any:
        ends = physics.data.qpos[..., 1] < -0.05
        if physics.num_envs is None:
            return 0.0 if ends else None
        return np.where(ends, 0.0, np.nan)


def _environment(task: Any) -> control.Environment:
    physics = suite.load("cheetah", "run").physics
    return control.Environment(physics, task, time_limit=1.0)


def _batch(task: Any, rows: int = 6) -> Any:
    options = batches.Options(Sizes(32, 96), 0.0, False, True)
    return batches.DeviceBatch(_environment(task), rows, torch.device("cpu"), 0, options)


def test_a_task_of_ones_own_runs_as_it_is() -> None:
    ours = _batch(_Glide(random=0))
    theirs = BatchEnvironment.from_environment(_environment(_Glide(random=0)), 6, 1, seed=0)
    found, expected = ours.reset(), theirs.reset()
    np.testing.assert_allclose(as_numpy(found["forces"]), expected.observation["forces"], atol=1e-5)
    action = np.linspace(-1, 1, 6, dtype=np.float32)[:, None]
    ended = 0
    for step in range(25):
        outcome, expected = ours.step(torch.from_numpy(action)), theirs.step(action)
        np.testing.assert_array_equal(as_numpy(outcome.ending.last), expected.step_type == 2)
        ended += int(as_numpy(outcome.ending.terminated).sum())
        assert outcome.terms == {}
        assert outcome.success is None
        if step < 5:
            np.testing.assert_allclose(as_numpy(outcome.reward), expected.reward, atol=1e-4)
            forces = expected.observation["forces"]
            np.testing.assert_allclose(
                as_numpy(outcome.observation["forces"]), forces, rtol=1e-3, atol=1e-3
            )
        if ended:
            break
    assert ended
    ours.close()


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (lambda physics: float(physics.data.qpos[0, 0]), r"float\(\) would take"),
        (lambda physics: np.asarray(physics.data.qpos)[:, 0], r"np\.asarray\(\) would take"),
        (lambda physics: np.median(physics.data.qpos, axis=-1), r"np\.median is not available"),
        (lambda physics: physics.data.ncon * 1.0, "has no 'ncon'"),
    ],
)
def test_code_that_leaves_the_protocols_is_refused_with_the_tasks_name(
    code: Any, message: str
) -> None:
    class Wrong(_Glide):
        def get_reward(self, physics: Any) -> Any:
            return code(physics)

    with pytest.raises(TypeError, match=f"task Wrong cannot run on a device: .*{message}"):
        _batch(Wrong(random=0))


def test_sizes_of_sites_that_sensors_measure_within_cannot_differ() -> None:
    environment = suite.load("finger", "turn_easy")
    initialize = type(environment.task).initialize_episode

    class Grown(type(environment.task)):
        def initialize_episode(self, physics: Any) -> None:
            initialize(self, physics)
            physics.named.model.site_size["touchtop", 0] *= 2

    environment._task = Grown(0.07, random=0)
    options = batches.Options(Sizes(32, 64), 0.0, False, True)
    batch = batches.DeviceBatch(environment, 2, torch.device("cpu"), 0, options)
    with pytest.raises(ValueError, match="episodes set site_size of sites that sensors measure"):
        batch.reset()
