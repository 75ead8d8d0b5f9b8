"""A model with a rolling ball and a ball at rest."""

import mujoco
import pytest

from limberjack.mujoco import wrapper

XML = """
<mujoco model="balls">
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="ball" pos="0 0 .09">
      <freejoint name="free"/>
      <geom name="ball" size=".1" mass="2"/>
      <site name="top" pos="0 0 .1"/>
    </body>
    <body><geom size=".1" pos="3 0 3"/></body>
  </worldbody>
  <sensor><framepos name="ball" objtype="body" objname="ball"/></sensor>
</mujoco>
"""


@pytest.fixture
def model() -> wrapper.MjModel:
    return wrapper.MjModel.from_xml_string(XML)


@pytest.fixture
def data(model: wrapper.MjModel) -> wrapper.MjData:
    data = wrapper.MjData(model)
    mujoco.mj_forward(model.ptr, data.ptr)
    return data
