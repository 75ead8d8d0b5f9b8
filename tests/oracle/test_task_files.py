"""Names and texts that published task files take from the domains' modules are dm_control's.

Task files import private constants and helper functions, call or override private methods of
tasks, and edit the models' MJCF by paths of tags.
"""

import inspect
import itertools
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from . import twins
from .drawn_here import DOMAINS as DRAWN_HERE
from .oracle import BOTH, theirs
from .same import assert_same, assert_same_pair, fields

pytestmark = pytest.mark.oracle
etree: Any = pytest.importorskip("lxml.etree", reason="lxml is not installed")

DOMAINS = sorted({domain for domain, _ in twins.TASKS})
# Listed in docs/migrating.md, under "Helpers that are absent".
_ABSENT = {
    "dog": {"_ASSET_DIR"},
    "finger": {"_INITIAL_SPIN_VELOCITY", "_STOP_VELOCITY", "_set_random_joint_angles"},
    "lqr": {"_make_body", "_make_model"},
    "manipulator": {"Bring._is_close", "Bring._peg_reward", "Bring._ball_reward"},
    "swimmer": {"_make_body", "_make_model", "_make_swimmer"},
}


def _defined(module: ModuleType) -> dict[str, Any]:
    """The names that a module of dm_control defines; not those that it imports."""
    names = {name: value for name, value in vars(module).items() if not name.startswith("__")}
    return {
        name: value
        for name, value in names.items()
        if not isinstance(value, ModuleType)
        and getattr(value, "__module__", module.__name__) == module.__name__
    }


def _arguments(function: Callable[..., Any]) -> list[tuple[str, Any]]:
    return [(p.name, p.default) for p in inspect.signature(function).parameters.values()]


def _assert_takes_the_same(ours: Any, theirs: Any, where: str) -> None:
    """Our function takes all calls that theirs takes: more of its arguments may have defaults."""
    our_arguments, their_arguments = _arguments(ours), _arguments(theirs)
    for (name, default), (their_name, their_default) in zip(
        our_arguments, their_arguments, strict=False
    ):
        assert name == their_name, where
        if their_default is not inspect.Parameter.empty:
            assert_same(default, their_default, f"{where}, {name}")
    more = our_arguments[len(their_arguments) :]
    assert len(our_arguments) >= len(their_arguments), where
    assert all(default is not inspect.Parameter.empty for _, default in more), where


@pytest.mark.parametrize("domain", DOMAINS)
def test_a_domain_defines_what_dm_controls_defines(domain: str) -> None:
    modules = [package(f"suite.{domain}") for package in BOTH]
    absent = set()
    for name, value in _defined(modules[1]).items():
        if not hasattr(modules[0], name):
            absent.add(name)
            continue
        here = getattr(modules[0], name)
        if inspect.isclass(value):
            for member, of_class in vars(value).items():
                if inspect.isfunction(of_class) and not hasattr(here, member):
                    absent.add(f"{name}.{member}")
                elif inspect.isfunction(of_class):
                    _assert_takes_the_same(getattr(here, member), of_class, f"{name}.{member}")
                elif isinstance(of_class, tuple | float):
                    assert_same(getattr(here, member), of_class, f"{domain}.{name}.{member}")
        elif inspect.isfunction(value):
            _assert_takes_the_same(here, value, f"{domain}.{name}")
        elif name == "SUITE":
            assert list(here) == list(value)
        else:
            assert here == value, f"{domain}.{name} is {here!r}, dm_control has {value!r}"
    assert absent == _ABSENT.get(domain, set())


# Models as text.

