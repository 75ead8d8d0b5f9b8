"""The kinds of starts that scores are told apart by."""

import pytest

from limberjack import suite
from limberjack.evaluation.starts import kind_of_start


def test_the_arms_kinds_are_the_tasks_own() -> None:
    for domain, task in (("manipulator", "insert_peg"), ("stacker", "stack_4")):
        environment, other = suite.load(domain, task), suite.load(domain, task)
        for seed in range(20):
            other.reseed(seed)
            other.reset()
            assert kind_of_start(environment, seed) == other.task.start(other.physics)


def test_a_humanoids_kind_is_how_it_lies_after_a_second_without_control() -> None:
    environment = suite.load("humanoid", "walk")
    kinds = set()
    for seed in range(25):
        kind = kind_of_start(environment, seed)
        kinds.add(kind)
        physics = environment.physics
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
