"""The kinds of starts by which scores are grouped."""

from types import SimpleNamespace

import numpy as np
import pytest

from limberjack import suite
from limberjack.evaluation.starts import kind_of_start


@pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
def test_a_kind_is_the_tasks_own(domain: str, task: str) -> None:
    environment, other = suite.load(domain, task), suite.load(domain, task)
    for seed in range(20):
        other.reseed(seed)
        other.reset()
        kind = kind_of_start(environment, seed)
        assert kind == other.task.start(other.physics)
        assert kind in (environment.task.STARTS or (None,))


def test_a_task_without_kinds_has_none() -> None:
    environment = suite.load("stacker", "stack_2")
    task = SimpleNamespace(initialize_episode=lambda physics: None)
    task.get_observation = lambda physics: {}
    vars(environment)["_task"] = task
    assert kind_of_start(environment, 0) is None


def test_a_humanoids_kind_is_how_it_lies_after_a_second_without_control() -> None:
    environment, falling = suite.load("humanoid", "walk"), suite.load("humanoid", "walk")
    kinds = set()
    for seed in range(25):
        kind = kind_of_start(environment, seed)
        kinds.add(kind)
        assert environment.physics.time() == 0.0, "a copy falls"
        falling.reseed(seed)
        falling.reset()
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
    stand, run = suite.load("humanoid", "stand"), suite.load("humanoid", "run")
    first = [kind_of_start(stand, seed) for seed in range(6)]
    assert [kind_of_start(run, seed) for seed in range(6)] == first
    assert [kind_of_start(stand, seed) for seed in reversed(range(6))] == first[::-1]


def test_a_humanoid_that_is_held_up_is_up() -> None:
    environment = suite.load("humanoid", "stand")
    environment.physics.model.opt.gravity[2] = 0.0  # it hangs in the air
    assert kind_of_start(environment, 0) == "up"
