"""Shared by the tests of the Gymnasium layer: a task that ends episodes, comparison by bits."""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from limberjack import gym
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import humanoid
from tests.representatives import PAIRS

__all__ = [
    "MODES",
    "NORMALISED",
    "TASKS",
    "Falls",
    "assert_same",
    "bounds",
    "falling",
    "falling_env",
    "falling_envs",
    "told_alike",
]

TASKS = PAIRS
# The tasks with actions from -1 to 1, as Gymnasium and its users want them; the others keep
# dm_control's.
NORMALISED = [pair for pair in PAIRS if pair.values[0] not in ("lqr", "quadruped")]
MODES = [pytest.param(mode, id=mode.value) for mode in AutoresetMode]

_FALLEN = 0.8  # metres; reached after 13 to 18 steps without torques
_STEPS_TO_LIMIT = 16  # some rows fall before it, some do not


class Falls(humanoid.Humanoid):
    """Stand; the task ends the episode once the head is low."""

    def get_termination(self, physics: Any) -> Any:
        """The discount 0 where the head is low."""
        fallen = physics.head_height() < _FALLEN
        if np.ndim(fallen):
            return np.where(fallen, 0.0, np.nan)
        return 0.0 if fallen else None


def falling(random: Any = None, steps: int = _STEPS_TO_LIMIT) -> control.Environment:
    """A single environment with that task."""
    physics = humanoid.Physics.from_shared_xml(*humanoid.get_model_and_assets())
    task = Falls(move_speed=0, pure_state=False, random=random)
    return control.Environment(physics, task, time_limit=steps * 0.025, control_timestep=0.025)


def falling_env(steps: int = _STEPS_TO_LIMIT, **kwargs: Any) -> gym.Env:
    """`Env` with that task."""
    return gym.Env(falling(steps=steps), **kwargs)


def falling_envs(
    *sizes: int, steps: int = _STEPS_TO_LIMIT, num_threads: int = 2, **kwargs: Any
) -> gym.VectorEnv:
    """`VectorEnv` with that task, of one batch or of two halves."""
    single = falling(steps=steps)
    batches = [BatchEnvironment.from_environment(single, n, num_threads) for n in sizes]
    return gym.VectorEnv(*batches, **kwargs)


def bounds(space: Any) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest actions to try: those of the space, or -1 and 1."""
    return np.maximum(space.low, -1.0), np.minimum(space.high, 1.0)


def assert_same(one: Any, other: Any, where: str = "") -> None:
    """Fails unless two nested results have the same structure, types and bits."""
    if isinstance(one, dict):
        assert isinstance(other, dict), where
        assert one.keys() == other.keys(), where
        for name, value in one.items():
            assert_same(value, other[name], f"{where}/{name}")
    elif isinstance(one, list | tuple):
        assert len(one) == len(other), where
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_same(a, b, f"{where}/{i}")
    else:
        a, b = np.asarray(one), np.asarray(other)
        assert (a.dtype, a.shape) == (b.dtype, b.shape), where
        assert a.tobytes() == b.tobytes(), f"{where}: {a} and {b}"


def told_alike(infos: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Infos of rows, without the entries that only a batch has."""
    return [{k: v for k, v in info.items() if k != "diverged"} for info in infos]
