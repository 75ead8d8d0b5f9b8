"""Returned arrays never change later."""

import copy
import gc
from typing import Any

import numpy as np
import pytest

from tests.laws.episodes import TASKS, Task, actions, bits, load
from tests.representatives import REPRESENTATIVES


def arrays(value: Any) -> list[np.ndarray]:
    """All arrays in a structure."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, dict):
        return [array for item in value.values() for array in arrays(item)]
    return [array for item in value for array in arrays(item)] if isinstance(value, tuple) else []


def live_arrays(env: Any) -> list[np.ndarray]:
    """All arrays that are views of the simulation's memory."""
    found = []
    for struct in (env.physics.data._data, env.physics.model._official):
        fields = [getattr(struct, name, None) for name in dir(struct) if name[0] != "_"]
        found += [field for field in fields if isinstance(field, np.ndarray) and field.size]
    return found


def methods(physics: Any) -> dict[str, Any]:
    """Results of the methods of a domain's physics, by a description."""
    plain = ["get_state", "control", "activation", "state", "position", "velocity"]
    humanoid = (
        "center_of_mass_position center_of_mass_velocity torso_vertical_orientation joint_angles "
        "extremities head_height torso_upright"
    )
    plain += [name for name in (*humanoid.split(), "touch") if hasattr(physics, name)]
    made = {name: getattr(physics, name)() for name in plain}
    if hasattr(physics, "body_2d_pose"):
        made["pose"] = physics.body_2d_pose("hand")
        made["position"] = physics.body_2d_pose("hand", orientation=False)
        made["poses"] = physics.body_2d_pose(["hand", "palm_touch"][:1])
        made["joints"] = physics.bounded_joint_pos(["arm_root", "finger"])
        made["joint"] = physics.bounded_joint_pos("arm_root")
        made["velocities"] = physics.joint_vel(["arm_root", "finger"])
        made["distance"] = physics.site_distance("grasp", "pinch")
    return made


def assert_own_memory(env: Any, values: dict[str, Any]) -> None:
    live = live_arrays(env)
    for name, value in values.items():
        for array in arrays(value):
            assert array.flags.writeable, name
            assert not any(np.may_share_memory(array, field) for field in live), name


@pytest.mark.parametrize("task", TASKS)
def test_observations_are_arrays_of_their_own(task: Task) -> None:
    env = load(task)
    for step in [env.reset(), *map(env.step, actions(env, 2))]:
        assert_own_memory(env, dict(step.observation))
    assert_own_memory(env, methods(env.physics))


@pytest.mark.parametrize("task", REPRESENTATIVES)
@pytest.mark.parametrize("flat", [False, True])
def test_returned_steps_never_change_later(task: Task, flat: bool) -> None:
    env = load(task, flat_observation=flat)
    steps = [env.reset(), *map(env.step, actions(env, 3))]
    results = methods(env.physics)
    kept = copy.deepcopy((steps, results))
    for action in actions(env, 3, seed=1):
        env.step(action)
    env.reset()
    env.physics.data.qpos[:] = 0.25
    env.physics.forward()
    env.close()
    del env
    gc.collect()
    assert [bits(step) for step in steps] == [bits(step) for step in kept[0]]
    assert bits(results) == bits(kept[1])


@pytest.mark.parametrize("task", TASKS)
def test_each_step_gives_a_new_mapping_that_may_be_written_to(task: Task) -> None:
    env, twin = load(task), load(task)
    env.reset(), twin.reset()
    seen = []
    for action in actions(env, 3):
        step = env.step(action)
        assert bits(step) == bits(twin.step(action))
        seen.append(step.observation)
        for value in arrays(step.observation):
            value[...] = np.nan
        step.observation.clear()
    assert len({id(observation) for observation in seen}) == len(seen)


@pytest.mark.parametrize("task", TASKS)
def test_an_action_is_neither_kept_nor_written_to(task: Task) -> None:
    env, twin = load(task), load(task)
    env.reset(), twin.reset()
    action = actions(env, 1)[0] * 3  # out of bounds, which MuJoCo clips
    given = action.copy()
    env.step(given)
    np.testing.assert_array_equal(given, action)
    given[:] = 0.0
    np.testing.assert_array_equal(env.physics.control(), action)
    given.flags.writeable = False
    twin.step(action)
    assert bits(env.step(given)) == bits(twin.step(np.zeros_like(action)))


@pytest.mark.parametrize("task", TASKS)
def test_specs_are_not_views_of_the_model(task: Task) -> None:
    env = load(task)
    spec = env.action_spec()
    before = spec.maximum.copy()
    env.physics.model.actuator_ctrllimited[:] = True
    env.physics.model.actuator_ctrlrange[:] = [-9.0, 9.0]
    np.testing.assert_array_equal(spec.maximum, before)
    assert env.action_spec().maximum.max() == 9.0


def test_a_single_joints_velocity_is_not_a_view() -> None:
    env = load(("manipulator", "bring_ball"))
    env.reset()
    assert_own_memory(env, {"joint_vel": env.physics.joint_vel("arm_root")})
