"""`mjbindings` enums and constants equal dm_control's, except for changes in MuJoCo 4.0."""

from types import ModuleType
from typing import Any

import mujoco
import pytest

from . import twins
from .drawn_here import DOMAINS as DRAWN_HERE
from .oracle import BOTH, ours, theirs
from .same import assert_same, assert_same_pair, fields

pytestmark = pytest.mark.oracle

_MJBINDINGS = "mujoco.wrapper.mjbindings"


def _public(module: Any) -> dict[str, Any]:
    return {name: value for name, value in vars(module).items() if name.startswith("mj")}


# Names that MuJoCo's Python package does not have: sizes and keys of its C user interface, and
# limits that 4.0 dropped.
_NOT_IN_MUJOCO = {
    *("mjNAUX", "mjMAXTEXTURE", "mjMAXMATERIAL", "mjSEPCLOSED", "mjPRESERVE"),
    *(f"mjMAXUI{name}" for name in ("SECT", "ITEM", "TEXT", "NAME", "MULTI", "EDIT", "RECT")),
    *(f"mjKEY_{name}" for name in ("ESCAPE", "ENTER", "TAB", "BACKSPACE", "INSERT", "DELETE")),
    *(f"mjKEY_{name}" for name in ("RIGHT", "LEFT", "DOWN", "UP", "PAGE_UP", "PAGE_DOWN")),
    *(f"mjKEY_{name}" for name in ("HOME", "END", "NUMPAD_0", "NUMPAD_9")),
    *(f"mjKEY_F{number}" for number in range(1, 13)),
}
# Counts that grew with the members that MuJoCo 4.0 added, and the version itself.
_CHANGED = {"mjtEnableBit.mjNENABLE", "mjtRndFlag.mjNRNDFLAG", "mjVERSION_HEADER"}

_ENUMS = _public(theirs(f"{_MJBINDINGS}.enums"))
_CONSTANTS = _public(theirs(f"{_MJBINDINGS}.constants"))
_STRINGS = [name for name in _public(theirs(f"{_MJBINDINGS}.functions")) if name.endswith("STRING")]


@pytest.mark.parametrize("name", _ENUMS)
def test_an_enum_has_the_same_members_of_the_same_values(name: str) -> None:
    our_enum: Any = getattr(ours(f"{_MJBINDINGS}.enums"), name)
    their_enum = _ENUMS[name]
    assert issubclass(type(our_enum), tuple)
    added = [field for field in our_enum._fields if field not in their_enum._fields]
    assert [field for field in our_enum._fields if field not in added] == list(their_enum._fields)
    for field, value in their_enum._asdict().items():
        installed = getattr(getattr(mujoco, name), field).value
        assert (installed != value) == (f"{name}.{field}" in _CHANGED), f"{name}.{field}"
        assert_same(getattr(our_enum, field), installed, f"{name}.{field}")


@pytest.mark.parametrize("name", [name for name in _CONSTANTS if name not in _NOT_IN_MUJOCO])
def test_a_constant_has_the_same_value(name: str) -> None:
    installed = getattr(mujoco, name)
    assert (installed != _CONSTANTS[name]) == (name in _CHANGED)
    assert_same(getattr(ours(f"{_MJBINDINGS}.constants"), name), installed, name)


def test_the_constants_that_mujoco_lacks_are_listed_rightly() -> None:
    assert {name for name in _CONSTANTS if not hasattr(mujoco, name)} == _NOT_IN_MUJOCO


@pytest.mark.parametrize("name", _STRINGS)
def test_a_table_of_names_is_the_same(name: str) -> None:
    functions = [package(f"{_MJBINDINGS}.functions") for package in BOTH]
    assert_same_pair((getattr(module, name) for module in functions), name)


def test_mjlib_is_the_official_package() -> None:
    for package in BOTH:
        assert package(_MJBINDINGS).mjlib is mujoco
        assert package(f"{_MJBINDINGS}.functions").mjlib is mujoco
        assert package("mujoco.wrapper.core").mjlib is mujoco


# OpenGL contexts are the renderer's own.
_NOT_BUILT = {"MjrContext"}


@pytest.mark.parametrize(
    ("module", "not_built"), [("mujoco", set()), ("mujoco.wrapper", _NOT_BUILT)]
)
def test_every_public_name_of_dm_control_exists(module: str, not_built: set[str]) -> None:
    public = {
        name
        for name, value in vars(theirs(module)).items()
        if not name.startswith("_") and not isinstance(value, ModuleType)
    }
    assert {name for name in public if not hasattr(ours(module), name)} == not_built


@pytest.mark.parametrize("name", ["MjvCamera", "MjvFigure", "MjvOption", "MjvPerturb"])
def test_a_visual_struct_begins_the_same(name: str) -> None:
    structs = [getattr(package("mujoco.wrapper"), name)() for package in BOTH]
    found = [dict(fields(struct)) for struct in structs]
    assert found[1]
    assert_same_pair(found, name)
    for struct in structs:
        assert struct.ptr is struct


# A scene has room for the geoms and meshes of its model.
_MODELS = [task for task in twins.MODELS if task[0] not in DRAWN_HERE]


@pytest.mark.parametrize(("domain", "task"), _MODELS)
def test_a_scene_has_room_for_as_many_geoms(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    scenes = [
        package("mujoco.wrapper").MjvScene(one.physics.model)
        for package, one in zip(BOTH, (env.ours, env.theirs), strict=True)
    ]
    assert_same_pair([scene.maxgeom for scene in scenes], env.where)
    assert_same_pair([len(scene.geoms) for scene in scenes], env.where)
