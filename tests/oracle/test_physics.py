"""Physics: states, copies, resets, steps and errors equal dm_control's."""

import collections
import copy
import itertools
import logging
import pickle
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from . import models, twins
from .drawn_here import compared_part
from .oracle import BOTH
from .same import assert_same, assert_same_pair

pytestmark = [pytest.mark.oracle, pytest.mark.usefixtures("compiled_once")]

every_model = pytest.mark.parametrize("name", list(models.BY_NAME))


@every_model
@pytest.mark.parametrize("legacy_step", [True, False])
@pytest.mark.parametrize("nstep", [1, 2, 5])
def test_steps_are_the_same(name: str, legacy_step: bool, nstep: int) -> None:
    twin = twins.load_physics(name)
    twin.assert_same_state()
    for physics in twin.both:
        physics.legacy_step = legacy_step
    twin.play(nstep=nstep)


# Addresses within sparse Jacobians, which MuJoCo leaves as they happen to be where these are dense.
_OF_SPARSE = ("efc_J_", "efc_AR_")


@pytest.mark.parametrize(("domain", "task"), twins.MODELS)
def test_every_array_of_the_data_is_the_same_after_steps(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    env.reset()
    env.play(itertools.islice(env.actions("bang-bang", 0), 100))
    ours, theirs = env.ours.physics.data.ptr, env.theirs.physics.data.ptr
    for field in dir(theirs):
        value = getattr(theirs, field, None)
        if field.startswith(_OF_SPARSE) and not mujoco.mj_isSparse(env.ours.physics.model.ptr):
            continue
        if isinstance(value, np.ndarray) and not field.startswith("_"):
            both = getattr(ours, field), value
            both = compared_part(domain, field, (ours.model, theirs.model), both)
            assert_same_pair(both, f"{env.where} {field}")


@every_model
def test_states_that_were_read_can_be_set_in_the_other_package(name: str) -> None:
    twin = twins.load_physics(name)
    twin.play()
    states = [physics.get_state() for physics in twin.both]
    assert_same_pair(states, "state")
    twin.play(5)
    for physics, state in zip(twin.both, reversed(states), strict=True):
        physics.set_state(state)
    twin.do(lambda physics: physics.forward())
    twin.play()


@every_model
@pytest.mark.parametrize(
    "signature",
    [
        mujoco.mjtState.mjSTATE_FULLPHYSICS.value,
        mujoco.mjtState.mjSTATE_INTEGRATION.value,
        mujoco.mjtState.mjSTATE_PHYSICS,
        mujoco.mjtState.mjSTATE_QPOS.value | mujoco.mjtState.mjSTATE_TIME.value,
    ],
)
def test_states_with_a_signature_are_the_same(name: str, signature: int) -> None:
    twin = twins.load_physics(name)
    twin.play()
    states = [physics.get_state(sig=signature) for physics in twin.both]
    assert_same_pair(states, "state")
    twin.play(5)
    for physics, state in zip(twin.both, states, strict=True):
        physics.set_state(state, sig=signature)
        physics.set_state(state.tolist(), sig=signature)
    twin.do(lambda physics: physics.forward())
    twin.play()


def test_a_state_of_the_wrong_size_is_refused_alike() -> None:
    twin = twins.load_physics()
    size = twin.both[1].get_state().size
    for state in (np.zeros(size + 1), np.zeros(size - 1), np.zeros((1, size)), np.zeros(0)):
        twin.do(lambda physics, state=state: physics.set_state(state))
        with pytest.raises(ValueError, match="shape"):
            twin.both[0].set_state(state)


@every_model
@pytest.mark.parametrize(
    "copied",
    [
        lambda physics: physics.copy(),
        lambda physics: physics.copy(share_model=True),
        copy.deepcopy,
        copy.copy,
        lambda physics: pickle.loads(pickle.dumps(physics)),
    ],
    ids=["copy", "copy sharing the model", "deepcopy", "shallow copy", "pickle"],
)
def test_copies_have_the_same_future(name: str, copied: Callable[[Any], Any]) -> None:
    twin = twins.load_physics(name)
    for physics in twin.both:
        physics.model.body_mass[1:] *= 1.5
        physics.model.opt.gravity[2] = -3
    twin.play()
    twin_copies = twin.map(copied)
    twin_copies.assert_same_state()
    twin_copies.play()
    twin.play()
    assert all(
        type(ours) is type(made) for ours, made in zip(twin.both, twin_copies.both, strict=True)
    )


def test_a_copy_shares_its_model_only_if_it_is_asked_to() -> None:
    twin = twins.load_physics()
    shared = twin.map(lambda physics: physics.copy(share_model=True))
    own = twin.map(lambda physics: physics.copy())
    for physics in twin.both:
        physics.model.body_mass[1:] *= 2
    for copies, changed in ((shared, True), (own, False)):
        for physics, one in zip(twin.both, copies.both, strict=True):
            assert np.array_equal(physics.model.body_mass, one.model.body_mass) == changed
        copies.play()


def test_copies_of_suite_environments_physics_have_the_same_future() -> None:
    env = twins.load("stacker", "stack_4")
    env.reset()
    env.play(itertools.islice(env.actions("random", 0), 20))
    twin = twins.TwinPhysics(env.ours.physics, env.theirs.physics, "stack_4")
    for copied in (lambda one: one.copy(), lambda one: pickle.loads(pickle.dumps(one))):
        copies = twin.map(copied)
        copies.play()
        assert_same_pair((one.site_distance("box0", "grasp") for one in copies.both), "distance")


@pytest.mark.parametrize("keyframe", [None, 0, 1])
def test_a_reset_to_a_keyframe_is_the_same(keyframe: int | None) -> None:
    twin = twins.load_physics()
    twin.play()
    twin.do(lambda physics: physics.reset(keyframe_id=keyframe))
    twin.play()


@pytest.mark.parametrize("keyframe", [-1, 2, 99])
def test_an_unknown_keyframe_is_refused_alike(keyframe: int) -> None:
    twin = twins.load_physics()
    twin.play(3)
    twin.do(lambda physics: physics.reset(keyframe_id=keyframe))
    with pytest.raises(ValueError, match=str(keyframe)):
        twin.both[0].reset(keyframe_id=keyframe)


@every_model
def test_forward_after_reset_and_a_reset_context_are_the_same(name: str) -> None:
    twin = twins.load_physics(name)
    twin.play(5)

    def start_anew(physics: Any) -> None:
        with physics.reset_context() as same:
            assert same is physics
            physics.data.qpos[:] += 0.1
            physics.data.ctrl[:] = 0.7

    twin.do(start_anew)
    twin.do(lambda physics: physics.forward())
    twin.do(lambda physics: physics.after_reset())
    twin.do(lambda physics: physics.reset())
    twin.play(5)


def test_results_of_queries_are_copies_where_dm_control_copies() -> None:
    twin = twins.load_physics()
    for query in ("position", "velocity", "control", "activation", "state", "get_state"):
        before = [getattr(physics, query)() for physics in twin.both]
        kept = [value.copy() for value in before]
        twin.play(2)
        for value, old in zip(before, kept, strict=True):
            assert_same(value, old, query)


@every_model
def test_controls_that_dm_control_broadcasts_or_refuses_in_set_control_do_the_same(
    name: str,
) -> None:
    twin = twins.load_physics(name)
    size = twin.both[1].model.nu
    controls: list[Any] = [np.full(size, 0.2), [0.1] * size, np.zeros(size, np.float32)]
    controls += [np.zeros(size + 1), np.zeros(size, int), 0.3, [0.4]]
    for control in controls:
        twin.do(lambda physics, control=control: physics.set_control(control))


@every_model
def test_action_specs_are_the_same(name: str) -> None:
    specs = [
        package("mujoco").action_spec(physics)
        for package, physics in zip(BOTH, twins.load_physics(name).both, strict=True)
    ]
    assert repr(specs[0]) == repr(specs[1])
    assert_same(specs[0].minimum, specs[1].minimum, "minimum")
    assert_same(specs[0].maximum, specs[1].maximum, "maximum")


def _diverge(physics: Any) -> None:
    physics.data.qpos[0] = np.nan
    physics.step()


def _nan_control(physics: Any) -> None:
    physics.data.ctrl[0] = np.nan
    physics.step()


def _huge_velocity(physics: Any) -> None:
    physics.data.qvel[:] = 1e12
    physics.step(3)


def _bad_position_and_acceleration(physics: Any) -> None:
    with physics.check_invalid_state():
        for kind in (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQACC):
            physics.data.warning[kind].number += 1


_BREAK = [_diverge, _nan_control, _huge_velocity, _bad_position_and_acceleration]


@pytest.mark.parametrize("destroy", _BREAK)
def test_divergence_raises_a_physics_error_with_the_same_message(
    destroy: Callable[[Any], None],
) -> None:
    twin = twins.load_physics()
    errors = []
    for package, physics in zip(BOTH, twin.both, strict=True):
        with pytest.raises(package("rl.control").PhysicsError) as error:
            destroy(physics)
        errors.append(error.value)
    our_message, their_message = map(str, errors)
    # Our message may continue with advice.
    assert our_message.startswith(their_message)
    twin.assert_same_state()
    # Earlier warnings do not count for the next step.
    for physics in twin.both:
        physics.reset()
    twin.play(3)


@pytest.mark.parametrize("destroy", _BREAK)
@pytest.mark.filterwarnings(
    "ignore:The 'warn' function is deprecated:DeprecationWarning"  # absl.logging, by dm_control
)
def test_suppressed_physics_errors_are_logged_and_come_back(
    destroy: Callable[[Any], None], caplog: pytest.LogCaptureFixture
) -> None:
    twin = twins.load_physics()
    for package, physics in zip(BOTH, twin.both, strict=True):
        with physics.suppress_physics_errors():
            with physics.suppress_physics_errors():
                destroy(physics)
            physics.reset()
            with caplog.at_level(logging.WARNING):
                destroy(physics)
        if package is BOTH[0]:
            logged = [
                one.getMessage() for one in caplog.records if one.name.startswith("limberjack")
            ]
            assert any("mjWARN_BAD" in message for message in logged), caplog.records
        physics.reset()
        with pytest.raises(package("rl.control").PhysicsError):
            destroy(physics)
    twin.assert_same_state()


def test_physics_has_dm_controls_public_names_and_few_of_its_own() -> None:
    names, others = (
        {name for name in dir(package("mujoco").Physics) if not name.startswith("_")}
        for package in BOTH
    )
    assert others <= names
    assert len(others) == 34
    assert sorted(names - others) == [
        "become",
        "begin_render",
        "can_render_in_parts",
        "can_step_in_parts",
        "from_shared_xml",
        "identity",
        "nominal_fields",
        "num_envs",
        "picture_spec",
        "recompiler",
        "recompute_constants_of",
        "render_rows",
        "replaced",
        "replicate",
        "seen_through",
        "simulation",
        "step_in_parts",
    ]


def _hooked(package: Any) -> Any:
    """A physics that counts its resets and adds a force to each forward computation."""

    class Hooked(package("suite.cartpole").Physics):
        resets = 0

        def after_reset(self) -> None:
            self.resets += 1
            super().after_reset()

        def forward(self) -> None:
            self.data.qfrc_applied[0] = 1.0
            super().forward()

    return Hooked.from_xml_string(*package("suite.cartpole").get_model_and_assets())


def test_hooks_of_a_physics_are_called_alike() -> None:
    found = []
    for physics in map(_hooked, BOTH):
        physics.reset()
        with physics.reset_context():
            physics.data.qpos[1] = 0.4
        acceleration = physics.data.qacc.copy()
        physics.step()
        found.append([physics.resets, acceleration, physics.data.qvel.copy()])
    assert_same_pair(found, "what the hooks did")


def _with_own_controls(package: Any) -> Any:
    class Mirrored(package("mujoco").Physics):
        def set_control(self, control: Any) -> None:
            super().set_control([control[0], -control[0]])

    physics = Mirrored.from_xml_string(
        """<mujoco><worldbody>
             <body><joint name="a"/><geom size=".1"/></body>
             <body pos="1 0 0"><joint name="b"/><geom size=".1"/></body>
           </worldbody>
           <actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>"""
    )

    class Watching(package("suite.base").Task):
        def get_observation(self, physics: Any) -> Any:
            return collections.OrderedDict(control=physics.control())

        def get_reward(self, physics: Any) -> float:
            return 0.0

    return package("rl.control").Environment(physics, Watching(random=0), time_limit=1)


def test_controls_that_a_physics_sets_by_itself_are_the_same() -> None:
    found = []
    for environment in map(_with_own_controls, BOTH):
        environment.reset()
        found.append(environment.step(np.array([0.3])).observation["control"])
    assert_same_pair(found, "controls")
