# type: ignore  (dm_control has no types, and may not be installed)
"""Images in place of the sky, a moved camera and other colours, as distracting benchmarks have."""

import hashlib
import itertools
import json
from typing import Any

import dm_env
import numpy as np
from dm_control import suite
from dm_control.mujoco.wrapper.mjbindings import enums, mjlib

_SKY = 0  # as such programs assume; the first texture of six domains
_SIDE = 800  # pixels; one square image for all six faces


class Background(dm_env.Environment):
    """An environment whose sky shows another image after each step."""

    def __init__(self, env: dm_env.Environment, seed: int, floor_alpha: float) -> None:
        self._env = env
        self._random = np.random.RandomState(seed)
        self._floor_alpha = floor_alpha

    def reset(self) -> dm_env.TimeStep:
        time_step = self._env.reset()
        model = self._env.physics.model
        self._env.physics.named.model.mat_rgba["grid", "a"] = self._floor_alpha
        model.tex_height[_SKY] = _SIDE
        model.cam_mode[0] = enums.mjtCamLight.mjCAMLIGHT_FIXED
        model.cam_pos[0] += self._random.uniform(-0.05, 0.05, 3)
        self._place = model.tex_adr[_SKY]
        self._size = model.tex_height[_SKY] * model.tex_width[_SKY] * 3
        self._show()
        return time_step

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        time_step = self._env.step(action)
        self._show()
        return time_step

    def _show(self) -> None:
        """A coarse random image."""
        coarse = self._random.randint(0, 256, (8, 8, 3), dtype=np.uint8)
        image = coarse.repeat(_SIDE // 8, axis=0).repeat(_SIDE // 8, axis=1)
        physics = self._env.physics
        physics.model.tex_data[self._place : self._place + self._size] = image.ravel()
        with physics.contexts.gl.make_current() as context:
            context.call(
                mjlib.mjr_uploadTexture, physics.model.ptr, physics.contexts.mujoco.ptr, _SKY
            )

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)

    def action_spec(self) -> Any:
        return self._env.action_spec()

    def observation_spec(self) -> Any:
        return self._env.observation_spec()


def main() -> None:
    tasks = {
        ("ball_in_cup", "catch"): 0.3,
        ("reacher", "easy"): 0.0,
        ("walker", "walk"): 1.0,
    }
    for (domain, task), alpha in tasks.items():
        env = Background(suite.load(domain, task, {"random": 0}), 1, alpha)
        for _ in range(2):
            time_step = env.reset()
            pictures = [env.physics.render(84, 84, camera_id=0)]
            for _ in range(2):
                time_step = env.step(np.full(env.action_spec().shape, 0.3))
                pictures.append(env.physics.render(84, 84, camera_id=0))
            assert all((a != b).any() for a, b in itertools.pairwise(pictures))
            result = {
                "task": f"{domain}-{task}",
                "reward": float(time_step.reward),
                "pictures": [hashlib.sha256(p.tobytes()).hexdigest() for p in pictures],
            }
            print(json.dumps(result))


main()