_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "cartpole": (3,),
    "lqr": (6, 2, np.random.RandomState(0)),
    "manipulator": (True, True),
    "stacker": (4,),
    "swimmer": (6,),
}
# Paths below which our text differs, and why.
_OTHER_PATHS = {
    "include": "the order of the included files is free",
    "option": "lqr's has two of them",
    "asset": "quadruped has two of them; fish includes the sky",
    "compiler": "cheetah's settotalmass is deprecated: its inertias are written out",
    "visual": "the order is free",
    "default/site": "walker's is used by no element",
    "default/general": "fish sets it for position actuators",
}
_ARM_CLASSES = ["arm", "object", "obstacle", "ghost"]  # without "task", of a site
_OTHER_CLASSES = {
    "cartpole": ["pole", "rail"],
    "cheetah": ["cheetah"],
    "manipulator": _ARM_CLASSES,
    "stacker": _ARM_CLASSES,
}


def _text(package: Any, domain: str) -> bytes:
    """The MJCF of a domain with everything that its tasks can have."""
    module = package(f"suite.{domain}")
    if domain == "quadruped":
        return module.make_model(terrain=True, rangefinders=True, walls_and_ball=True)
    make = getattr(module, "get_model_and_assets", None) or module.make_model
    return make(*_ARGUMENTS.get(domain, ()))[0]


