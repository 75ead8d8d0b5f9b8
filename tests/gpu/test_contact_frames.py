"""The frames of contacts between capsules and planes are those of the CPU."""

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


@pytest.mark.parametrize(
    ("euler", "height"), [("0 5 0", 0.29), ("20 0 10", 0.28), ("0 -29 30", 0.26), ("60 0 0", 0.16)]
)
@pytest.mark.parametrize("plane", ["", 'euler="0 3 0"'])
def test_the_first_tangent_points_along_the_capsule(euler: str, height: float, plane: str) -> None:
    xml = _MODEL.format(euler=euler, height=height, plane=plane)
    physics = mujoco.Physics.from_xml_string(xml)
    physics.forward()
    made = warp_simulation.WarpSimulation(
        physics.model, 2, "cpu", (), Sizes(nconmax=8, njmax=32), uses_graphs=False
    )
    with made.scope():
        made.first_half()
    contact = made._data.contact
    (expected,) = physics.data._data.contact.frame
    for row in range(2):
        found = contact.frame.numpy()[contact.worldid.numpy() == row][0]
        np.testing.assert_allclose(found.ravel(), expected, atol=1e-5)  # float32
    assert torch is not None
