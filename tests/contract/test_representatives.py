"""Representatives have the features that they represent."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from tests.representatives import FEATURES, REPRESENTATIVES, Task

_STARTS = 40  # of which one in ten is at the goal: none with a probability of 1.5 %


def _has_free_root(env: Any) -> bool:
    model = env.physics.model
    return model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE and "floor" in str(model.names)


def _observes_the_bare_state(env: Any) -> bool:
    observation = env.reset().observation
    state = [env.physics.position(), env.physics.velocity()]
    return all(map(np.array_equal, observation.values(), state)) and len(observation) == 2


def _sets_fields_and_has_kinds(env: Any) -> bool:
    kinds = set()
    for _ in range(_STARTS):
        env.reset()
        kinds.add(env.task.start(env.physics))
    return bool(env.task.EPISODE_FIELDS) and len(kinds) > 1


def _starts_at_the_goal(env: Any) -> bool:
    found = set()
    for _ in range(_STARTS):
        env.reset()
        found.add(bool(env.task.is_success(env.task.reward_terms(env.physics))))
    return found == {True, False}


def _has_many_bodies_and_terms(env: Any) -> bool:
    return env.physics.model.nbody > 12 and len(env.task.GOAL) > 1


def _has_a_model_for_each_row(env: Any) -> bool:
    """Whether a start writes a field that is no array of a batch, such as a height field."""
    before = env.physics.model.hfield_data.copy()
    env.reset()
    return before.size > 0 and not np.array_equal(before, env.physics.model.hfield_data)


def _draws_fields_for_its_stream(env: Any) -> bool:
    other = suite.load("lqr", "lqr_2_1", {"random": 1})
    stiffness, others = (one.physics.model.jnt_stiffness for one in (env, other))
    return env.step_limit is None and not np.array_equal(stiffness, others)


def _has_activations(env: Any) -> bool:
    return env.physics.model.na > 0


_CHECKS: dict[str, Callable[[Any], bool]] = {
    "a free root and contacts in three dimensions": _has_free_root,
    "generalised positions and velocities as the observation": _observes_the_bare_state,
    "model fields set at each start, and kinds of starts": _sets_fields_and_has_kinds,
    "starts that are rejected, and starts at the goal": _starts_at_the_goal,
    "many bodies that touch, and a goal of several terms": _has_many_bodies_and_terms,
    "a model for each row": _has_a_model_for_each_row,
    "fields drawn for each stream, and no time limit": _draws_fields_for_its_stream,
    "activations": _has_activations,
}


def test_every_feature_is_checked() -> None:
    assert set(_CHECKS) == set(FEATURES)


@pytest.mark.parametrize("feature", FEATURES)
def test_a_representative_has_its_feature(feature: str) -> None:
    assert _CHECKS[feature](suite.load(*FEATURES[feature], {"random": 0}))


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_a_representative_is_a_task_of_the_suite(task: Task) -> None:
    assert task in suite.ALL_TASKS
