"""Physics: states, copies, resets, steps, lookups and errors do what dm_control's do."""

import copy
import functools
import itertools
import logging
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from . import models, twins
from .oracle import BOTH
from .same import assert_same, assert_same_outcome, assert_same_pair

pytestmark = pytest.mark.oracle

_XML = {"zoo": models.ZOO, "Runge-Kutta": models.RUNGE_KUTTA, "pendulum": models.PENDULUM}
every_model = pytest.mark.parametrize("name", list(_XML))

_STATE = ("qpos", "qvel", "act", "ctrl", "qacc", "qacc_warmstart", "sensordata", "xpos", "xmat")
_QUERIES = ("position", "velocity", "control", "activation", "state", "time", "timestep")


class TwinPhysics:
    """A Physics of each package, told the same things."""

    def __init__(self, ours: Any, theirs: Any, where: str = "") -> None:
        # `Any`: classes of two packages that share no type.
        self.both = (ours, theirs)
        self.where = where

    def do(self, act: Callable[[Any], Any]) -> None:
        """Both do the same, or both raise an error of one type; then their states are the same."""
        assert_same_outcome([functools.partial(act, one) for one in self.both], self.where)
        self.assert_same_state()

    def map(self, act: Callable[[Any], Any]) -> "TwinPhysics":
        """The twins that `act` makes of these."""
        return TwinPhysics(*map(act, self.both), where=self.where)

    def assert_same_state(self) -> None:
        """The whole state, and all that the physics says about it, is the same."""
        for field in _STATE:
            assert_same_pair(
                (getattr(one.data, field) for one in self.both), f"{self.where} {field}"
            )
        for query in _QUERIES:
            assert_same_pair(
                (getattr(one, query)() for one in self.both), f"{self.where} {query}()"
            )
        assert_same_pair((one.data.ncon for one in self.both), f"{self.where} ncon")
        assert_same_pair((one.data.warning.number for one in self.both), f"{self.where} warnings")

    def play(self, steps: int = 20, nstep: int = 1, seed: int = 0) -> None:
        """Random controls, the same state after each step."""
        random = np.random.RandomState(seed)
        for _ in range(steps):
            control = random.uniform(-1, 1, self.both[1].model.nu)
            for physics in self.both:
                physics.set_control(control)
                physics.step(nstep)
            self.assert_same_state()


def _zoo(name: str = "zoo") -> TwinPhysics:
    both = (package("mujoco").Physics.from_xml_string(_XML[name]) for package in BOTH)
    return TwinPhysics(*both, where=name)


@every_model
@pytest.mark.parametrize("legacy_step", [True, False])
@pytest.mark.parametrize("nstep", [1, 2, 5])
def test_steps_are_the_same(name: str, legacy_step: bool, nstep: int) -> None:
    twin = _zoo(name)
    twin.assert_same_state()
    for physics in twin.both:
        physics.legacy_step = legacy_step
    twin.play(nstep=nstep)


