"""Dog: stand, walk, trot, run or fetch a ball, with 38 muscles for 73 hinges.

An episode begins in the default pose, moving and turning, with random activations. The reward is
a product of factors for posture, weight on the paws, and speed or the ball. The tasks come from
the DeepMind Control Suite (https://arxiv.org/abs/2006.12983); the model has no bones and no skin.
"""

import collections
from xml.etree import ElementTree

import numpy as np

from limberjack import mujoco
from limberjack.mujoco.wrapper.mjbindings import enums
from limberjack.rl import control
from limberjack.suite import base, common
from limberjack.suite.base import Kwargs, Seed
from limberjack.utils import arrays, containers, rewards, xml_tools
from limberjack.utils.arrays import Quantity

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Fetch",
    "Move",
    "Physics",
    "Stand",
    "fetch",
    "get_model_and_assets",
    "make_model",
    "run",
    "stand",
    "trot",
    "walk",
]

_DEFAULT_TIME_LIMIT = 15  # seconds
_CONTROL_TIMESTEP = 0.015  # seconds
_MAX_UPRIGHT_ANGLE = 30  # degrees; tilt up to which a part of the body counts as upright
_MIN_UPRIGHT_COSINE = np.cos(np.deg2rad(_MAX_UPRIGHT_ANGLE))
_STAND_HEIGHT_FRACTION = 0.9  # of the heights in the default pose, from which the dog stands
_WALK_SPEED, _TROT_SPEED, _RUN_SPEED = 1, 3, 9  # m/s; forward speeds that are fully rewarded
_START_SPEED = 2  # m/s and rad/s; standard deviation of a start's velocities
_THROW_FROM = 0.75  # of the floor's half length; the ball's distance from the centre at the start
_THROW_NOISE = 0.05  # standard deviation of the direction in which the ball is thrown
_BITE_MARGIN = 2  # metres; distance from the mouth at which closeness to the ball is 0.1
_HINGE_TYPE = enums.mjtJoint.mjJNT_HINGE
# dm_control's module has these two, and does not use them either.
_LIMIT_TYPE, _EXCESSIVE_LIMIT_TORQUES = enums.mjtConstraint.mjCNSTR_LIMIT_JOINT, 150

_FRAMES = ["skull", "torso", "pelvis"]
_TURNS = ("twist",), ("extend", "bend")  # hinges of even and odd vertebrae of the lower back
_FOR_FETCH = {  # elements of the model, by tag
    "body": ["ball"],
    "camera": ["ball", "head"],
    "geom": ["target", "wall_px", "wall_nx", "wall_py", "wall_ny"],
}

SUITE = containers.TaggedTasks()
# Chosen by eye: the dog is seen from its side.
_SEEDS = {"stand": 14, "walk": 9, "trot": 6, "run": 3, "fetch": 4}
PICTURES = {task: base.Picture("y-axis", seed=seed, steps=4) for task, seed in _SEEDS.items()}
OBSERVATIONS = {
    "joint_angles": base.Observed("angles of the hinges, in the order of the joints", "rad"),
    "joint_velocites": base.Observed("velocities of the hinges; the name is dm_control's", "rad/s"),
    "torso_pelvis_height": base.Observed("heights of torso and pelvis", "m"),
    "z_projection": base.Observed("the world's vertical seen from skull, torso and pelvis"),
    "torso_com_velocity": base.Observed("centre of mass's velocity seen from the torso", "m/s"),
    "inertial_sensors": base.Observed("accelerometer, velocimeter, gyro", "m/s²; m/s; rad/s"),
    "foot_forces": base.Observed("forces on left and right hind paws, then forepaws", "N"),
    "touch_sensors": base.Observed("pressure below left and right forepaws, then hind paws", "N"),
    "actuator_state": base.Observed("activations of the muscles"),
    "ball_state": base.Observed("position and velocity of the ball seen from the head", "m; m/s"),
    "target_position": base.Observed("position of the target seen from the head", "m"),
}


def make_model(floor_size: float, remove_ball: bool) -> bytes:
    """The MJCF with a floor of that half length, metres; fetch needs ball, target and walls."""
    root = ElementTree.fromstring(common.read_model("dog.xml"))
    xml_tools.find_element(root, "geom", "floor").set("size", f"{floor_size} {floor_size} .1")
    for tag, names in _FOR_FETCH.items() if remove_ball else ():
        for name in names:
            xml_tools.remove_element(root, xml_tools.find_element(root, tag, name))
    return ElementTree.tostring(root)


