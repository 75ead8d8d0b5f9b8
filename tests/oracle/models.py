"""Small, unusual MJCF models with features that the suite's models lack."""

__all__ = ["BY_NAME", "ODD_JOINTS", "PENDULUM", "ZOO"]

# A bit of everything: each joint type, activations, mocap bodies, keyframes, both kinds of tendon,
# user data, elements without names, contacts at the start.
ZOO = """
<mujoco model="zoo">
  <option timestep="0.005"/>
  <size nuser_body="1" nuser_geom="2"/>
  <custom>
    <numeric name="one" data="1"/>
    <numeric name="three_numbers" data="1 2 3"/>
    <numeric name="two_numbers" data="4 5"/>
    <text name="greeting" data="hello"/>
    <tuple name="pair_of_things"><element objtype="body" objname="box"/></tuple>
  </custom>
  <asset>
    <texture name="checks" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 1 0"
             width="16" height="16"/>
    <material name="checked" texture="checks"/>
    <material name="plain" rgba=".1 .2 .3 .4"/>
    <mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1"/>
    <hfield name="hills" nrow="3" ncol="3" size=".5 .5 .1 .1"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0 0 3"/>
    <camera name="fixed" pos="0 -3 1" xyaxes="1 0 0 0 .3 1"/>
    <camera pos="0 3 1" xyaxes="-1 0 0 0 -.3 1"/>
    <geom name="floor" type="plane" size="2 2 .1" material="checked"/>
    <geom type="box" size=".05 .05 .05" pos="1 1 .05"/>
    <geom name="hilly" type="hfield" hfield="hills" pos="-1.4 -1.4 0"/>
    <site name="origin" pos="0 0 .3"/>
    <body name="box" pos="0 0 .099" user="7">
      <freejoint name="box_root"/>
      <geom name="box" type="box" size=".1 .1 .1" user="8 9" material="plain"/>
      <site name="box_top" pos="0 0 .1"/>
    </body>
    <body name="pendulum" pos="1 0 1">
      <joint name="swivel" type="ball"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/>
      <body name="hand" pos="0 0 -.35">
        <joint name="wrist" type="hinge" axis="0 1 0" limited="true" range="-90 90"/>
        <geom name="palm" type="mesh" mesh="wedge"/>
        <site name="grip"/>
      </body>
    </body>
    <body name="cart" pos="-1 0 .5">
      <joint name="rail" type="slide" axis="1 0 0" limited="true" range="-1 1" damping="1"/>
      <geom name="cart" size=".1"/>
      <site name="cart"/>
      <body pos="0 0 .2">
        <joint type="hinge" axis="0 1 0"/>
        <geom size=".05"/>
      </body>
    </body>
    <body name="ghost" mocap="true" pos="0 1 1">
      <geom size=".03" contype="0" conaffinity="0"/>
    </body>
    <body name="shade" mocap="true" pos="0 -1 1">
      <geom size=".03" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <contact>
    <exclude name="apart" body1="cart" body2="pendulum"/>
    <pair name="together" geom1="box" geom2="cart"/>
  </contact>
  <tendon>
    <fixed name="coupled"><joint joint="wrist" coef="1"/><joint joint="rail" coef="-2"/></fixed>
    <spatial name="string"><site site="grip"/><site site="cart"/></spatial>
  </tendon>
  <equality>
    <weld name="leash" body1="cart" body2="ghost" active="false"/>
    <joint name="gear" joint1="wrist" joint2="rail" active="false"/>
  </equality>
  <actuator>
    <motor name="push" joint="rail" ctrllimited="true" ctrlrange="-1 2"/>
    <general name="slow" joint="wrist" dyntype="filter" dynprm=".1"/>
    <motor name="free_push" joint="rail" ctrllimited="false"/>
    <cylinder name="piston" joint="rail" timeconst=".2"/>
    <motor joint="wrist"/>
  </actuator>
  <sensor>
    <framepos name="grip_position" objtype="site" objname="grip"/>
    <touch name="touch" site="box_top"/>
    <accelerometer name="acceleration" site="grip"/>
    <jointvel joint="rail"/>
    <framequat name="attitude" objtype="body" objname="box"/>
    <subtreelinvel name="flow" body="pendulum"/>
  </sensor>
  <keyframe>
    <key name="aloft" qpos="0 0 2 1 0 0 0  1 0 0 0 .5 .1 .2" ctrl="1 .5 0 .1 .2" act=".3 .4"/>
    <key name="asleep" time="3"/>
  </keyframe>
</mujoco>
"""

# Fourth-order Runge-Kutta: Physics.step takes another path for it.
_RUNGE_KUTTA = ZOO.replace('timestep="0.005"', 'timestep="0.005" integrator="RK4"')

PENDULUM = """
<mujoco model="pendulum">
  <asset>
    <material name="self" rgba=".7 .5 .3 1"/>
    <material name="self_default" rgba=".7 .5 .3 1"/>
    <material name="self_highlight" rgba="0 .5 .3 1"/>
    <material name="effector" rgba=".7 .4 .2 1"/>
    <material name="effector_default" rgba=".7 .4 .2 1"/>
    <material name="effector_highlight" rgba="0 .5 .3 1"/>
    <material name="target" rgba=".6 .3 .3 1"/>
    <material name="target_default" rgba=".6 .3 .3 1"/>
    <material name="target_highlight" rgba="0 .7 .4 1"/>
  </asset>
  <worldbody>
    <body name="pole" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping=".1"/>
      <geom name="mass" pos="0 0 -.5" size=".05" mass="1"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="torque" joint="hinge" gear="3" ctrlrange="-1 1" ctrllimited="true"/>
  </actuator>
  <sensor><jointvel name="speed" joint="hinge"/></sensor>
</mujoco>
"""

BY_NAME = {"zoo": ZOO, "Runge-Kutta": _RUNGE_KUTTA, "pendulum": PENDULUM}

# All cases of `randomizers`: each joint type, limited and not, and several joints in one body.
ODD_JOINTS = {
    "each type, limited and not": """
<mujoco>
  <default><joint armature="1"/></default>
  <worldbody>
    <body><freejoint name="free"/><geom size=".1"/>
      <body><joint name="limited_ball" type="ball" limited="true" range="0 60"/><geom size=".1"/>
        <body><joint name="ball" type="ball"/><geom size=".1"/></body>
      </body>
    </body>
    <body pos="1 0 0">
      <joint name="slide" type="slide"/>
      <joint name="limited_slide" type="slide" axis="0 1 0" limited="true" range="-3 5"/>
      <joint name="hinge" type="hinge" axis="1 0 0"/>
      <joint name="limited_hinge" type="hinge" limited="true" range="-10 350"/>
      <geom size=".1"/>
    </body>
    <body pos="2 0 0"><freejoint name="second_free"/><geom size=".1"/></body>
  </worldbody>
</mujoco>
""",
    "a range of no width": """
<mujoco>
  <worldbody>
    <body><joint name="stuck" limited="true" range="-0.0001 0.0001"/><geom size=".1"/>
      <body><joint name="after" type="ball"/><geom size=".1"/></body>
    </body>
  </worldbody>
</mujoco>
""",
    "no joint at all": "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>",
}
