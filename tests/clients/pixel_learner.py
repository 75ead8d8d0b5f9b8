# type: ignore  (dm_control has no types, and may not be installed)
"""Stacked pictures from the suite's pixels wrapper, as for DrQ; a camera moved by hand."""

import collections
import hashlib
import json
from typing import Any

import numpy as np
from dm_control import mujoco, suite
from dm_control.suite.wrappers import action_scale, pixels


def digest(picture: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(picture).tobytes()).hexdigest()


def stacked(env: Any, frames: collections.deque[np.ndarray], time_step: Any) -> np.ndarray:
    frames.append(time_step.observation["pixels"].transpose(2, 0, 1))
    while len(frames) < 3:
        frames.append(frames[-1])
    return np.concatenate(list(frames), axis=0)


def main() -> None:
    for domain, task, camera_id in (("manipulator", "bring_ball", 0), ("humanoid", "walk", 1)):
        env = suite.load(domain, task, task_kwargs={"random": 0}, visualize_reward=True)
        env = action_scale.Wrapper(env, minimum=-1.0, maximum=+1.0)
        render_kwargs = {"height": 84, "width": 84, "camera_id": camera_id}
        env = pixels.Wrapper(env, pixels_only=True, render_kwargs=render_kwargs)
        assert env.observation_spec()["pixels"].shape == (84, 84, 3)
        frames: collections.deque[np.ndarray] = collections.deque(maxlen=3)
        random = np.random.RandomState(0)
        observation = stacked(env, frames, env.reset())
        for _ in range(5):
            time_step = env.step(random.uniform(-1, 1, env.action_spec().shape))
            observation = stacked(env, frames, time_step)
        assert observation.shape == (9, 84, 84)
        assert observation.std() > 1.0, "an empty picture"
        camera = mujoco.MovableCamera(env.physics, height=48, width=64)
        camera.set_pose([0, 0, 1], 3, 30, -20)
        depth = env.physics.render(48, 64, camera_id=camera_id, depth=True)
        segments = env.physics.render(48, 64, camera_id=camera_id, segmentation=True)
        result = {
            "task": f"{domain}-{task}",
            "reward": float(time_step.reward),
            "stack": digest(observation),
            "movable": digest(camera.render()),
            "depth": digest(depth),
            "segments": digest(segments),
        }
        print(json.dumps(result))


main()