def get_model_and_assets(
    floor_size: float = 10, remove_ball: bool = True
) -> tuple[bytes, dict[str, bytes]]:
    """The MJCF of `make_model` and the files that it includes."""
    return make_model(floor_size, remove_ball), common.ASSETS


@SUITE.add("no_reward_visualization")
def stand(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Stand upright on all paws."""
    return _environment(Stand(random), _WALK_SPEED, time_limit, environment_kwargs)


@SUITE.add("no_reward_visualization")
def walk(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Walk forward at 1 to 2 m/s."""
    return _environment(Move(_WALK_SPEED, random), _WALK_SPEED, time_limit, environment_kwargs)


@SUITE.add("no_reward_visualization")
def trot(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Trot forward at 3 to 6 m/s."""
    return _environment(Move(_TROT_SPEED, random), _TROT_SPEED, time_limit, environment_kwargs)


@SUITE.add("no_reward_visualization")
def run(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Run forward at 9 to 18 m/s."""
    return _environment(Move(_RUN_SPEED, random), _RUN_SPEED, time_limit, environment_kwargs)


@SUITE.add("no_reward_visualization", "hard")
def fetch(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Take a thrown ball into the mouth and bring it to the target."""
    return _environment(Fetch(random), None, time_limit, environment_kwargs)


def _environment(
    task: "Stand", speed: float | None, time_limit: float, kwargs: Kwargs
) -> control.Environment:
    """The task, on a floor as long as `speed` covers in an episode; of fetch without a speed."""
    size = {} if speed is None else {"floor_size": speed * _DEFAULT_TIME_LIMIT}
    model = get_model_and_assets(**size, remove_ball=speed is not None)
    physics = Physics.from_shared_xml(*model)
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the dog and the ball; a velocity or position seen from X is in X's frame."""

    def torso_pelvis_height(self) -> np.ndarray:
        """Heights of torso and pelvis, (..., 2), metres."""
        return self.named.data.xpos[["torso", "pelvis"], "z"]

    def default_heights(self) -> tuple[Quantity, Quantity]:
        """Heights of torso and pelvis in the default pose, (...) each, metres."""
        model = self.named.model
        torso = height = model.qpos0["root"][..., 2][()]
        for number in range(1, 8):  # from torso to pelvis; no vertebra is turned
            height = height + model.body_pos[f"L_{number}", "z"]
            for turn in _TURNS[number % 2]:
                # As MuJoCo: to the hinge and back, which leaves a rounding error.
                to_hinge = model.jnt_pos[f"L_{number}_{turn}", "z"]
                height = height + to_hinge - to_hinge
        return torso, height + model.body_pos["pelvis", "z"]

    def body_weight(self) -> Quantity:
        """Weight of the dog, (...), newtons."""
        return -self.model.opt.gravity[..., 2] * self.named.model.body_subtreemass["torso"]

    def z_projection(self) -> np.ndarray:
        """The world's vertical seen from skull, torso and pelvis, (..., 3, 3)."""
        return self.named.data.xmat[_FRAMES][..., 6:]

    def upright(self) -> np.ndarray:
        """Cosines of the tilts of skull, torso and pelvis, (..., 3)."""
        return self.z_projection()[..., 2]

    def center_of_mass_velocity(self) -> np.ndarray:
        """Velocity of the dog's centre of mass in the world, (..., 3), metres per second."""
        return self.named.data.sensordata["torso_linvel"].copy()

    def torso_com_velocity(self) -> np.ndarray:
        """The same velocity seen from the torso, (..., 3)."""
        return arrays.to_frame(self.center_of_mass_velocity(), self.named.data.xmat["torso"])

    def com_forward_velocity(self) -> Quantity:
        """Its forward component, (...)."""
        return self.torso_com_velocity()[..., 0][()]  # a number, not an array, for one simulation

    def joint_angles(self) -> np.ndarray:
        """Angles of the hinges, (..., 73), radians."""
        hinges = self.model.jnt_type == _HINGE_TYPE
        return self.data.qpos[..., self.model.jnt_qposadr[hinges]]

    def joint_velocities(self) -> np.ndarray:
        """Velocities of the hinges, (..., 73), radians per second."""
        hinges = self.model.jnt_type == _HINGE_TYPE
        return self.data.qvel[..., self.model.jnt_dofadr[hinges]]

    def inertial_sensors(self) -> np.ndarray:
        """Acceleration, velocity and angular velocity of the head in its frame, (..., 9)."""
        return self.named.data.sensordata[["accelerometer", "velocimeter", "gyro"]]

    def touch_sensors(self) -> np.ndarray:
        """Pressures below left and right forepaws, then hind paws, (..., 4), newtons."""
        return self.named.data.sensordata[["palm_L", "palm_R", "sole_L", "sole_R"]]

    def foot_forces(self) -> np.ndarray:
        """Forces on left and right hind paws, then forepaws, (..., 12), newtons."""
        return self.named.data.sensordata[["foot_L", "foot_R", "hand_L", "hand_R"]]

    def ball_in_head_frame(self) -> np.ndarray:
        """Relative position and velocity of the ball seen from the head, (..., 6)."""
        ball = self.data.object_velocity("ball", "geom")
        velocity = (ball - self.data.object_velocity("head", "site"))[..., 0, :]
        turned = arrays.to_frame(velocity, self.named.data.site_xmat["head"])
        return arrays.concat((self._seen_from_head("ball"), turned))

    def target_in_head_frame(self) -> np.ndarray:
        """Relative position of the target seen from the head, (..., 3), metres."""
        return self._seen_from_head("target")

    def _seen_from_head(self, geom: str) -> np.ndarray:
        data = self.named.data
        vector = data.geom_xpos[geom] - data.site_xpos["head"]
        return arrays.to_frame(vector, data.site_xmat["head"])

    def ball_to_mouth_distance(self) -> Quantity:
        """Mean distance of the ball from upper and lower jaw, (...), metres."""
        ball, jaws = self.named.data.geom_xpos["ball"], self.named.data.site_xpos
        upper, lower = (arrays.norm(ball - jaws[f"{jaw}_bite"]) for jaw in ("upper", "lower"))
        return 0.5 * (upper + lower)

    def ball_to_target_distance(self) -> Quantity:
        """Distance of the ball from the target, (...), metres."""
        positions = self.named.data.geom_xpos
        return arrays.norm(positions["ball"] - positions["target"])


class Stand(base.Task[Physics]):
    """Stand upright on all paws.

    Attributes:
      FACTORS: names of the reward's factors, in the order of `get_reward_factors`.
    """

    GOAL = ("torso_height", "pelvis_height", "skull_upright", "torso_upright", "pelvis_upright")
    planner_cost = "limberjack.planner.single_stage.standing:Dog"
    FACTORS: tuple[str, ...] = (*GOAL, "touch")  # the last is never below 0.9

    def __init__(self, random: Seed = None, observe_reward_factors: bool = False) -> None:
        """Creates the task, with the factors of the reward as an observation if that is asked."""
        self._observe_reward_factors = observe_reward_factors
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws direction, velocities and activations; does not colour the start, as dm_control."""
        physics.reset()
        azimuth = self.random.uniform(0, 2 * np.pi)
        physics.named.data.qpos["root"][3:] = np.cos(azimuth / 2), 0, 0, np.sin(azimuth / 2)
        for axis in (0, 1, 5):  # along x and y, and about z
            physics.data.qvel[axis] = _START_SPEED * self.random.randn()
        physics.data.act[:] = self.random.uniform(*physics.model.actuator_ctrlrange.T)

    def get_observation_components(self, physics: Physics) -> collections.OrderedDict:
        """Joints, posture and sensors."""
        projection = physics.z_projection()
        return collections.OrderedDict(
            joint_angles=physics.joint_angles(),
            joint_velocites=physics.joint_velocities(),
            torso_pelvis_height=physics.torso_pelvis_height(),
            z_projection=projection.reshape(*projection.shape[:-2], -1),
            torso_com_velocity=physics.torso_com_velocity(),
            inertial_sensors=physics.inertial_sensors(),
            foot_forces=physics.foot_forces(),
            touch_sensors=physics.touch_sensors(),
            actuator_state=physics.activation(),
        )

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """The components, and the factors of the reward if they are observed."""
        obs = self.get_observation_components(physics)
        if self._observe_reward_factors:
            obs["reward_factors"] = self.get_reward_factors(physics)
        return obs

    def get_reward_factors(self, physics: Physics) -> np.ndarray:
        """Factors of the reward, (..., k), between 0 and 1; subclasses append their own."""
        heights, weight = physics.named.data.xpos, physics.body_weight()
        torso, pelvis = physics.default_heights()
        standing = _high(heights["torso", "z"], torso), _high(heights["pelvis", "z"], pelvis)
        level = _MIN_UPRIGHT_COSINE
        upright = rewards.tolerance(
            physics.upright(), (level, np.inf), 1 + level, "linear", value_at_margin=0
        )
        force = physics.touch_sensors().sum(axis=-1)
        touch = rewards.tolerance(force, (weight, np.inf), weight, "linear", value_at_margin=0.9)
        return arrays.concat((_joined(*standing), upright, _joined(touch)))

    def reward_terms(self, physics: Physics) -> dict[str, Quantity]:
        """The factors by name; those that a subclass does not name are 'factor_6' and so on."""
        factors = self.get_reward_factors(physics)
        unnamed = (f"factor_{i}" for i in range(len(self.FACTORS), factors.shape[-1]))
        return {name: factors[..., i][()] for i, name in enumerate((*self.FACTORS, *unnamed))}

    def reward_of(self, terms: dict[str, Quantity]) -> Quantity:
        """The product of all terms, between 0 and 1."""
        return np.prod(_joined(*terms.values()), axis=-1)


class Move(Stand):
    """Move forward at a given speed, or up to twice as fast."""

    FACTORS = (*Stand.FACTORS, "forward")
    GOAL = (*Stand.GOAL, "forward")

    def __init__(
        self, move_speed: float, random: Seed = None, observe_reward_factors: bool = False
    ) -> None:
        """As `Stand`; from `move_speed`, metres per second, the speed is fully rewarded."""
        self._move_speed = move_speed
        super().__init__(random, observe_reward_factors)

    def get_reward_factors(self, physics: Physics) -> np.ndarray:
        """Those of `Stand`, and one for the forward speed, of which standing still has a fifth."""
        speed, bounds = physics.com_forward_velocity(), (self._move_speed, 2 * self._move_speed)
        margin = max(1.0, self._move_speed)
        forward = rewards.tolerance(speed, bounds, margin, "linear", value_at_margin=0)
        return arrays.concat((super().get_reward_factors(physics), _joined((4 * forward + 1) / 5)))


class Fetch(Stand):
    """Take the ball into the mouth and bring it to the target."""

    FACTORS = (*Stand.FACTORS, "reach_ball", "fetch_ball")
    GOAL = ("fetch_ball",)

    def initialize_episode(self, physics: Physics) -> None:
        """As `Stand`, and throws the ball towards the centre, up to 3 m high and at up to 5 m/s."""
        super().initialize_episode(physics)
        uniform, randn = self.random.uniform, self.random.randn
        radius = _THROW_FROM * physics.named.model.geom_size["floor", 0]
        azimuth = uniform(0, 2 * np.pi)
        sine, cosine = np.sin(azimuth), np.cos(azimuth)
        physics.named.data.qpos["ball_root"][:3] = radius * sine, radius * cosine, 0.05
        upward = np.sqrt(2 * -physics.model.opt.gravity[2] * uniform(0, 3))  # rises to that height
        speed = uniform(0, 5)
        direction = np.array([-sine + _THROW_NOISE * randn(), -cosine + _THROW_NOISE * randn()])
        physics.named.data.qvel["ball_root"][:3] = *speed * direction, upward

    def get_observation_components(self, physics: Physics) -> collections.OrderedDict:
        """Those of `Stand`, and ball and target seen from the head."""
        obs = super().get_observation_components(physics)
        obs["ball_state"] = physics.ball_in_head_frame()
        obs["target_position"] = physics.target_in_head_frame()
        return obs

    def get_reward_factors(self, physics: Physics) -> np.ndarray:
        """Those of `Stand`, and how close the ball is to mouth and target."""
        model, distance = physics.named.model, physics.ball_to_target_distance()
        bite, target = model.site_size["upper_bite", 0], model.geom_size["target", 0]
        to_ball = physics.ball_to_mouth_distance()
        reach = rewards.tolerance(to_ball, (0, bite), _BITE_MARGIN, "reciprocal")
        bring = rewards.tolerance(distance, (0, target), model.geom_size["floor", 0], "reciprocal")
        # Having fetched the ball, the dog may let go of it.
        reach = np.where(distance < 2 * target, 1, (6 * reach + 1) / 7)
        own = _joined(reach, (bring + 1) / 2)
        return arrays.concat((super().get_reward_factors(physics), own))


def _high(height: Quantity, default: Quantity) -> Quantity:
    """1 for nine tenths of the default height or more, (...)."""
    low = default * _STAND_HEIGHT_FRACTION
    return rewards.tolerance(height, (low, np.inf), margin=low)


def _joined(*parts: Quantity) -> np.ndarray:
    """The vector of k elements, or one per simulation, (...) each -> (..., k)."""
    return np.stack(parts, axis=-1)
