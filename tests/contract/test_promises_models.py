"""Environments of a process share a compiled model, and editing it affects no other environment."""

import copy
import gc
import pickle
import weakref
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import mujoco as lj_mujoco
from limberjack import suite
from limberjack.mujoco.wrapper import sharing
from tests.laws.episodes import DOMAINS, Task, bits, load, play, snapshot
from tests.representatives import REPRESENTATIVES, USUAL, in_turn

_TIMESTEP = 0.123  # seconds; no model of the suite has it


def by_option(physics: Any) -> None:
    physics.model.opt.timestep = _TIMESTEP


def by_pointer(physics: Any) -> None:
    physics.model.ptr.opt.timestep = _TIMESTEP


def by_datas_model(physics: Any) -> None:
    physics.data.model.opt.timestep = _TIMESTEP


def by_official_function(physics: Any) -> None:
    physics.model.body_mass[1] = 5.0
    mujoco.mj_setConst(physics.model.ptr, physics.data.ptr)


def by_array(physics: Any) -> None:
    physics.model.geom_friction[:] = 0.25


def by_attribute(physics: Any) -> None:
    physics.model.body_mass = np.full(physics.model.nbody, 2.0)


def by_kept_array(physics: Any) -> None:
    gravity = physics.model.opt.gravity
    physics.step()
    gravity[:] = 1.0


def by_name(physics: Any) -> None:
    physics.named.model.body_pos[physics.model.id2name(1, "body"), "z"] += 0.5


def by_named_array(physics: Any) -> None:
    np.asarray(physics.named.model.jnt_range._field)[:] = 0.5


def by_accessor(physics: Any) -> None:
    physics.model.body(1).pos[2] = 7.0


def by_statistics(physics: Any) -> None:
    physics.model.stat.extent = 3.0
    physics.model.vis.map.znear = 0.5


def by_disabling(physics: Any) -> None:
    flags = physics.model.disable("gravity", "contact")
    flags.__enter__()
    # Kept alive: the context is not left.
    physics.flags = flags


def by_default_positions(physics: Any) -> None:
    physics.model.qpos0[:] = 0.5


_ROADS = [
    by_option,
    by_pointer,
    by_datas_model,
    by_official_function,
    by_array,
    by_attribute,
    by_kept_array,
    by_name,
    by_named_array,
    by_accessor,
    by_statistics,
    by_disabling,
    by_default_positions,
]


def as_bytes(physics: Any) -> bytes:
    """The whole model."""
    model = physics.model._official
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


@pytest.mark.parametrize(("edit", "task"), in_turn(_ROADS))
def test_an_edited_model_is_the_environments_own(task: Task, edit: Callable[[Any], None]) -> None:
    before, env = load(task), load(task)
    play(before, 2)
    play(env, 2)
    whole, now = as_bytes(load(task).physics), snapshot(before)
    edited = as_bytes(env.physics)
    edit(env.physics)
    assert as_bytes(env.physics) != edited, "the edit does nothing"
    assert as_bytes(load(task).physics) == whole
    assert snapshot(before) == now
    expected = play(load(task), 3)
    before.reseed(0)
    assert play(before, 3) == expected
    assert play(load(task), 3) == expected


@pytest.mark.parametrize("task", DOMAINS)
def test_an_edit_has_its_effect_on_the_edited_simulation(task: Task) -> None:
    env, twin = load(task), load(task)
    play(env, 2), play(twin, 2)
    env.physics.model.actuator_gear[:] *= 3.0
    assert play(env, 3, reset=False) != play(twin, 3, reset=False)
    env.physics.model.opt.timestep = _TIMESTEP
    assert env.physics.timestep() == _TIMESTEP
    before = env.physics.time()
    env.physics.step()
    assert env.physics.time() == pytest.approx(before + _TIMESTEP)


def test_leaving_disable_restores_the_flags_exactly() -> None:
    env, twin = load(("humanoid", "walk")), load(("humanoid", "walk"))
    with env.physics.model.disable("gravity"):
        env.physics.step()
    with pytest.raises(ZeroDivisionError), env.physics.model.disable("contact"):
        raise ZeroDivisionError
    assert play(env, 5) == play(twin, 5)


@pytest.mark.parametrize("task", USUAL)
def test_environments_of_a_task_share_one_model(task: Task) -> None:
    envs = [load(task) for _ in range(3)]
    assert len({id(env.physics.model._official) for env in envs}) == 1
    assert all(env.action_spec() and env.observation_spec() for env in envs)
    assert len({id(env.physics.model._official) for env in envs}) == 1


@pytest.mark.parametrize("task", ["stand", "walk", "run", "run_pure_state"])
def test_playing_the_humanoid_leaves_its_model_shared(task: str) -> None:
    env, other = load(("humanoid", task)), load(("humanoid", "stand"))
    play(env, 3)
    env.physics.named.data.qpos["abdomen_x"] = 0.1
    env.physics.set_state(env.physics.get_state())
    env.physics.forward()
    assert env.physics.model.name2id("torso", "body") == 1
    assert env.physics.model._official is other.physics.model._official


def test_an_unused_model_is_freed() -> None:
    physics = lj_mujoco.Physics.from_shared_xml("<mujoco model='only here'/>", {})
    twin = lj_mujoco.Physics.from_shared_xml("<mujoco model='only here'/>", {})
    assert twin.model._official is physics.model._official
    kept = weakref.ref(physics.model._shared)
    physics.model.ptr.opt.timestep = _TIMESTEP  # the other one goes on sharing
    assert twin.timestep() != _TIMESTEP
    del physics, twin
    sharing.drop_unused()  # which are kept for the next load
    gc.collect()
    assert kept() is None


def copies(physics: Any) -> dict[str, Any]:
    return {
        "copy": physics.copy(),
        "deepcopy": copy.deepcopy(physics),
        "pickle": pickle.loads(pickle.dumps(physics)),
    }


@pytest.mark.parametrize("is_own", [False, True], ids=["shared", "own"])
@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_a_copied_physics_has_the_same_future_and_is_independent(task: Task, is_own: bool) -> None:
    env = load(task)
    if is_own:
        env.physics.model.opt.gravity[0] = 0.5
    play(env, 3)
    physics = env.physics
    state, model = physics.get_state(), as_bytes(physics)
    made = copies(physics)
    for name, other in made.items():
        assert type(other) is type(physics), name
        np.testing.assert_array_equal(other.get_state(), state, name)
        assert as_bytes(other) == model, name
        other.model.opt.gravity[0] = 9.0
        other.data.qpos[:] = 0.1
        other.named.data.qvel[:] = 1.0
        other.step()
        np.testing.assert_array_equal(physics.get_state(), state, name)
        assert as_bytes(physics) == model, name


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_a_copied_or_pickled_environment_plays_the_same_episodes(task: Task) -> None:
    env = load(task, seed=4)
    play(env, 2)
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        twin = load(task, seed=4)
        play(twin, 2)
        assert [play(other, 3), play(other, 3)] == [play(twin, 3), play(twin, 3)]


def test_a_copy_may_share_the_model_on_request() -> None:
    physics = load(("stacker", "stack_2")).physics
    apart, together = physics.copy(), physics.copy(share_model=True)
    physics.model.opt.timestep = _TIMESTEP
    assert together.timestep() == _TIMESTEP
    assert apart.timestep() != _TIMESTEP


def test_suites_factories_share_with_load() -> None:
    made = suite.humanoid.walk(random=0)
    assert made.physics.model._official is load(("humanoid", "walk")).physics.model._official
    assert bits(made.reset()) == bits(load(("humanoid", "walk")).reset())
