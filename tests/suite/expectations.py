"""Facts about particular domains, for laws that cannot read them from the tasks.

Domains not listed here are tested too; an entry makes the laws stricter for its domain.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["COMBINED", "REWARDING", "STARTS", "UNBOUNDED", "any_start"]

_DOG = [("dog", task) for task in ("stand", "walk", "trot", "run", "fetch")]
_HUMANOID = [("humanoid", task) for task in ("stand", "walk", "run", "run_pure_state")]
_HUMANOID_CMU = [("humanoid_CMU", task) for task in ("stand", "walk", "run")]
_BALLS = [("manipulator", task) for task in ("bring_ball", "insert_ball")]
_PEGS = [("manipulator", task) for task in ("bring_peg", "insert_peg")]
_CARTPOLE = [("cartpole", task) for task in ("balance", "swingup", "two_poles", "three_poles")]
_SWIMMER = [("swimmer", task) for task in ("swimmer6", "swimmer15")]
_STACKS = [("stacker", task) for task in ("stack_2", "stack_4")]
_LQR = [("lqr", task) for task in ("lqr_2_1", "lqr_6_2")]
_HOPS = [("hopper", task) for task in ("stand", "hop")]
_OF_ONE_TERM = [("cheetah", "run"), ("fish", "upright")]
_OF_ONE_TERM += [("finger", task) for task in ("spin", "turn_easy", "turn_hard")]
_QUADRUPED = [("quadruped", task) for task in ("walk", "run", "escape")]
_WALKS = [("walker", task) for task in ("walk", "run")]
_TOYS = [
    *(("acrobot", task) for task in ("swingup", "swingup_sparse")),
    ("ball_in_cup", "catch"),
    ("pendulum", "swingup"),
    *((domain, task) for domain in ("point_mass", "reacher") for task in ("easy", "hard")),
]


# Any: an environment whose task and physics are of one domain.
def any_start(env: Any) -> None:
    """Puts things where an episode may start."""
    with env.physics.reset_context():
        env.task.initialize_episode(env.physics)


def _prop_at_target(env: Any) -> None:
    physics, task = env.physics, env.task
    with physics.reset_context():
        task.initialize_episode(physics)
        joints = [f"{task._object}_{dimension}" for dimension in "xz"]
        place = physics.named.model.body_pos[task._target, ["x", "z"]]
        physics.named.data.qpos[joints] = place + 0.005


def _box_at_target(env: Any) -> None:
    physics = env.physics
    with physics.reset_context():
        env.task.initialize_episode(physics)
        place = physics.named.model.body_pos["target", ["x", "z"]]
        physics.named.data.qpos[["box0_x", "box0_z"]] = place + 0.005


def _pole_upright(env: Any) -> None:
    with env.physics.reset_context():
        env.physics.named.data.qpos["hinge"] = env.task.random.uniform(-0.2, 0.2)


def _tip_near_target(env: Any) -> None:
    angles = env.task.random.uniform(-0.1, 0.1, 2)
    with env.physics.reset_context():
        env.physics.named.data.qpos[["shoulder", "elbow"]] = angles


def _mass_near_target(env: Any) -> None:
    with env.physics.reset_context():
        env.task.initialize_episode(env.physics)
        env.physics.data.qpos[:] *= 0.1


def _target_near_finger(env: Any) -> None:
    physics = env.physics
    with physics.reset_context():
        env.task.initialize_episode(physics)
        physics.forward()
        finger = physics.named.data.geom_xpos["finger", :2]
        place = finger + env.task.random.uniform(-0.03, 0.03, 2)
        physics.named.model.geom_pos["target", :2] = place


def _ball_near_cup(env: Any) -> None:
    with env.physics.reset_context():
        env.physics.named.data.qpos["ball_x"] = env.task.random.uniform(-0.03, 0.03)
        env.physics.named.data.qpos["ball_z"] = env.task.random.uniform(0.32, 0.38)


def _running(env: Any) -> None:
    any_start(env)
    env.physics.named.data.qvel["rootx"] += 2.0
    env.physics.forward()


def _spinning_in_target(env: Any) -> None:
    any_start(env)
    x, z = env.physics.target_position()
    env.physics.named.data.qpos["hinge"] = -math.atan2(x, z)
    env.physics.named.data.qvel["hinge"] = -16.0
    env.physics.forward()


def _upright(env: Any) -> None:
    with env.physics.reset_context():
        env.physics.data.qvel[:] = 0.01


def _near_rest(env: Any) -> None:
    with env.physics.reset_context():
        env.task.initialize_episode(env.physics)
        env.physics.data.qpos[:] *= 0.5


def _nose_near_target(env: Any) -> None:
    physics = env.physics
    with physics.reset_context():
        env.task.initialize_episode(physics)
        physics.named.data.qpos[["rootx", "rooty"]] = physics.named.model.geom_pos["target"][:2]


def _of_peg(terms: Mapping[str, float]) -> float:
    return max(terms["bringing"], terms["grasping"] / 3)


def _of_stance(terms: Mapping[str, float]) -> float:
    return 0.75 * terms["standing"] + 0.25 * terms["upright"]


def _of_walk(terms: Mapping[str, float]) -> float:
    return _of_stance(terms) * (1 + 5 * terms["movement"]) / 6


def _of_swim(terms: Mapping[str, float]) -> float:
    return 7 / 8 * terms["in_target"] + 1 / 8 * terms["upright"]


def _of_fetch(terms: Mapping[str, float]) -> float:
    return terms["upright"] * (terms["reach"] * (0.5 + 0.5 * terms["fetch"]))


def _of_costs(terms: Mapping[str, float]) -> float:
    return 1 - sum(terms.values())


def _product(terms: Mapping[str, float]) -> float:
    return math.prod(terms.values())


# Tasks whose reward is 1 less a cost that has no upper bound.
UNBOUNDED = set(_LQR)

# By domain: puts things where the reward is positive; by default where an episode may start.
REWARDING: dict[str, Callable[[Any], None]] = {
    "cheetah": _running,
    "acrobot": _tip_near_target,
    "ball_in_cup": _ball_near_cup,
    "finger": _spinning_in_target,
    "hopper": _running,
    "cartpole": _upright,
    "lqr": _near_rest,
    "manipulator": _prop_at_target,
    "pendulum": _pole_upright,
    "point_mass": _mass_near_target,
    "reacher": _target_near_finger,
    "stacker": _box_at_target,
    "swimmer": _nose_near_target,
}

# By task: the reward that the documents make of the terms.
COMBINED: dict[tuple[str, str], Callable[[Mapping[str, float]], float]] = {
    **dict.fromkeys(_PEGS, _of_peg),
    **dict.fromkeys([*_DOG, *_HUMANOID, *_HUMANOID_CMU, *_BALLS, *_STACKS, *_CARTPOLE], _product),
    **dict.fromkeys([*_QUADRUPED, *_HOPS, *_OF_ONE_TERM, *_TOYS], _product),
    ("quadruped", "fetch"): _of_fetch,
    ("fish", "swim"): _of_swim,
    ("walker", "stand"): _of_stance,
    **dict.fromkeys(_WALKS, _of_walk),
    **dict.fromkeys(_LQR, _of_costs),
}

# By task: the kinds of starts.
STARTS: dict[tuple[str, str], set[str]] = {
    **{task: {"face_up", "face_down", "on_side", "up"} for task in (*_HUMANOID, *_HUMANOID_CMU)},
    **{task: {"in_hand", "in_target", "uniform"} for task in (*_BALLS, *_PEGS)},
    ("stacker", "stack_2"): {"level_0", "level_1"},
    ("stacker", "stack_4"): {"level_0", "level_1", "level_2", "level_3"},
    **{task: {"close", "far"} for task in _SWIMMER},
}
