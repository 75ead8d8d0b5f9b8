"""Quadruped: walk, run, climb out of a bowl, or fetch a ball, on four legs with 12 actuators.

An episode begins with the torso turned at random, just above the ground; escape draws a terrain
too. The tasks come from the DeepMind Control Suite (https://arxiv.org/abs/1801.00690).
"""

import collections
import contextlib
import functools
from collections.abc import Mapping
from typing import ClassVar
from xml.etree import ElementTree

import mujoco as official
import numpy as np

from limberjack import mujoco
from limberjack.mujoco import wrapper
from limberjack.mujoco.wrapper.mjbindings import enums
from limberjack.rl import control
from limberjack.suite import _locomotion as locomotion
from limberjack.suite import _parameters, base, common
from limberjack.suite._zoom import zoom
from limberjack.suite.base import Kwargs, Seed
from limberjack.utils import arrays, containers, rewards, xml_tools
from limberjack.worlds.faults import Parameter, Range

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Escape",
    "Fetch",
    "Move",
    "Physics",
    "escape",
    "fetch",
    "make_model",
    "run",
    "walk",
]

_DEFAULT_TIME_LIMIT = 20  # seconds
_CONTROL_TIMESTEP = 0.02  # seconds

_RUN_SPEED = 5  # metres per second; forward speed at which running is fully rewarded
_WALK_SPEED = 0.5  # metres per second; the same for walking
_ESCAPE_FLOOR = 40  # metres; half the length of escape's floor, which extends beyond the terrain
_ESCAPE_TILT = 20  # degrees; in escape, a torso tilted by less counts as upright

_HEIGHTFIELD_ID = 0
_TERRAIN_SMOOTHNESS = 0.15  # smallest factor of a bump: 0 is maximally bumpy, 1 smooth
_TERRAIN_BUMP_SCALE = 2  # metres between two bumps
_FLAT_CENTRE = 0.04  # radius within which the bowl is flat, as a fraction of the terrain's

_RISE = 0.01  # metres between two heights that are tried for a start
_MAX_RISES = 10_000  # heights to try
_SPAWN = 0.9  # fraction of the floor in which fetch starts
_BALL_HEIGHT = 2  # metres; where the ball is dropped
_BALL_SPEED = 5  # metres per second; standard deviation of each horizontal velocity of the ball

_TOES = ["toe_front_left", "toe_back_left", "toe_back_right", "toe_front_right"]
_WALLS = ["wall_px", "wall_py", "wall_nx", "wall_ny"]
_NO_INTERSECTION = -1.0  # reading of a range finder that sees nothing
_SENSORS = enums.mjtSensor

SUITE = containers.TaggedTasks()
# Chosen by eye: the quadruped stands, and in fetch the ball and the target are visible.
PICTURES = {
    "walk": base.Picture("x", seed=3, steps=30),
    "run": base.Picture("x", seed=0, steps=30),
    "escape": base.Picture("x", seed=3, steps=30),
    "fetch": base.Picture("global", seed=0, steps=30),
}
OBSERVATIONS = {
    "egocentric_state": base.Observed(
        "angles of the hinges, their velocities, activations of the actuators", "rad; rad/s; 1"
    ),
    "torso_velocity": base.Observed("velocity of the torso in its own frame", "m/s"),
    "torso_upright": base.Observed("cosine of the torso's tilt: 1 upright, -1 upside down"),
    "imu": base.Observed("the torso's acceleration and angular velocity", "m/s^2; rad/s"),
    "force_torque": base.Observed(
        "inverse hyperbolic sine of the force, then the torque, on each toe", "asinh(N); asinh(Nm)"
    ),
    "origin": base.Observed("the world's origin in the torso's frame", "m"),
    "rangefinder": base.Observed(
        "hyperbolic tangent of each range finder's distance; 1 if it sees nothing", "tanh(m)"
    ),
    "ball_state": base.Observed(
        "the ball's position, velocity and angular velocity in the torso's frame", "m; m/s; rad/s"
    ),
    "target_position": base.Observed("the target in the torso's frame", "m"),
}


