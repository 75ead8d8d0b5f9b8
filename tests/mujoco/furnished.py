"""A room with one example of everything that MuJoCo draws differently, for tests of pictures."""

from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco import Physics

__all__ = ["FURNISHED", "INFINITE", "KINDS", "SIZE", "add_box", "furnished"]

# Textures, sky, haze, fog, a mesh, a height
# field, a reflection, shadows, transparency, sites, tendons, a light that moves, three cameras. The
# floor is one square: an infinite one takes three quarters of the time of a picture.
FURNISHED = """
<mujoco>
  <visual>
    <global offheight="200" offwidth="300"/>
    <rgba fog=".2 .4 .6 1"/>
    <map fogstart="1" fogend="4"/>
    <quality shadowsize="512"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".4 .6 .8" rgb2="0 0 0"
        width="64" height="384"/>
    <texture name="grid" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .9"
        width="64" height="64" mark="edge" markrgb="1 0 0"/>
    <material name="floor" texture="grid" texrepeat="2 2" reflectance=".4"/>
    <material name="glass" rgba=".9 .3 .3 .4"/>
    <mesh name="tent" vertex="0 0 .4  .3 0 0  -.3 0 0  0 .3 0  0 -.3 0"/>
    <hfield name="hill" nrow="3" ncol="3" size=".4 .4 .3 .1" elevation="0 0 0 0 1 0 0 0 0"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0 0 3" dir="0 0 -1" diffuse=".8 .8 .8"/>
    <geom name="floor" type="plane" size="5 5 5" material="floor"/>
    <geom name="tent" type="mesh" mesh="tent" pos="-.6 .2 0" rgba=".2 .7 .2 1"/>
    <geom name="hill" type="hfield" hfield="hill" pos=".8 .6 .1" rgba=".5 .4 .2 1"/>
    <body name="arm" pos="0 0 .8">
      <joint name="hinge" axis="0 1 0"/>
      <geom name="arm" type="capsule" fromto="0 0 0 .4 0 0" size=".06" rgba=".8 .5 .1 1"/>
      <geom name="bulb" type="sphere" size=".15" pos=".5 0 0" material="glass"/>
      <site name="tip" pos=".7 0 0" size=".05" rgba="0 0 1 1"/>
      <light name="torch" pos=".4 0 .1" dir="0 0 -1" mode="track"/>
      <camera name="hand" pos=".2 -.6 .1" xyaxes="1 0 0 0 .3 1"/>
    </body>
    <site name="anchor" pos="0 .3 1.2" size=".03"/>
    <camera name="wall" pos="0 -3 1.2" xyaxes="1 0 0 0 .3 1" fovy="50"/>
    <camera name="ceiling" pos=".1 0 4"/>
  </worldbody>
  <tendon>
    <spatial name="string"><site site="anchor"/><site site="tip"/></spatial>
  </tendon>
</mujoco>
"""
INFINITE = FURNISHED.replace('type="plane" size="5 5 5"', 'type="plane" size="0 0 .1"')
# Any: keyword arguments of several types.
SIZE: dict[str, Any] = {"height": 96, "width": 128}
KINDS: dict[str, dict[str, Any]] = {
    "colours": {},
    "depth": {"depth": True},
    "segmentation": {"segmentation": True},
}


def furnished(package: Any = None, xml: str = FURNISHED) -> Any:
    """The furnished room in mid-motion, by our Physics or another package's."""
    physics = (package.Physics if package else Physics).from_xml_string(xml)
    physics.step(20)
    return physics


def add_box(physics: Any, scene: Any) -> None:
    """Puts a red box into the scene, and changes a flag."""
    scene.ngeom += 1
    mujoco.mjv_initGeom(
        scene.geoms[scene.ngeom - 1],
        mujoco.mjtGeom.mjGEOM_BOX.value,
        size=np.full(3, 0.2),
        pos=np.array([0.0, 0.0, 1.0]),
        mat=np.eye(3).flatten(),
        rgba=np.array([1, 0, 0, 1], np.float32),
    )
    box = scene.geoms[scene.ngeom - 1]
    box.segid, box.objid, box.objtype = scene.ngeom - 1, 7, mujoco.mjtObj.mjOBJ_UNKNOWN.value
    scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
