# type: ignore  (dm_control has no types, and may not be installed)
"""Tasks added to the suite's domains, in the ways in which published task files add them.

They subclass a domain's task or its physics, import its private constants, read model files with
`resources` and `lxml`, and register with `SUITE.add`. They are written for single simulations;
`test_custom_tasks.py` lists which of them work in a batch as they stand.
"""

import collections
import json
import os
import tempfile

import numpy as np
from dm_control import mujoco, suite
from dm_control.mujoco.wrapper import mjbindings
from dm_control.rl import control
from dm_control.suite import (
    ball_in_cup,
    base,
    cheetah,
    common,
    fish,
    hopper,
    pendulum,
    point_mass,
    reacher,
    walker,
)
from dm_control.suite.utils import randomizers
from dm_control.utils import containers, rewards, xml_tools
from dm_control.utils import io as resources
from dm_env import specs
from lxml import etree

enums = mjbindings.enums

_TIPTOE_HEIGHT = 1.1
_REAR_HEIGHT = 0.9
_TUMBLE_MOMENTUM = 4
_WHIRL_SPEED = 3.0
_FOLDER = tempfile.mkdtemp()


def _from_file(domain, name):
    """The text of a domain's model, by way of a file outside the package, and its assets."""
    path = os.path.join(_FOLDER, name)
    with open(path, "wb") as file:
        file.write(domain.get_model_and_assets()[0])
    return resources.GetResource(path), common.ASSETS


# Subclasses of a domain's task, with the domain's physics.


@walker.SUITE.add("custom")
def tiptoe(time_limit=walker._DEFAULT_TIME_LIMIT, random=None, environment_kwargs=None):
    physics = walker.Physics.from_xml_string(*_from_file(walker, "walker.xml"))
    return control.Environment(
        physics,
        GoalWalker(goal="tiptoe", random=random),
        time_limit=time_limit,
        control_timestep=walker._CONTROL_TIMESTEP,
        **(environment_kwargs or {}),
    )


@walker.SUITE.add("custom")
def back_up(time_limit=walker._DEFAULT_TIME_LIMIT, random=None, environment_kwargs=None):
    physics = walker.Physics.from_xml_string(*_from_file(walker, "walker.xml"))
    return control.Environment(
        physics,
        GoalWalker(goal="move", move_speed=-walker._WALK_SPEED * 2, random=random),
        time_limit=time_limit,
        control_timestep=walker._CONTROL_TIMESTEP,
        **(environment_kwargs or {}),
    )


class GoalWalker(walker.PlanarWalker):
    def __init__(self, goal, move_speed=0, random=None):
        super().__init__(0, random)
        self._goal = goal
        self._move_speed = move_speed

    def _tiptoe_reward(self, physics):
        feet = [physics.named.data.xpos[foot, "z"] for foot in ("left_foot", "right_foot")]
        high = rewards.tolerance(
            physics.torso_height(), (_TIPTOE_HEIGHT, float("inf")), margin=walker._STAND_HEIGHT / 2
        )
        low = rewards.tolerance((feet[0] + feet[1]) / 2, (-float("inf"), 0.1), margin=0.5)
        return (2 * high + low + (1 + physics.torso_upright()) / 2) / 4

    def _move_reward(self, physics):
        forward = (self._move_speed, float("inf"))
        move = rewards.tolerance(
            physics.horizontal_velocity(),
            bounds=forward if self._move_speed > 0 else (-float("inf"), self._move_speed),
            margin=abs(self._move_speed) / 2,
            value_at_margin=0.5,
            sigmoid="linear",
        )
        return self._tiptoe_reward(physics) * (5 * move + 1) / 6

    def get_reward(self, physics):
        if self._goal == "tiptoe":
            return self._tiptoe_reward(physics)
        return self._move_reward(physics)


