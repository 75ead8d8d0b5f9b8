"""Models and data: constructors, lookups, flags, forces and velocities behave as in dm_control."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pytest

from . import models, twins
from .oracle import BOTH
from .same import assert_same_outcome, assert_same_pair

pytestmark = pytest.mark.oracle

every_model = pytest.mark.parametrize("name", list(models.BY_NAME))


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
    twin = twins.load_physics()
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
    twin = twins.load_physics()
    before = twin.both[1].model.opt.disableflags
    contexts = [physics.model.disable(*flags) for physics in twin.both]
    with contexts[0], contexts[1]:
        assert_same_pair((one.model.opt.disableflags for one in twin.both), "flags")
        twin.play(5)
    for physics in twin.both:
        assert physics.model.opt.disableflags == before
    twin.play(5)


@pytest.mark.parametrize("flag", ["no such flag", "mjDSBL_GRAVITY", 3])
def test_an_unknown_flag_is_refused_alike(flag: Any) -> None:
    twin = twins.load_physics()
    before = twin.both[0].model.opt.disableflags

    def disable(physics: Any) -> None:
        with physics.model.disable(flag):
            pass

    with pytest.raises(ValueError, match=str(flag)):
        disable(twin.both[0])
    twin.do(disable)
    assert twin.both[0].model.opt.disableflags == before


def test_contact_forces_are_the_same() -> None:
    twin = twins.load_physics()
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
    twin = twins.load_physics()
    twin.play(10)
    calls = [functools.partial(one.data.object_velocity, *arguments) for one in twin.both]
    assert_same_outcome(calls, f"object_velocity{arguments}")


@every_model
def test_every_constructor_makes_the_same_physics(name: str, tmp_path: Path) -> None:
    xml_path, binary_path = tmp_path / "model.xml", tmp_path / "model.mjb"
    xml_path.write_text(models.BY_NAME[name])
    twins.load_physics(name).both[1].model.save_binary(str(binary_path))
    ways: dict[str, Callable[[Any], Any]] = {
        "from_xml_string": lambda mujoco: mujoco.Physics.from_xml_string(models.BY_NAME[name]),
        "from bytes of XML": lambda mujoco: mujoco.Physics.from_xml_string(
            models.BY_NAME[name].encode()
        ),
        "from_xml_path": lambda mujoco: mujoco.Physics.from_xml_path(str(xml_path)),
        "from_binary_path": lambda mujoco: mujoco.Physics.from_binary_path(str(binary_path)),
        "from_byte_string": lambda mujoco: mujoco.Physics.from_byte_string(
            mujoco.Physics.from_xml_string(models.BY_NAME[name]).model.to_bytes()
        ),
        "from_model": lambda mujoco: mujoco.Physics.from_model(
            mujoco.wrapper.MjModel.from_xml_string(models.BY_NAME[name])
        ),
        "from data": lambda mujoco: mujoco.Physics(
            mujoco.wrapper.MjData(mujoco.wrapper.MjModel.from_xml_string(models.BY_NAME[name]))
        ),
        "reload_from_xml_string": lambda mujoco: _reloaded(mujoco, "string", models.BY_NAME[name]),
        "reload_from_xml_path": lambda mujoco: _reloaded(mujoco, "path", str(xml_path)),
    }
    for way, make in ways.items():
        twin = twins.TwinPhysics(
            *(make(package("mujoco")) for package in BOTH), where=f"{name} {way}"
        )
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
    twin = twins.TwinPhysics(*both, where="assets")
    twin.play(3)
    assert_same_pair((physics.model.tex_data for physics in twin.both), "texture")


@pytest.mark.parametrize("xml", ["", "<mujoco>", "<mujoco><worldbody><geom/></worldbody></mujoco>"])
def test_malformed_xml_is_refused_alike_and_mujocos_message_is_kept(xml: str) -> None:
    calls = [functools.partial(package("mujoco").Physics.from_xml_string, xml) for package in BOTH]
    error = assert_same_outcome(calls, xml)
    with pytest.raises(ValueError, match=r"\S") as native:
        mujoco.MjModel.from_xml_string(xml)
    assert str(native.value).splitlines()[0] in str(error)


def test_a_missing_file_is_refused_alike(tmp_path: Path) -> None:
    for constructor in ("from_xml_path", "from_binary_path"):
        makes = [getattr(package("mujoco").Physics, constructor) for package in BOTH]
        calls = [functools.partial(make, str(tmp_path / "none.xml")) for make in makes]
        assert assert_same_outcome(calls, constructor) is not None


def test_the_model_parsed_last_is_written_as_the_same_xml(tmp_path: Path) -> None:
    written = []
    for package in BOTH:
        wrapper, path = package("mujoco.wrapper"), tmp_path / f"{len(written)}.xml"
        first, last = (wrapper.MjModel.from_xml_string(models.ZOO) for _ in range(2))
        with pytest.raises(ValueError, match="XML"):
            wrapper.save_last_parsed_model_to_xml(str(path), check_model=first)
        last.body_mass[1] = 4.25
        wrapper.save_last_parsed_model_to_xml(str(path), check_model=last)
        written.append(path.read_text())
    assert_same_pair(written, "XML")
    assert "4.25" in written[0]


def test_a_model_written_as_bytes_or_a_file_is_the_same(tmp_path: Path) -> None:
    twin = twins.load_physics()
    paths = [tmp_path / "ours.mjb", tmp_path / "theirs.mjb"]
    for physics, path in zip(twin.both, paths, strict=True):
        physics.model.save_binary(str(path))
    assert_same_pair([path.read_bytes() for path in paths], "binary file")
    assert_same_pair([physics.model.to_bytes() for physics in twin.both], "bytes")
