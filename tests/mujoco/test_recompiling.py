"""Compiling a model again with changes of its MJCF."""

from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco as official
import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.mujoco.recompiling import Recompiler

_MJCF = """
<mujoco>
  <asset><texture name="sky" type="skybox" builtin="flat" width="300" height="300"/></asset>
  <worldbody>
    <body name="arm">
      <joint axis="0 1 0"/>
      <geom name="arm" type="capsule" size=".1" fromto="0 0 0 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""


def _longer(root: Element) -> None:
    next(root.iter("geom")).set("fromto", "0 0 0 0 0 1.5")


def _red(root: Element) -> None:
    next(root.iter("texture")).set("rgb1", "1 0 0")


def _joined(root: Element) -> None:
    body = next(root.iter("body"))
    body.append(Element("geom", size=".1"))


def test_the_fields_of_a_change_are_those_of_a_file_with_the_change() -> None:
    recompiler = Recompiler(_MJCF, {})
    names = recompiler.names([_longer])
    assert {"geom_size", "body_mass", "body_inertia", "geom_rbound", "dof_invweight0"} < {*names}
    expected = official.MjModel.from_xml_string(_MJCF.replace('0 0 1"', '0 0 1.5"'))
    for name, values in recompiler.fields(_longer, names).items():
        np.testing.assert_array_equal(values, getattr(expected, name), name)


def test_the_model_that_was_compiled_before_can_still_be_saved_as_xml(tmp_path: Path) -> None:
    model = mujoco.wrapper.MjModel.from_xml_string(_MJCF)
    Recompiler(_MJCF, {}).names([_longer])
    mujoco.wrapper.save_last_parsed_model_to_xml(str(tmp_path / "model.xml"), model)
    saved = official.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    np.testing.assert_array_equal(saved.geom_size, model.geom_size)


def test_a_change_of_other_fields_than_those_named_is_refused() -> None:
    with pytest.raises(ValueError, match=r"sets .*body_mass.*, unlike others"):
        Recompiler(_MJCF, {}).fields(_longer, ("geom_size",))


@pytest.mark.parametrize(("edit", "field"), [(_joined, "bvh_aabb"), (_red, "tex_data")])
def test_a_change_that_the_rows_of_a_batch_share_is_refused(
    edit: Callable[[Element], None], field: str
) -> None:
    with pytest.raises(
        ValueError, match=f"changes {field}, which must be the same in all episodes"
    ):
        Recompiler(_MJCF, {}).names([edit])


def test_a_model_of_unknown_origin_cannot_be_compiled_again() -> None:
    physics = suite.load("walker", "walk").physics
    assert physics.recompiler().names([]) == ()
    physics.model.geom_friction[0] = 2.0
    with pytest.raises(ValueError, match="cannot be compiled again"):
        physics.recompiler()
    with pytest.raises(ValueError, match="make the physics with from_shared_xml"):
        mujoco.Physics.from_xml_string(_MJCF).recompiler()