@hopper.SUITE.add("custom")
def hop_back(time_limit=hopper._DEFAULT_TIME_LIMIT, random=None, environment_kwargs=None):
    physics = hopper.Physics.from_xml_string(*hopper.get_model_and_assets())
    return control.Environment(
        physics,
        BackwardHopper(random=random),
        time_limit=time_limit,
        control_timestep=hopper._CONTROL_TIMESTEP,
        **(environment_kwargs or {}),
    )


class BackwardHopper(hopper.Hopper):
    def __init__(self, random=None):
        super().__init__(None, random)

    def get_reward(self, physics):
        standing = rewards.tolerance(physics.height(), (hopper._STAND_HEIGHT / 4, 2), margin=0.5)
        return standing * rewards.tolerance(
            physics.speed(), (-float("inf"), -hopper._HOP_SPEED / 2), margin=1
        )


@pendulum.SUITE.add("custom")
def whirl(time_limit=20, random=None, environment_kwargs=None):
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    return control.Environment(
        physics, Whirl(random=random), time_limit=time_limit, **(environment_kwargs or {})
    )


class Whirl(pendulum.SwingUp):
    def get_reward(self, physics):
        return rewards.tolerance(
            np.linalg.norm(physics.angular_velocity()),
            bounds=(_WHIRL_SPEED, float("inf")),
            margin=_WHIRL_SPEED / 2,
            value_at_margin=0.5,
            sigmoid="linear",
        )


# Subclasses of a domain's physics, or a physics of their own beside a domain's task.


@cheetah.SUITE.add("custom")
def rear(time_limit=cheetah._DEFAULT_TIME_LIMIT, random=None, environment_kwargs=None):
    return _cheetah("rear", time_limit, random, environment_kwargs)


@cheetah.SUITE.add("custom")
def tumble(time_limit=cheetah._DEFAULT_TIME_LIMIT, random=None, environment_kwargs=None):
    return _cheetah("tumble", time_limit, random, environment_kwargs)


def _cheetah(goal, time_limit, random, environment_kwargs):
    physics = CheetahPhysics.from_xml_string(*cheetah.get_model_and_assets())
    task = GoalCheetah(goal, cheetah._RUN_SPEED * 0.5, random)
    return control.Environment(physics, task, time_limit=time_limit, **(environment_kwargs or {}))


class CheetahPhysics(cheetah.Physics):
    def momentum(self):
        return self.named.data.subtree_angmom["torso"][1]


class GoalCheetah(cheetah.Cheetah):
    def __init__(self, goal, move_speed, random=None):
        super().__init__(random)
        self._goal = goal
        self._move_speed = move_speed

    def get_reward(self, physics):
        speed = rewards.tolerance(
            physics.speed(), (-self._move_speed, self._move_speed), margin=1, sigmoid="linear"
        )
        if self._goal == "rear":
            heights = [physics.named.data.xpos[name, "z"] for name in ("torso", "ffoot")]
            high = rewards.tolerance(sum(heights) / 2, (_REAR_HEIGHT, float("inf")), margin=0.5)
            return (3 * high + speed) / 4
        turn = rewards.tolerance(
            -physics.momentum(), (_TUMBLE_MOMENTUM, float("inf")), margin=_TUMBLE_MOMENTUM
        )
        return (2 * turn + speed) / 3


_THREE_LINKS = """
<mujoco model="three links">
  <include file="./common/visual.xml"/>
  <include file="./common/skybox.xml"/>
  <include file="./common/materials.xml"/>
  <option timestep="0.02"><flag contact="disable"/></option>
  <default>
    <joint type="hinge" axis="0 0 1" damping="0.01"/>
    <geom type="capsule" size="0.01" material="self"/>
    <motor gear="0.05" ctrllimited="true" ctrlrange="-1 1"/>
  </default>
  <worldbody>
    <light name="light" pos="0 0 1"/>
    <camera name="fixed" pos="0 0 0.75"/>
    <geom name="ground" type="plane" size="0.3 0.3 10" material="grid"/>
    <body name="upper" pos="0 0 0.01">
      <joint name="shoulder"/>
      <geom name="upper" fromto="0 0 0 0.09 0 0"/>
      <body name="lower" pos="0.09 0 0">
        <joint name="elbow" limited="true" range="-160 160"/>
        <geom name="lower" fromto="0 0 0 0.08 0 0"/>
        <body name="hand" pos="0.08 0 0">
          <joint name="wrist" limited="true" range="-160 160"/>
          <geom name="hand" fromto="0 0 0 0.06 0 0"/>
          <geom name="finger" type="sphere" pos="0.07 0 0" material="effector"/>
        </body>
      </body>
    </body>
    <geom name="target" type="sphere" pos="0 0 0.01" material="target"/>
  </worldbody>
  <actuator>
    <motor joint="shoulder"/>
    <motor joint="elbow"/>
    <motor joint="wrist"/>
  </actuator>
</mujoco>
"""


