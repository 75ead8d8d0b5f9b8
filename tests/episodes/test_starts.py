"""The kinds of starts by which scores are grouped."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.episodes.starts import Starts
from limberjack.rl import control
from limberjack.rl.builds import Build
from limberjack.suite.base import kind_of_start
from limberjack.workers.factories import factory_of
from tests import plain_domain


def _starts(domain: str, task: str) -> Starts:
    return Starts.of(factory_of(domain, task, time_limit=1.0))  # which changes no start


@pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
def test_a_kind_is_the_tasks_own(domain: str, task: str) -> None:
    starts, other = _starts(domain, task), suite.load(domain, task)
    for seed in range(4):
        other.reseed(seed)
        other.reset()
        kind = starts.kind(seed)
        assert kind == other.task.start(other.physics)
        assert kind in (other.task.STARTS or (None,))


def test_a_task_without_kinds_has_none() -> None:
    environment: Any = SimpleNamespace(task=SimpleNamespace(), physics=None)
    assert kind_of_start(environment) is None


class _Placed(plain_domain.Push):
    """Remembers its start under the name of a method, and has no kinds."""

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self.start = float(physics.data.qpos[0])  # pyright: ignore


def _placed(seed: int) -> control.Environment:
    physics = plain_domain.push().physics
    return control.Environment(physics, _Placed(seed), time_limit=0.1, control_timestep=0.02)


def test_a_task_without_kinds_is_neither_begun_nor_asked_for_one() -> None:
    begun: list[int] = []

    def make(seed: int) -> control.Environment:
        begun.append(seed)
        return _placed(seed)

    starts = Starts.of(factory_of(make))
    assert [starts.kind(seed) for seed in range(3)] == [None, None, None]
    assert begun == [0]
    starts.close()


def test_a_humanoids_kind_is_how_it_lies_after_a_second_without_control() -> None:
    starts, falling = _starts("humanoid", "walk"), suite.load("humanoid", "walk")
    kinds = set()
    for seed in range(25):
        kind = starts.kind(seed)
        kinds.add(kind)
        falling.reseed(seed)
        falling.reset()
        assert kind_of_start(falling) == kind
        assert falling.physics.time() == 0.0, "a copy falls"
        for _ in range(40):
            falling.step(np.zeros(21))
        physics = falling.physics
        assert physics.data.time == pytest.approx(1.0)
        assert physics.head_height() < 0.7
        front = physics.named.data.xmat["torso", "zx"]
        expected = "face_up" if front >= 0.5 else "face_down" if front <= -0.5 else "on_side"
        assert kind == expected
    assert kinds == {"face_up", "face_down", "on_side"}


def test_a_kind_is_the_same_for_all_tasks_of_the_humanoid_and_every_time() -> None:
    stand, run = _starts("humanoid", "stand"), _starts("humanoid", "run")
    first = [stand.kind(seed) for seed in range(6)]
    assert [run.kind(seed) for seed in range(6)] == first
    assert [_starts("humanoid", "stand").kind(seed) for seed in reversed(range(6))] == first[::-1]


def test_a_humanoid_that_is_held_up_is_up() -> None:
    environment = suite.load("humanoid", "stand")
    environment.physics.model.opt.gravity[2] = 0.0  # it hangs in the air
    assert Starts(Build.of(environment)).kind(0) == "up"