@pytest.mark.parametrize(("domain", "task"), twins.MODELS)
def test_every_array_of_the_data_is_the_same_after_steps(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    env.reset()
    env.play(itertools.islice(env.actions("bang-bang", 0), 100))
    ours, theirs = env.ours.physics.data.ptr, env.theirs.physics.data.ptr
    for field in dir(theirs):
        value = getattr(theirs, field, None)
        if isinstance(value, np.ndarray) and not field.startswith("_"):
            assert_same(getattr(ours, field), value, f"{env.where} {field}")


@every_model
def test_states_that_were_read_can_be_set_in_the_other_package(name: str) -> None:
    twin = _zoo(name)
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
    twin = _zoo(name)
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
    twin = _zoo()
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
    twin = _zoo(name)
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
    twin = _zoo()
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
    twin = TwinPhysics(env.ours.physics, env.theirs.physics, "stack_4")
    for copied in (lambda one: one.copy(), lambda one: pickle.loads(pickle.dumps(one))):
        copies = twin.map(copied)
        copies.play()
        assert_same_pair((one.site_distance("box0", "grasp") for one in copies.both), "distance")


@pytest.mark.parametrize("keyframe", [None, 0, 1])
def test_a_reset_to_a_keyframe_is_the_same(keyframe: int | None) -> None:
    twin = _zoo()
    twin.play()
    twin.do(lambda physics: physics.reset(keyframe_id=keyframe))
    twin.play()


@pytest.mark.parametrize("keyframe", [-1, 2, 99])
def test_a_keyframe_that_is_not_there_is_refused_alike(keyframe: int) -> None:
    twin = _zoo()
    twin.play(3)
    twin.do(lambda physics: physics.reset(keyframe_id=keyframe))
    with pytest.raises(ValueError, match=str(keyframe)):
        twin.both[0].reset(keyframe_id=keyframe)


@every_model
def test_forward_after_reset_and_a_reset_context_are_the_same(name: str) -> None:
    twin = _zoo(name)
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


def test_what_queries_return_is_no_view_of_live_memory_where_dm_control_copies() -> None:
    twin = _zoo()
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
    twin = _zoo(name)
    size = twin.both[1].model.nu
    controls: list[Any] = [np.full(size, 0.2), [0.1] * size, np.zeros(size, np.float32)]
    controls += [np.zeros(size + 1), np.zeros(size, int), 0.3, [0.4]]
    for control in controls:
        twin.do(lambda physics, control=control: physics.set_control(control))


_LOOKUPS: list[tuple[Any, Any]] = [
    ("cart", "body"),
    ("cart", "geom"),
    ("cart", "site"),
    ("cart", mujoco.mjtObj.mjOBJ_BODY),
    ("cart", mujoco.mjtObj.mjOBJ_BODY.value),
    ("swivel", "joint"),
    ("fixed", "camera"),
    ("lamp", "light"),
    ("checked", "material"),
    ("checks", "texture"),
    ("string", "tendon"),
    ("leash", "equality"),
    ("slow", "actuator"),
    ("touch", "sensor"),
    ("aloft", "key"),
    ("three_numbers", "numeric"),
    ("greeting", "text"),
    ("wedge", "mesh"),
    ("no such thing", "body"),
    ("cart", "no such type"),
    ("", "body"),
]


@pytest.mark.parametrize(("thing", "kind"), _LOOKUPS)
def test_names_and_ids_are_found_alike(thing: str, kind: Any) -> None:
    twin = _zoo()
    calls = [functools.partial(one.model.name2id, thing, kind) for one in twin.both]
    assert_same_outcome(calls, f"name2id({thing!r}, {kind!r})")
    for index in (0, 1, 2, 99, -1):
        calls = [functools.partial(one.model.id2name, index, kind) for one in twin.both]
        assert_same_outcome(calls, f"id2name({index}, {kind!r})")


@pytest.mark.parametrize(
    "flags",
    [
        ("gravity",),
        ("contact", "gravity"),
        ("actuation",),
        (mujoco.mjtDisableBit.mjDSBL_CONTACT,),
        (mujoco.mjtDisableBit.mjDSBL_LIMIT, mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS),
        (int(mujoco.mjtDisableBit.mjDSBL_GRAVITY), "limit"),
        (),
    ],
)
def test_disabled_flags_act_the_same_and_come_back(flags: tuple[Any, ...]) -> None:
    twin = _zoo()
    before = twin.both[1].model.opt.disableflags
    contexts = [physics.model.disable(*flags) for physics in twin.both]
    with contexts[0], contexts[1]:
        assert_same_pair((one.model.opt.disableflags for one in twin.both), "flags")
        twin.play(5)
    for physics in twin.both:
        assert physics.model.opt.disableflags == before
    twin.play(5)


@pytest.mark.parametrize("flag", ["no such flag", "mjDSBL_GRAVITY", 3])
def test_a_flag_that_is_not_there_is_refused_alike(flag: Any) -> None:
    twin = _zoo()
    before = twin.both[0].model.opt.disableflags

    def disable(physics: Any) -> None:
        with physics.model.disable(flag):
            pass

    with pytest.raises(ValueError, match=str(flag)):
        disable(twin.both[0])
    twin.do(disable)
    assert twin.both[0].model.opt.disableflags == before


def test_contact_forces_are_the_same() -> None:
    twin = _zoo()
    twin.play(20)
    contacts = twin.both[1].data.ncon
    assert contacts > 0
    for contact in (*range(contacts), -1, contacts):
        calls = [functools.partial(one.data.contact_force, contact) for one in twin.both]
        assert_same_outcome(calls, f"contact_force({contact})")
    assert len(twin.both[0].data.contact) == contacts
    for ours, theirs in zip(*(one.data.contact for one in twin.both), strict=True):
        assert (ours.dist, ours.geom1, ours.geom2) == (theirs.dist, theirs.geom1, theirs.geom2)


@pytest.mark.parametrize(
    "arguments",
    [
        ("cart", "body"),
        ("hand", "body", True),
        ("grip", "site", True),
        (1, "geom"),
        (2, mujoco.mjtObj.mjOBJ_BODY.value),
        ("nothing", "body"),
        ("cart", "nothing"),
    ],
)
def test_object_velocities_are_the_same(arguments: tuple[Any, ...]) -> None:
    twin = _zoo()
    twin.play(10)
    calls = [functools.partial(one.data.object_velocity, *arguments) for one in twin.both]
    assert_same_outcome(calls, f"object_velocity{arguments}")


@every_model
def test_action_specs_are_the_same(name: str) -> None:
    specs = [
        package("mujoco").action_spec(physics)
        for package, physics in zip(BOTH, _zoo(name).both, strict=True)
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
    twin = _zoo()
    errors = []
    for package, physics in zip(BOTH, twin.both, strict=True):
        with pytest.raises(package("rl.control").PhysicsError) as error:
            destroy(physics)
        errors.append(error.value)
    our_message, their_message = map(str, errors)
    # Ours may go on to say what to do.
    assert our_message.startswith(their_message)
    twin.assert_same_state()
    # A warning that was there before is none of the next step's.
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
    twin = _zoo()
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


@every_model
def test_every_constructor_makes_the_same_physics(name: str, tmp_path: Path) -> None:
    xml_path, binary_path = tmp_path / "model.xml", tmp_path / "model.mjb"
    xml_path.write_text(_XML[name])
    _zoo(name).both[1].model.save_binary(str(binary_path))
    ways: dict[str, Callable[[Any], Any]] = {
        "from_xml_string": lambda mujoco: mujoco.Physics.from_xml_string(_XML[name]),
        "from bytes of XML": lambda mujoco: mujoco.Physics.from_xml_string(_XML[name].encode()),
        "from_xml_path": lambda mujoco: mujoco.Physics.from_xml_path(str(xml_path)),
        "from_binary_path": lambda mujoco: mujoco.Physics.from_binary_path(str(binary_path)),
        "from_byte_string": lambda mujoco: mujoco.Physics.from_byte_string(
            mujoco.Physics.from_xml_string(_XML[name]).model.to_bytes()
        ),
        "from_model": lambda mujoco: mujoco.Physics.from_model(
            mujoco.wrapper.MjModel.from_xml_string(_XML[name])
        ),
        "from data": lambda mujoco: mujoco.Physics(
            mujoco.wrapper.MjData(mujoco.wrapper.MjModel.from_xml_string(_XML[name]))
        ),
        "reload_from_xml_string": lambda mujoco: _reloaded(mujoco, "string", _XML[name]),
        "reload_from_xml_path": lambda mujoco: _reloaded(mujoco, "path", str(xml_path)),
    }
    for way, make in ways.items():
        twin = TwinPhysics(*(make(package("mujoco")) for package in BOTH), where=f"{name} {way}")
        twin.assert_same_state()
        twin.play(5)


def _reloaded(mujoco_module: Any, source: str, xml: str) -> Any:
    physics = mujoco_module.Physics.from_xml_string("<mujoco><worldbody/></mujoco>")
    getattr(physics, f"reload_from_xml_{source}")(xml)
    return physics


def test_assets_are_found_by_name_alike() -> None:
    xml = (
        "<mujoco><include file='body.xml'/><asset><texture name='t' file='t.png'/></asset></mujoco>"
    )
    body = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    white_pixel = (
        b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\x02\0\0\0\x90wS\xde\0\0\0\x0cIDATx"
        b"\x9cc\xf8\xff\xff?\0\x05\xfe\x02\xfe\r\xefF\xb8\0\0\0\0IEND\xaeB`\x82"
    )
    assets = {"body.xml": body.encode(), "t.png": white_pixel}
    both = (package("mujoco").Physics.from_xml_string(xml, assets=assets) for package in BOTH)
    twin = TwinPhysics(*both, where="assets")
    twin.play(3)
    assert_same_pair((physics.model.tex_data for physics in twin.both), "texture")


@pytest.mark.parametrize("xml", ["", "<mujoco>", "<mujoco><worldbody><geom/></worldbody></mujoco>"])
def test_malformed_xml_is_refused_alike_and_mujocos_message_is_kept(xml: str) -> None:
    calls = [functools.partial(package("mujoco").Physics.from_xml_string, xml) for package in BOTH]
    error = assert_same_outcome(calls, xml)
    with pytest.raises(ValueError, match=r"\S") as native:
        mujoco.MjModel.from_xml_string(xml)
    assert str(native.value).splitlines()[0] in str(error)


def test_a_file_that_is_not_there_is_refused_alike(tmp_path: Path) -> None:
    for constructor in ("from_xml_path", "from_binary_path"):
        makes = [getattr(package("mujoco").Physics, constructor) for package in BOTH]
        calls = [functools.partial(make, str(tmp_path / "none.xml")) for make in makes]
        assert assert_same_outcome(calls, constructor) is not None


@pytest.mark.parametrize("model", models.ODD_JOINTS)
def test_random_joints_take_the_same_draws(model: str) -> None:
    for seed in range(20):
        ends = []
        twin = TwinPhysics(
            *(
                package("mujoco").Physics.from_xml_string(models.ODD_JOINTS[model])
                for package in BOTH
            ),
            where=f"{model}, seed {seed}",
        )
        for package, physics in zip(BOTH, twin.both, strict=True):
            random = np.random.RandomState(seed)
            randomizers = package("suite.utils.randomizers")
            for _ in range(3):
                randomizers.randomize_limited_and_rotational_joints(physics, random)
            ends.append(random.random_sample())
        twin.assert_same_state()
        assert_same_pair(ends, f"{twin.where}: next draw")


def test_random_joints_draw_from_numpys_own_stream_by_default() -> None:
    twin = TwinPhysics(
        *(
            package("mujoco").Physics.from_xml_string(
                models.ODD_JOINTS["each type, limited and not"]
            )
            for package in BOTH
        )
    )
    state = np.random.get_state()
    for package, physics in zip(BOTH, twin.both, strict=True):
        np.random.seed(17)
        package("suite.utils.randomizers").randomize_limited_and_rotational_joints(physics)
    np.random.set_state(state)
    twin.assert_same_state()


def test_random_limited_quaternions_are_the_same() -> None:
    for seed in range(50):
        quaternions = [
            package("suite.utils.randomizers").random_limited_quaternion(
                np.random.RandomState(seed), 0.1 * seed
            )
            for package in BOTH
        ]
        assert_same_pair(quaternions, f"seed {seed}")


_DOMAIN_METHODS = {
    "humanoid": {
        "torso_upright": (),
        "head_height": (),
        "center_of_mass_position": (),
        "center_of_mass_velocity": (),
        "torso_vertical_orientation": (),
        "joint_angles": (),
        "extremities": (),
    },
    "manipulator": {
        "touch": (),
        "bounded_joint_pos": (["arm_root", "finger"],),
        "joint_vel": (["arm_wrist", "thumb"],),
        "body_2d_pose": ("hand",),
        "site_distance": ("grasp", "pinch"),
    },
}
_DOMAIN_METHODS["stacker"] = _DOMAIN_METHODS["manipulator"]


@pytest.mark.parametrize(("domain", "task"), twins.MODELS)
def test_the_quantities_of_a_domain_are_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    env.reset()
    for action in itertools.islice(env.actions("bang-bang", 5), 50):
        env.step(action)
        for method, arguments in _DOMAIN_METHODS[domain].items():
            values = [getattr(one.physics, method)(*arguments) for one in (env.ours, env.theirs)]
            assert_same_pair(values, f"{env.where} {method}")


@pytest.mark.parametrize("task", [task for task in twins.MODELS if task[0] != "humanoid"])
def test_poses_of_several_bodies_are_the_same(task: tuple[str, str]) -> None:
    env = twins.load(*task)
    env.reset()
    for bodies in (["hand"], ["hand", "upper_arm"], "hand"):
        for orientation in (True, False):
            poses = [
                one.physics.body_2d_pose(bodies, orientation=orientation)
                for one in (env.ours, env.theirs)
            ]
            assert_same_pair(poses, f"{env.where} {bodies}")
