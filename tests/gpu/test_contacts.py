"""Contacts on a device are those of the CPU."""

from typing import Any

import numpy as np
import pytest

from limberjack import mujoco
from limberjack.gpu.sizes import Sizes

from .on_device import torch

pytestmark = pytest.mark.gpu
warp_simulation: Any = pytest.importorskip("limberjack.gpu.warp_simulation")

_MODEL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1" {plane}/>
    <body pos="0 0 {height}" euler="{euler}">
      <freejoint/>
      <geom type="capsule" size=".05" fromto="0 0 -.25 0 0 .25"/>
    </body>
  </worldbody>
</mujoco>
"""


_BALL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="3 4 {height}">
      <freejoint/>
      <geom size=".1"/>
    </body>
  </worldbody>
</mujoco>
"""


def _forward(physics: mujoco.Physics) -> Any:
    """A simulation of two rows on the device, in the state in which the model begins."""
    sizes = Sizes(nconmax=8, njmax=32)
    made = warp_simulation.WarpSimulation(physics.model, 2, "cpu", (), sizes, uses_graphs=False)
    with made.scope():
        made.first_half()
    return made


@pytest.mark.parametrize(
    ("euler", "height"), [("0 5 0", 0.29), ("20 0 10", 0.28), ("0 -29 30", 0.26), ("60 0 0", 0.16)]
)
@pytest.mark.parametrize("plane", ["", 'euler="0 3 0"'])
def test_the_first_tangent_points_along_the_capsule(euler: str, height: float, plane: str) -> None:
    xml = _MODEL.format(euler=euler, height=height, plane=plane)
    physics = mujoco.Physics.from_xml_string(xml)
    physics.forward()
    made = _forward(physics)
    contact = made._data.contact
    (expected,) = physics.data._data.contact.frame
    for row in range(2):
        found = contact.frame.numpy()[contact.worldid.numpy() == row][0]
        np.testing.assert_allclose(found.ravel(), expected, atol=1e-5)  # float32
    assert torch is not None


@pytest.mark.parametrize(("depth", "presses"), [(-1e-3, False), (2e-7, False), (2e-6, True)])
def test_geoms_touch_if_they_are_deeper_than_float32_rounds(depth: float, presses: bool) -> None:
    physics = mujoco.Physics.from_xml_string(_BALL.format(height=0.1 - depth))
    made = _forward(physics)
    assert (made._data.nefc.numpy() > 0).tolist() == [presses, presses]