@reacher.SUITE.add("custom")
def three_links(time_limit=20, random=None, environment_kwargs=None):
    physics = LinksPhysics.from_xml_string(_THREE_LINKS, common.ASSETS)
    return control.Environment(
        physics, LinksReacher(0.015, random), time_limit=time_limit, **(environment_kwargs or {})
    )


class LinksPhysics(mujoco.Physics):
    def finger_to_target(self):
        positions = self.named.data.geom_xpos
        return positions["target", :2] - positions["finger", :2]

    def finger_to_target_dist(self):
        return np.linalg.norm(self.finger_to_target())


class LinksReacher(reacher.Reacher):
    def __init__(self, target_size, random=None):
        super().__init__(target_size, random)

    def get_observation(self, physics):
        return collections.OrderedDict(
            [("position", physics.position()), ("velocity", physics.velocity())]
        )


@ball_in_cup.SUITE.add("custom")
def sling(time_limit=20, random=None, environment_kwargs=None):
    physics = CupPhysics.from_xml_string(*ball_in_cup.get_model_and_assets())
    return control.Environment(
        physics,
        Sling(random=random),
        time_limit=time_limit,
        control_timestep=ball_in_cup._CONTROL_TIMESTEP,
        **(environment_kwargs or {}),
    )


class CupPhysics(mujoco.Physics):
    def ball_to_target(self):
        target = self.named.data.site_xpos["target", ["x", "z"]]
        return target - self.named.data.xpos["ball", ["x", "z"]]

    def in_target(self):
        room = self.named.model.site_size["target", [0, 2]] - self.named.model.geom_size["ball", 0]
        return float(all(abs(self.ball_to_target()) < room))


class Sling(ball_in_cup.BallInCup):
    def initialize_episode(self, physics):
        anywhere = self.random.uniform() < 0.9
        is_valid = False
        while not is_valid:
            physics.named.data.qpos["ball_x"] = self.random.uniform(-0.2, 0.2)
            physics.named.data.qpos["ball_z"] = self.random.uniform(0.2, 0.5)
            physics.after_reset()
            is_valid = physics.data.ncon == 0 and (anywhere or bool(physics.in_target()))
        base.Task.initialize_episode(self, physics)

    def get_reward(self, physics):
        velocities = [abs(physics.named.data.qvel[name]) for name in ("ball_x", "ball_z")]
        far = rewards.tolerance(np.linalg.norm(physics.ball_to_target()), (0.3, 1), margin=0.5)
        fast = rewards.tolerance(np.linalg.norm(velocities), (2.0, float("inf")), margin=1)
        return (1 - physics.in_target()) * (far + 2 * fast) / 3


@fish.SUITE.add("custom")
def walled(time_limit=40, random=None, environment_kwargs=None):
    tree = etree.XML(fish.get_model_and_assets()[0], etree.XMLParser(remove_blank_text=True))
    for number, place in enumerate(("0.3 0.25 0.2", "-0.3 0.25 0.2")):
        size = {"type": "box", "size": "0.02 0.2 0.2", "contype": "0", "conaffinity": "0"}
        etree.SubElement(tree.find("worldbody"), "geom", name=f"wall{number}", pos=place, **size)
    physics = fish.Physics.from_xml_string(etree.tostring(tree, pretty_print=True), common.ASSETS)
    return control.Environment(
        physics,
        Walled(random=random),
        control_timestep=fish._CONTROL_TIMESTEP,
        time_limit=time_limit,
        **(environment_kwargs or {}),
    )