def _paths(root: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Path of tags and name (of a class: the class) of each element, in the text's order."""
    for child in root:
        if isinstance(child.tag, str):
            below = f"{path}/{child.tag}" if path else child.tag
            yield below, child.get("name") or child.get("class") or ""
            yield from _paths(child, below)


@pytest.mark.parametrize("domain", [name for name in DOMAINS if name not in DRAWN_HERE])
def test_a_path_of_tags_finds_the_same_elements(domain: str) -> None:
    found: list[dict[str, list[str]]] = []
    for package in BOTH:
        found.append({})
        for path, name in _paths(etree.fromstring(_text(package, domain))):
            found[-1].setdefault(path, []).append(name)
    for path, names in found[1].items():
        if path.startswith(tuple(_OTHER_PATHS)):
            continue
        if path == "default/default/site" and _OTHER_CLASSES.get(domain) == _ARM_CLASSES:
            continue
        here = found[0].get(path, [])
        if path == "default/default" and domain in _OTHER_CLASSES:
            names = _OTHER_CLASSES[domain]
        if path.startswith("default/default/"):
            here, names = here[:1], names[:1]  # further ones need no classes of their own
        assert list(filter(None, here)) == list(filter(None, names)), path
        assert bool(here) == bool(names), path


@pytest.mark.parametrize("domain", [name for name in DOMAINS if name not in DRAWN_HERE])
def test_a_file_of_the_suite_compiles_to_the_same(domain: str) -> None:
    if _ARGUMENTS.get(domain) in ((True, True), (4,)):
        pytest.skip("the arm's file is included; make_model returns one text")
    texts = [package("suite.common").read_model(f"{domain}.xml") for package in BOTH]
    physics = [
        package("mujoco").Physics.from_xml_string(text, package("suite.common").ASSETS)
        for package, text in zip(BOTH, texts, strict=True)
    ]
    for (name, here), (_, there) in zip(*(fields(one.model.ptr) for one in physics), strict=True):
        assert_same(here, there, f"{domain}: {name}")


def _edited(package: Any, domain: str, edit: Callable[[Any], None]) -> bytes:
    root = etree.fromstring(_text(package, domain))
    edit(root)
    return etree.tostring(root)


def _set(path: str, **attributes: str) -> Callable[[Any], None]:
    """Sets attributes of the first element of a path."""

    def edit(root: Any) -> None:
        for name, value in attributes.items():
            root.find(path).set(name, value)

    return edit


def _longer_knees(root: Any) -> None:
    for part in root.findall("./default/default/default"):
        if part.get("class") == "knee":
            part.find("./geom").set("fromto", "0 0 0 .4 0 -.4")
    for ankle in root.findall("./worldbody/body/body/body/body"):
        ankle.set("pos", ".4 0 -.4")


def _longer_thighs(root: Any) -> None:
    for thigh in root.findall("./worldbody/body/body/geom"):
        thigh.set("pos", "0 0 -.4")
        thigh.set("size", "0.05 .4")
    for leg in root.findall("./worldbody/body/body/body"):
        leg.set("pos", "0 0 -1.05")


def _obstacle(root: Any) -> None:
    box = {"name": "box", "type": "box", "pos": "3 0 .1", "size": ".1 .8 .1"}
    etree.SubElement(root.find("worldbody"), "geom", box)


_EDITS = [
    ("cartpole", _set("./default/default/geom", fromto="0 0 0 0 0 1.6", mass="0.16")),
    ("cartpole", _set("./default/default/joint", damping="1e-2")),
    ("cartpole", _set("./worldbody/body/joint", damping="0.4")),
    ("walker", _longer_thighs),
    ("walker", _set("./default/joint", damping="1.1")),
    ("walker", _set("./default/geom", friction="1.3 .1 .1")),
    ("walker", _obstacle),
    ("hopper", _obstacle),
    ("humanoid", _set("./default/default/joint", damping="1.2")),
    ("humanoid", _set("./default/default/geom", friction=".2 .1 .1")),
    ("humanoid", _set("./worldbody/body/body/geom", size=".12")),
    ("humanoid_CMU", _set("./default/joint", damping="1.4")),
    ("ball_in_cup", _set("./default/default/joint", damping="7")),
    ("swimmer", _set("./default/default/default/geom", mass=".02")),
    ("quadruped", _longer_knees),
    ("quadruped", _set("./default/default/joint", damping="60")),
    ("quadruped", _set(".//default[@class='pitch']/joint", range="-10 30")),
    ("quadruped", _set(".//map", znear=".01")),
    ("manipulator", _set("./worldbody/body/body/body/geom", fromto="0 0 0 0 0 .2")),
    ("manipulator", _set("./worldbody/body/body/joint", damping="3")),
    ("stacker", _set("./worldbody/body/body/body/body", pos="0 0 .2")),
]


@pytest.mark.parametrize("number", range(len(_EDITS)))
def test_an_edit_of_the_text_has_the_same_effect(number: int) -> None:
    domain, edit = _EDITS[number]
    ours, theirs, unedited = (
        package(f"suite.{domain}").Physics.from_xml_string(text, package("suite.common").ASSETS)
        for package, text in [
            *((package, _edited(package, domain, edit)) for package in BOTH),
            (BOTH[1], _text(BOTH[1], domain)),
        ]
    )
    models = [dict(fields(physics.model.ptr)) for physics in (ours, theirs, unedited)]
    assert any(np.any(models[1][name] != models[2].get(name)) for name in models[1]), "no effect"
    for name, value in models[1].items():
        assert_same(models[0][name], value, f"{domain}, edit {number}: {name}")
    twins.TwinPhysics(ours, theirs, where=f"{domain}, edit {number}").play(10)


# Programs with private helpers, written once for both packages.


def _both(make: Callable[[Any], Any], where: str) -> twins.Twins:
    return twins.Twins(*(make(package) for package in BOTH), where=where)


def _play(env: twins.Twins, steps: int = 40) -> None:
    for episode in range(2):
        env.reset()
        env.play(itertools.islice(env.actions("bang-bang", episode), steps))


def _turned(package: Any) -> Any:
    """A quadruped that starts upright somewhere, with the helpers of dm_control's module."""
    quadruped, base = package("suite.quadruped"), package("suite.base")

    class Turned(quadruped.Move):
        def initialize_episode(self, physics: Any) -> None:
            half = self.random.uniform(0, np.pi)
            orientation = np.array((np.cos(half), 0, 0, np.sin(half)))
            quadruped._find_non_contacting_height(physics, orientation, x_pos=1.5, y_pos=-0.5)
            base.Task.initialize_episode(self, physics)

        def get_observation(self, physics: Any) -> Any:
            observation = quadruped._common_observations(physics)
            observation["toes"] = physics.named.data.xpos[quadruped._TOES].ravel()
            return observation

        def get_reward(self, physics: Any) -> Any:
            return quadruped._upright_reward(physics, deviation_angle=20)

    xml = quadruped.make_model(floor_size=quadruped._DEFAULT_TIME_LIMIT * quadruped._WALK_SPEED)
    physics = quadruped.Physics.from_xml_string(xml, quadruped.common.ASSETS)
    return package("rl.control").Environment(
        physics, Turned(quadruped._WALK_SPEED, random=3), 20, quadruped._CONTROL_TIMESTEP
    )


def test_a_task_with_the_helpers_of_quadruped_runs_the_same() -> None:
    _play(_both(_turned, "turned"))


def test_another_body_is_put_above_the_ground_alike() -> None:
    twin = twins.TwinPhysics(
        *(package("suite").load("humanoid", "stand", {"random": 0}).physics for package in BOTH)
    )
    for package, physics in zip(BOTH, twin.both, strict=True):
        find = package("suite.quadruped")._find_non_contacting_height
        find(physics, np.array([0.8, 0.6, 0.0, 0.0]))
    twin.assert_same_state()
    assert 0 < twin.both[0].position()[2] < 2
    twin.play()


def test_a_quadruped_with_other_joints_and_sensors_is_measured_alike() -> None:
    def edit(root: Any) -> None:
        for element in root.iter("joint", "general"):
            for key in ("name", "joint"):
                if element.get(key, "").startswith("yaw_"):
                    element.set(key, f"turn_{element.get(key)}")
        sensors = root.find("sensor")
        etree.SubElement(sensors, "gyro", name="second_gyro", site="torso")
        etree.SubElement(sensors, "rangefinder", name="second_look", site="rf_22")

    physics = []
    for package in BOTH:
        quadruped, xml = package("suite.quadruped"), _edited(package, "quadruped", edit)
        physics.append(quadruped.Physics.from_xml_string(_text(package, "quadruped"), _assets()))
        assert physics[-1].rangefinder().shape == (20,)
        physics[-1].reload_from_xml_string(xml, _assets())
    twin = twins.TwinPhysics(*physics, where="edited quadruped")
    twin.play()
    for name in ("egocentric_state", "imu", "rangefinder", "force_torque"):
        assert_same_pair((getattr(one, name)() for one in physics), name)
    assert physics[0].rangefinder().shape == (21,)
    assert all(copied.imu().shape == (9,) for copied in twin.map(lambda one: one.copy()).both)
    assert_same_pair((one._hinge_names for one in physics), "hinges")


def _assets() -> Any:
    return theirs("suite.common").ASSETS


@pytest.mark.parametrize(
    ("domain", "task"),
    [("acrobot", "swingup"), ("acrobot", "swingup_sparse"), ("cartpole", "balance"),
     ("cartpole", "swingup_sparse"), ("cartpole", "two_poles")],
)  # fmt: skip
def test_the_reward_under_its_private_name_is_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    env.reset()
    for action in itertools.islice(env.actions("bang-bang", 5), 60):
        env.step(action)
        for sparse in (False, True):
            rewards = (one.task._get_reward(one.physics, sparse) for one in (env.ours, env.theirs))
            assert_same_pair(rewards, f"{env.where}, sparse={sparse}")


@pytest.mark.parametrize("domain", ["acrobot", "cartpole"])
@pytest.mark.parametrize("is_overridden", ["_get_reward", "get_reward", "both"])
def test_a_private_reward_that_a_subclass_overrides_is_its_reward(
    domain: str, is_overridden: str
) -> None:
    def make(package: Any) -> Any:
        module = package(f"suite.{domain}")

        def private(self: Any, physics: Any, sparse: bool) -> Any:
            return 0.25 * module.Balance._get_reward(self, physics, sparse=not sparse)

        def public(self: Any, physics: Any) -> Any:
            return 2.0 * self._get_reward(physics, sparse=self._sparse)

        def terms(self: Any, physics: Any) -> dict[str, Any]:  # a name of its own, by chance
            return {"precise": module.Balance._get_reward(self, physics, sparse=False)}

        methods = {
            "_get_reward": {"_get_reward": private},
            "get_reward": {"get_reward": public, "reward_terms": terms},
            "both": {"_get_reward": private, "get_reward": public},
        }[is_overridden]
        kind = type("Own", (type("Between", (module.Balance,), methods),), {})
        arguments = {"swing_up": True} if domain == "cartpole" else {}
        physics = module.Physics.from_xml_string(*module.get_model_and_assets())
        task = kind(sparse=False, random=1, **arguments)
        return package("rl.control").Environment(physics, task, time_limit=1)

    _play(_both(make, f"{domain}, {is_overridden}"), 60)


def test_a_chain_of_another_length_is_made_alike() -> None:
    def make(package: Any) -> Any:
        lqr = package("suite.lqr")
        return lqr._make_lqr(
            n_bodies=4, n_actuators=3, control_cost_coef=0.3, time_limit=2, random=5,
            environment_kwargs={"flat_observation": True},
        )  # fmt: skip

    _play(_both(make, "lqr"))


def test_the_probabilities_of_starts_can_be_set(monkeypatch: pytest.MonkeyPatch) -> None:
    for package in BOTH:
        monkeypatch.setattr(package("suite.manipulator"), "_P_IN_HAND", 0.8)
        assert "ball" in package("suite.manipulator")._ALL_PROPS.difference(["peg"])
    env = twins.load("manipulator", "bring_ball")
    starts = []
    for _ in range(10):
        env.reset()
        env.assert_same_physics("data.qpos", "data.qvel")
        starts.append(env.ours.task.start(env.ours.physics))
    assert starts.count("in_hand") > 5


def test_an_override_of_a_measurement_is_what_the_task_reads() -> None:
    def make(package: Any) -> Any:
        module = package("suite.humanoid_CMU")

        class Physics(module.Physics):
            def thorax_upright(self) -> Any:
                return 0.5 * super().thorax_upright()

        physics = Physics.from_xml_string(*module.get_model_and_assets())
        return package("rl.control").Environment(
            physics, module.HumanoidCMU(1.0, random=0), 20, module._CONTROL_TIMESTEP
        )

    _play(_both(make, "humanoid_CMU"), 20)


def _perturbed(package: Any) -> Any:
    """A cart whose pole is longer in each episode, as in suites of real-world perturbations."""
    cartpole, control = package("suite.cartpole"), package("rl.control")

    class Perturbed:
        def __init__(self) -> None:
            self._length = 0.8

        def new_physics(self) -> Any:
            self._length += 0.2
            root = etree.fromstring(package("suite.common").read_model("cartpole.xml"))
            root.find("./default/default/geom").set("fromto", f"0 0 0 0 0 {self._length}")
            return cartpole.Physics.from_xml_string(etree.tostring(root), cartpole.common.ASSETS)

    class Task(Perturbed, cartpole.Balance):
        def __init__(self, **kwargs: Any) -> None:
            Perturbed.__init__(self)
            cartpole.Balance.__init__(self, **kwargs)

        def get_observation(self, physics: Any) -> Any:
            observation = cartpole.Balance.get_observation(self, physics)
            observation["is_safe"] = np.array([abs(physics.cart_position().copy()) < 1.5])
            return observation

        def before_step(self, action: Any, physics: Any) -> None:
            limits = self.action_spec(physics)
            noisy = action + self.random.normal(0, 0.1, action.shape)
            clipped = np.clip(noisy, limits.minimum, limits.maximum)
            cartpole.Balance.before_step(self, clipped, physics)

        def get_reward(self, physics: Any) -> Any:
            return cartpole.Balance.get_reward(self, physics) - 0.1

    class Environment(control.Environment):
        def reset(self) -> Any:
            self._physics = self._task.new_physics()
            return super().reset()

    task = Task(swing_up=True, sparse=False, random=2)
    physics = cartpole.Physics.from_xml_string(*cartpole.get_model_and_assets())
    return Environment(physics, task, time_limit=2)


def test_a_task_that_replaces_its_physics_runs_the_same() -> None:
    env = _both(_perturbed, "perturbed")
    for _ in range(3):
        _play(env)
        env.assert_same_physics("model.geom_size", "data.qpos")