def make_model(
    floor_size: float | None = None,
    terrain: bool = False,
    rangefinders: bool = False,
    walls_and_ball: bool = False,
) -> bytes:
    """The model's MJCF, which includes files of `common.ASSETS`.

    Args:
      floor_size: half the length of the floor, metres; by default that between the walls.
      terrain: whether there is a height field, flat in the model.
      rangefinders: whether there are range finders, which take time even if they are not read.
      walls_and_ball: whether there are walls, a ball and a target.
    """
    root = ElementTree.fromstring(common.read_model("quadruped.xml"))
    find = functools.partial(xml_tools.find_element, root)
    unused = [] if rangefinders else root.findall("sensor/rangefinder")
    if not terrain:
        unused += [find("geom", "terrain")]
    if not walls_and_ball:
        unused += [*(find("geom", wall) for wall in _WALLS), find("body", "ball")]
        unused += [find("site", "target")]
    for element in unused:
        xml_tools.remove_element(root, element)
    if floor_size is not None:
        find("geom", "floor").set("size", f"{floor_size} {floor_size} .5")
    return ElementTree.tostring(root)


@SUITE.add()
def walk(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Walk forward at 0.5 m/s or more."""
    model = make_model(floor_size=_DEFAULT_TIME_LIMIT * _WALK_SPEED)
    return _environment(model, Move(_WALK_SPEED, random), time_limit, environment_kwargs)


@SUITE.add()
def run(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Run forward, up to 5 m/s."""
    model = make_model(floor_size=_DEFAULT_TIME_LIMIT * _RUN_SPEED)
    return _environment(model, Move(_RUN_SPEED, random), time_limit, environment_kwargs)


@SUITE.add()
def escape(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Climb out of a bowl of rough terrain."""
    model = make_model(floor_size=_ESCAPE_FLOOR, terrain=True, rangefinders=True)
    return _environment(model, Escape(random), time_limit, environment_kwargs)


@SUITE.add()
def fetch(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Bring a ball to the target at the origin."""
    model = make_model(walls_and_ball=True)
    return _environment(model, Fetch(random), time_limit, environment_kwargs)


def _environment(
    model: bytes, task: base.Task, time_limit: float, kwargs: Kwargs
) -> control.Environment:
    physics = Physics.from_shared_xml(model, common.ASSETS)
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the quadruped, or of another body with sensors of the same types."""

    def _reload_from_data(self, data: wrapper.MjData) -> None:
        for name in ("_hinge_names", "_sensor_types_to_names"):  # another model's
            vars(self).pop(name, None)
        super()._reload_from_data(data)

    @functools.cached_property
    def _hinge_names(self) -> list[str]:
        hinges = np.flatnonzero(self.model._official.jnt_type == enums.mjtJoint.mjJNT_HINGE)
        return [self.model.id2name(hinge, "joint") for hinge in hinges.tolist()]

    @functools.cached_property
    def _sensor_types_to_names(self) -> dict[tuple[int, ...], list[str]]:
        return {}  # filled by `_get_sensor_names`

    def _get_sensor_names(self, *sensor_types: int) -> list[str]:
        """Names of the sensors of these types, in the model's order."""
        known = self._sensor_types_to_names
        if sensor_types not in known:
            ids = np.flatnonzero(np.isin(self.model._official.sensor_type, sensor_types)).tolist()
            known[sensor_types] = [self.model.id2name(index, "sensor") for index in ids]
        return known[sensor_types]

    def torso_upright(self) -> np.ndarray:
        """Cosine of the torso's tilt, (...): 1 upright, -1 upside down."""
        return self.named.data.xmat["torso", ["zz"]][..., 0]

    def torso_velocity(self) -> np.ndarray:
        """Velocity of the torso in its own frame, (..., 3), metres per second."""
        return self.named.data.sensordata["velocimeter"].copy()

    def egocentric_state(self) -> np.ndarray:
        """Angles and velocities of the hinges, and activations of the actuators, (..., 44)."""
        hinges, data = self._hinge_names, self.named.data
        return arrays.concat((data.qpos[hinges], data.qvel[hinges], self.data.act))

    def toe_positions(self) -> np.ndarray:
        """Toes in the torso's frame, (..., 4, 3), metres, anticlockwise from the front left."""
        xpos = self.named.data.xpos
        return self._rows_in_torso_frame(xpos[_TOES] - xpos["torso"][..., None, :])

    def force_torque(self) -> np.ndarray:
        """Inverse hyperbolic sine of the forces, then the torques, on the toes, (..., 24)."""
        sensors = self._get_sensor_names(_SENSORS.mjSENS_FORCE, _SENSORS.mjSENS_TORQUE)
        return np.arcsinh(self.named.data.sensordata[sensors])

    def imu(self) -> np.ndarray:
        """Acceleration, m/s^2, and angular velocity, rad/s, of the torso in its frame, (..., 6)."""
        sensors = self._get_sensor_names(_SENSORS.mjSENS_GYRO, _SENSORS.mjSENS_ACCELEROMETER)
        return self.named.data.sensordata[sensors]

    def rangefinder(self) -> np.ndarray:
        """Hyperbolic tangent of the distances in metres, (..., 20); 1 where nothing is seen."""
        sensors = self._get_sensor_names(_SENSORS.mjSENS_RANGEFINDER)
        readings = self.named.data.sensordata[sensors]
        return np.where(readings == _NO_INTERSECTION, 1.0, np.tanh(readings))

    def origin_distance(self) -> np.ndarray:
        """Distance of the workspace from the world's origin, (...), metres."""
        return arrays.norm(self.named.data.site_xpos[["workspace"]])[..., 0]

    def origin(self) -> np.ndarray:
        """The world's origin in the torso's frame, (..., 3), metres."""
        data = self.named.data
        return -arrays.to_frame(data.xpos["torso"], data.xmat["torso"])

    def ball_state(self) -> np.ndarray:
        """Position and velocity relative to the torso, and angular velocity of the ball, (..., 9).

        In the torso's frame; metres, metres per second, radians per second.
        """
        data = self.named.data
        ball, root = data.qvel["ball_root"], data.qvel["root"]
        position = data.xpos["ball"] - data.xpos["torso"]
        state = np.stack((position, ball[..., :3] - root[..., :3], ball[..., 3:]), axis=-2)
        state = self._rows_in_torso_frame(state)
        return state.reshape(*state.shape[:-2], -1)

    def target_position(self) -> np.ndarray:
        """The target in the torso's frame, (..., 3), metres."""
        data = self.named.data
        return arrays.to_frame(data.site_xpos["target"] - data.xpos["torso"], data.xmat["torso"])

    def ball_to_target_distance(self) -> arrays.Quantity:
        """Horizontal distance from the ball to the target, (...), metres."""
        return self._distance_to_ball("target")

    def self_to_ball_distance(self) -> arrays.Quantity:
        """Horizontal distance from the workspace to the ball, (...), metres."""
        return self._distance_to_ball("workspace")

    def _distance_to_ball(self, site: str) -> arrays.Quantity:
        data = self.named.data
        return arrays.norm((data.site_xpos[site] - data.xpos["ball"])[..., :2])

    def _rows_in_torso_frame(self, rows: np.ndarray) -> np.ndarray:
        """Vectors of the world, (..., k, 3), in the torso's frame."""
        frame = self.named.data.xmat["torso"]
        # One product of matrices, as in dm_control; `to_frame` may round differently.
        return np.matmul(rows, frame.reshape(*frame.shape[:-1], 3, 3))


# Names and arguments of this function and the next two are dm_control's: task files call them.
def _find_non_contacting_height(
    physics: mujoco.Physics, orientation: np.ndarray, x_pos: float = 0.0, y_pos: float = 0.0
) -> None:
    """Resets to the lowest pose without contacts, in steps of a centimetre from the ground."""
    pose, qpos = np.array([x_pos, y_pos, 0.0, *orientation]), physics.named.data.qpos
    model, data = physics.model._official, physics.data._data
    physics.simulation.reset()
    for _ in range(_MAX_RISES):
        # A test of contacts takes a tenth of the time of a reset; the last one stays.
        qpos["root"] = pose
        official.mj_kinematics(model, data)
        official.mj_collision(model, data)
        if not data.ncon:
            with contextlib.suppress(control.PhysicsError), physics.reset_context():
                qpos["root"] = pose
            return
        pose[2] += _RISE
    raise RuntimeError(
        f"the quadruped has contacts at every height up to {pose[2]:.0f} m; check whether a "
        "change of the model rules out a start"
    )


def _common_observations(physics: Physics) -> collections.OrderedDict:
    """State of the body, without its position and heading."""
    obs = collections.OrderedDict()
    obs["egocentric_state"] = physics.egocentric_state()
    obs["torso_velocity"] = physics.torso_velocity()
    obs["torso_upright"] = physics.torso_upright()
    obs["imu"] = physics.imu()
    obs["force_torque"] = physics.force_torque()
    return obs


def _upright_reward(physics: Physics, deviation_angle: float = 0) -> arrays.Quantity:
    """1 for a tilt of at most `deviation_angle` degrees, decreasing to 0 upside down, (...)."""
    return locomotion.upright(physics.torso_upright(), np.cos(np.deg2rad(deviation_angle)))


def _set_shin_length(root: ElementTree.Element, length: float) -> None:
    """Sets the extent of the shins in x and in z, metres; the ankles are at their ends."""
    shin = _parameters.default_of(root, "knee", "geom")
    _parameters.set_numbers(shin, "fromto", 0, 0, 0, length, 0, -length)
    for toe in _TOES:
        ankle = xml_tools.find_element(root, "body", toe.replace("toe", "ankle"))
        _parameters.set_numbers(ankle, "pos", length, 0, -length)


def _set_torso_density(root: ElementTree.Element, density: float) -> None:
    _parameters.set_numbers(xml_tools.find_element(root, "geom", "torso"), "density", density)


def _set_joint_damping(root: ElementTree.Element, damping: float) -> None:
    _parameters.set_numbers(_parameters.default_of(root, "body", "joint"), "damping", damping)


def _set_contact_friction(root: ElementTree.Element, friction: float) -> None:
    _parameters.set_numbers(_parameters.default_of(root, "toe", "geom"), "friction", friction)
    floor = xml_tools.find_element(root, "geom", "floor")
    _parameters.set_numbers(floor, "friction", friction, 0.1, 0.1)


class Move(base.Task[Physics]):
    """Move forward at least at a given speed."""

    PERTURBATIONS: ClassVar[Mapping[str, Parameter]] = {
        "shin_length": Parameter(
            _set_shin_length,
            0.25,
            Range(0.25, 2.0, 0.1),
            _parameters.challenges(
                Range(0.25, 0.3, 0.005), Range(0.25, 0.8, 0.05), Range(0.25, 1.4, 0.1)
            ),
        ),
        "torso_density": Parameter(_set_torso_density, 1000.0, Range(500.0, 10000.0, 500.0)),
        "joint_damping": Parameter(_set_joint_damping, 30.0, Range(10.0, 150.0, 10.0)),
        "contact_friction": Parameter(_set_contact_friction, 1.5, Range(0.1, 4.5, 0.5)),
    }
    GOAL = ("upright", "movement")
    planner_cost = "limberjack.planner.single_stage.locomotion:Quadruped"

    def __init__(self, desired_speed: float, random: Seed = None) -> None:
        """Rewards a forward speed of `desired_speed`, m/s; 0 rewards any, and being upright."""
        self._desired_speed = desired_speed
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws the torso's orientation."""
        orientation = self.random.randn(4)
        _find_non_contacting_height(physics, orientation / np.linalg.norm(orientation))
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """State of the body."""
        return _common_observations(physics)

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Factors of the reward: uprightness and forward speed."""
        forward = physics.torso_velocity().T[0]  # `[..., 0]` would give an array, not a number
        movement = locomotion.speed(forward, self._desired_speed, value_at_margin=0.5)
        # A product is a number where the quantity is an array without axes, as for `torso_upright`.
        return {"upright": _upright_reward(physics) * 1.0, "movement": movement}


class Escape(base.Task[Physics]):
    """Climb out of a bowl of rough terrain, which is drawn for each episode."""

    EPISODE_FIELDS = ("hfield_data",)
    GOAL = ("upright", "escape")
    planner_cost = "limberjack.planner.single_stage.travelling:Escape"

    def initialize_episode(self, physics: Physics) -> None:
        """Draws the terrain and the torso's orientation."""
        model = physics.model
        size, start = (f[_HEIGHTFIELD_ID] for f in (model.hfield_nrow, model.hfield_adr))
        terrain = self._draw_terrain(size, 2 * model.hfield_size[_HEIGHTFIELD_ID, 0])
        model.hfield_data[start : start + size**2] = terrain.ravel()
        super().initialize_episode(physics)
        orientation = self.random.randn(4)
        _find_non_contacting_height(physics, orientation / np.linalg.norm(orientation))

    def _draw_terrain(self, size: int, length: float) -> np.ndarray:
        """Heights from 0 to 1 on a square grid, (size, size), for a terrain of this length."""
        y, x = np.ogrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j]
        radius = np.clip(np.sqrt(x**2 + y**2), _FLAT_CENTRE, 1)
        bowl = 0.5 - np.cos(2 * np.pi * radius) / 2
        count = int(length / _TERRAIN_BUMP_SCALE)
        return bowl * zoom(self.random.uniform(_TERRAIN_SMOOTHNESS, 1, (count, count)), size)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """State of the body, direction of the origin, and range finders."""
        obs = _common_observations(physics)
        obs["origin"] = physics.origin()
        obs["rangefinder"] = physics.rangefinder()
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Factors of the reward: uprightness and distance from the origin."""
        edge = physics.model.hfield_size[..., _HEIGHTFIELD_ID, 0]
        escape = locomotion.speed(physics.origin_distance(), edge) * 1.0
        return {"upright": _upright_reward(physics, _ESCAPE_TILT) * 1.0, "escape": escape}


class Fetch(base.Task[Physics]):
    """Bring a ball to the target at the origin."""

    GOAL = ("fetch",)
    planner_cost = "limberjack.planner.single_stage.travelling:Fetch"

    def initialize_episode(self, physics: Physics) -> None:
        """Draws heading and position, and the velocity and position of the falling ball."""
        uniform, data = self.random.uniform, physics.named.data
        half = uniform(0, 2 * np.pi) / 2
        radius = _SPAWN * physics.named.model.geom_size["floor", 0]
        position = uniform(-radius, radius, size=2)
        orientation = np.array([np.cos(half), 0, 0, np.sin(half)])
        _find_non_contacting_height(physics, orientation, *position)
        data.qpos["ball_root"][:3] = *uniform(-radius, radius, size=2), _BALL_HEIGHT
        data.qvel["ball_root"][:2] = _BALL_SPEED * self.random.randn(2)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """State of the body, and ball and target as seen from the torso."""
        obs = _common_observations(physics)
        obs["ball_state"] = physics.ball_state()
        obs["target_position"] = physics.target_position()
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Uprightness, closeness to the ball, and closeness of the ball to the target."""
        geom_size, site_size = physics.named.model.geom_size, physics.named.model.site_size
        within = functools.partial(rewards.tolerance, sigmoid="linear", value_at_margin=0)
        arena = geom_size["floor", 0] * np.sqrt(2)
        reach = site_size["workspace", 0] + geom_size["ball", 0]
        return {
            "upright": _upright_reward(physics) * 1.0,
            "reach": within(physics.self_to_ball_distance(), (0, reach), arena),
            "fetch": within(physics.ball_to_target_distance(), (0, site_size["target", 0]), arena),
        }

    def reward_of(self, terms: dict[str, arrays.Quantity]) -> arrays.Quantity:
        """The product of uprightness and reaching, half of which depends on fetching."""
        return terms["upright"] * (terms["reach"] * (0.5 + 0.5 * terms["fetch"]))