class Walled(fish.Swim):
    def _near_wall(self, physics, name, distance):
        for wall in ("wall0", "wall1"):
            places = physics.named.data.geom_xpos
            if np.min(np.abs(places[name][:2] - places[wall][:2])) < distance:
                return True
        return False

    def initialize_episode(self, physics):
        is_near = True
        while is_near:
            quat = self.random.randn(4)
            physics.named.data.qpos["root"][3:7] = quat / np.linalg.norm(quat)
            for joint in fish._JOINTS:
                physics.named.data.qpos[joint] = self.random.uniform(-0.2, 0.2)
            physics.named.model.geom_pos["target", "x"] = self.random.uniform(-0.4, 0.4)
            physics.named.model.geom_pos["target", "y"] = self.random.uniform(-0.4, 0.4)
            physics.named.model.geom_pos["target", "z"] = self.random.uniform(0.1, 0.3)
            physics.after_reset()
            is_near = self._near_wall(physics, "target", 0.08)
        base.Task.initialize_episode(self, physics)

    def get_reward(self, physics):
        radii = physics.named.model.geom_size[["mouth", "target"], 0].sum()
        distance = np.linalg.norm(physics.mouth_to_target())
        close = rewards.tolerance(distance, bounds=(0, radii), margin=2 * radii)
        is_free = 1.0 - self._near_wall(physics, "torso", distance=0.01)
        return is_free * (7 * close + 0.5 * (physics.upright() + 1)) / 8


# Files that bring everything along: a SUITE and a `make` of their own, beside the suite's.

SUITE = containers.TaggedTasks()


def make(task, task_kwargs=None, environment_kwargs=None, visualize_reward=False):
    task_kwargs = dict(task_kwargs or {})
    if environment_kwargs is not None:
        task_kwargs["environment_kwargs"] = environment_kwargs
    env = SUITE[task](**task_kwargs)
    env.task.visualize_reward = visualize_reward
    return env


@SUITE.add("benchmarking")
def corner(time_limit=20, random=None, environment_kwargs=None):
    physics = PointPhysics.from_xml_string(*_from_file(point_mass, "point_mass.xml"))
    return control.Environment(
        physics, Corner(random=random), time_limit=time_limit, **(environment_kwargs or {})
    )


class PointPhysics(mujoco.Physics):
    def distance(self, target):
        return np.linalg.norm(target - self.named.data.geom_xpos["pointmass"])


class Corner(base.Task):
    def __init__(self, random=None):
        self._target = np.array([0.15, -0.15, 0.01])
        super().__init__(random=random)

    def initialize_episode(self, physics):
        randomizers.randomize_limited_and_rotational_joints(physics, self.random)
        physics.data.qpos[0] = np.random.uniform(-0.29, -0.15)
        physics.data.qpos[1] = np.random.uniform(0.15, 0.29)
        physics.named.data.geom_xpos["target"][:] = self._target
        super().initialize_episode(physics)

    def get_observation(self, physics):
        return collections.OrderedDict(
            [("position", physics.position()), ("velocity", physics.velocity())]
        )

    def get_reward_spec(self):
        return specs.Array(shape=(1,), dtype=np.float32, name="reward")

    def get_reward(self, physics):
        small = rewards.tolerance(physics.control(), margin=1, value_at_margin=0, sigmoid="linear")
        near = rewards.tolerance(physics.distance(self._target), (0, 0.015), margin=0.3)
        return near * (small.mean() + 4) / 5


