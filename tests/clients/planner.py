# type: ignore  (dm_control has no types, and may not be installed)
"""A random-shooting planner: saved and restored states, copies, named indexing, raw MuJoCo."""

import copy
import json
import pickle
from typing import Any

import mujoco
import numpy as np
from dm_control import suite
from dm_control.mujoco import engine
from dm_control.mujoco.wrapper.mjbindings import mjlib
from dm_control.rl.control import PhysicsError


def rollout(physics: engine.Physics, state: np.ndarray, controls: np.ndarray) -> float:
    with physics.reset_context():
        physics.set_state(state)
    height = 0.0
    for control in controls:
        physics.set_control(control)
        physics.step(5)
        height += physics.head_height() + physics.torso_upright()
    return height


def plan(env: Any, random: np.random.RandomState) -> dict:
    scratch = env.physics.copy(share_model=True)
    state = env.physics.get_state()
    candidates = random.uniform(-1, 1, (6, 4, env.physics.model.nu))
    values = [float(rollout(scratch, state, candidate)) for candidate in candidates]
    step = env.step(candidates[int(np.argmax(values))][0])
    return {"values": values, "reward": float(step.reward), "time": env.physics.time()}


def facts(physics: engine.Physics) -> dict:
    torso = physics.named.data.xmat["torso", ["zx", "zy", "zz"]]
    limits = physics.named.model.jnt_range[["abdomen_z", "right_knee"]]
    quaternion, matrix = np.array([1.0, 0.5, 0.0, 0.0]), np.empty(9)
    mjlib.mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
    return {
        "torso": torso.tolist(),
        "limits": limits.tolist(),
        "axes": str(physics.named.data.qpos).splitlines()[0].split(),
        "matrix": matrix.tolist(),
        "contacts": int(physics.data.ncon),
        "mass": float(physics.model.body_mass.sum()),
        "gravity": physics.model.opt.gravity.tolist(),
        "total": float(mujoco.mj_getTotalmass(physics.model.ptr)),
    }


def diverges(env: Any) -> bool:
    physics = env.physics.copy()
    with physics.reset_context():
        physics.data.qvel[:] = 1.0
    physics.data.qvel[0] = np.nan
    try:
        physics.step()
    except PhysicsError:
        return True
    return False


def main() -> None:
    env = suite.load("humanoid", "walk", task_kwargs={"random": np.random.RandomState(8)})
    random = np.random.RandomState(0)
    env.reset()
    for _ in range(4):
        print(json.dumps(plan(env, random)))
    print(json.dumps(facts(env.physics)))
    twins = [
        copy.deepcopy(env.physics),
        pickle.loads(pickle.dumps(env.physics)),
        engine.Physics.from_model(env.physics.model),
    ]
    for physics in twins:
        with physics.reset_context():
            physics.set_state(env.physics.get_state())
        physics.step(3)
        print(json.dumps({"twin": physics.get_state().tolist()}))
    with env.physics.model.disable("gravity", "contact"):
        env.physics.step(2)
    print(json.dumps({"floating": env.physics.get_state().tolist(), "diverges": diverges(env)}))
    with env.physics.suppress_physics_errors():
        env.physics.step(1)
    env.physics.free()


main()