@SUITE.add()
def many_goals(time_limit=25, random=None, environment_kwargs=None):
    text = common.read_model(os.path.join(_FOLDER, "walker.xml"))
    tree = etree.XML(text, etree.XMLParser(remove_blank_text=True))
    tree.find(".//geom[@name='floor']").attrib["size"] = f"{time_limit} {0.5} .5"
    camera = xml_tools.find_element(tree, "camera", "back")
    camera.getparent().remove(camera)
    physics = ManyPhysics.from_xml_string(etree.tostring(tree, pretty_print=True), common.ASSETS)
    return control.Environment(
        physics,
        ManyGoals(random=random),
        time_limit=time_limit,
        control_timestep=0.025,
        **(environment_kwargs or {}),
    )


class ManyPhysics(mujoco.Physics):
    def _reload_from_data(self, data):
        super()._reload_from_data(data)
        self._hinge_names = []
        self._sensor_names = {}

    def _sensors(self, *types):
        if types not in self._sensor_names:
            [ids] = np.where(np.isin(self.model.sensor_type, types))
            self._sensor_names[types] = [self.model.id2name(i, "sensor") for i in ids]
        return self._sensor_names[types]

    def com_velocity(self):
        return self.named.data.sensordata[self._sensors(enums.mjtSensor.mjSENS_SUBTREELINVEL)]

    def hinges(self):
        if not self._hinge_names:
            [ids] = np.nonzero(self.model.jnt_type == enums.mjtJoint.mjJNT_HINGE)
            self._hinge_names = [self.model.id2name(i, "joint") for i in ids]
        data = self.named.data
        return np.hstack((data.qpos[self._hinge_names], data.qvel[self._hinge_names]))

    def orientations(self):
        return self.named.data.xmat[1:, ["xx", "xz"]].ravel()


class ManyGoals(base.Task):
    def initialize_episode(self, physics):
        z_pos, num_contacts = 0.0, 1
        orientation = self.random.uniform(-0.5, 0.5)
        while num_contacts > 0:
            try:
                with physics.reset_context():
                    physics.named.data.qpos["rootz"] = z_pos
                    physics.named.data.qpos["rooty"] = orientation
            except control.PhysicsError:
                pass
            num_contacts = physics.data.ncon
            z_pos += 0.01
        super().initialize_episode(physics)

    def get_observation(self, physics):
        obs = collections.OrderedDict()
        obs["hinges"] = physics.hinges()
        obs["orientations"] = physics.orientations()
        obs["com_velocity"] = physics.com_velocity()
        return obs

    def get_reward_spec(self):
        return specs.Array(shape=(2,), dtype=np.float32, name="reward")

    def get_reward(self, physics):
        height = rewards.tolerance(physics.named.data.xpos["torso", "z"], (1, 2), margin=1)
        speed = rewards.tolerance(physics.com_velocity()[0], (1, float("inf")), margin=1)
        return np.array([height, height * speed]).astype(np.float32)


suite.ALL_TASKS = suite.ALL_TASKS + suite._get_tasks("custom")
suite.TASKS_BY_DOMAIN = suite._get_tasks_by_domain(suite.ALL_TASKS)
CUSTOM = suite._get_tasks("custom")


def load(domain, task, seed):
    """A task of this file; those with a SUITE of their own have no domain."""
    if domain is None:
        np.random.seed(seed)
        return make(task, task_kwargs={"random": seed})
    assert (domain, task) in suite.ALL_TASKS
    assert task in suite.TASKS_BY_DOMAIN[domain]
    return suite.load(domain, task, task_kwargs={"random": seed}, visualize_reward=False)


def main():
    for domain, task in [*CUSTOM, *((None, task) for task in SUITE)]:
        env = load(domain, task, seed=3)
        spec = env.action_spec()
        stream = np.random.RandomState(1)
        for _ in range(2):
            step = env.reset()
            for _ in range(12):
                step = env.step(stream.uniform(spec.minimum, spec.maximum))
                values = {key: np.asarray(v).tolist() for key, v in step.observation.items()}
                reward = np.asarray(step.reward).tolist()
                print(json.dumps({"task": task, "rewarded": reward, **values}))


if __name__ == "__main__":
    main()
