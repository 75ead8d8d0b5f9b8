# type: ignore  (dm_control has no types, and may not be installed)
"""Pictures and proprioception as a dictionary, action repeat: the environment of a Dreamer."""

import hashlib
import json
from typing import Any

import numpy as np
from dm_control import suite

try:
    from dm_control import manipulation
except ImportError:
    manipulation = None


class DeepMindControl:
    def __init__(
        self,
        name: str,
        action_repeat: int = 1,
        size: tuple[int, int] = (64, 64),
        camera: int | None = None,
        seed: int = 0,
    ) -> None:
        domain, task = name.split("_", 1)
        if domain == "manip" and manipulation is not None:
            self._env = manipulation.load(task + "_vision")
        else:
            self._env = suite.load(domain, task, task_kwargs={"random": seed})
        self._action_repeat = action_repeat
        self._size = size
        self._camera = {"quadruped": 2}.get(domain, 0) if camera is None else camera
        self._ignored_keys = [k for k, v in self._env.observation_spec().items() if v.shape == (0,)]

    @property
    def obs_space(self) -> dict[str, tuple]:
        shapes = {k: v.shape or (1,) for k, v in self._env.observation_spec().items()}
        return {"image": (*self._size, 3), **shapes}

    def step(self, action: np.ndarray) -> dict[str, Any]:
        assert np.isfinite(action).all(), action
        reward = 0.0
        for _ in range(self._action_repeat):
            time_step = self._env.step(action)
            reward += time_step.reward or 0.0
            if time_step.last():
                break
        assert time_step.discount in (0, 1)
        return self._obs(time_step, reward)

    def reset(self) -> dict[str, Any]:
        return self._obs(self._env.reset(), 0.0)

    def _obs(self, time_step: Any, reward: float) -> dict[str, Any]:
        obs = {
            "reward": reward,
            "is_first": time_step.first(),
            "is_last": time_step.last(),
            "is_terminal": time_step.discount == 0,
            "image": self._env.physics.render(*self._size, camera_id=self._camera),
        }
        obs.update(
            {
                key: np.asarray([value]) if len(np.shape(value)) == 0 else value
                for key, value in dict(time_step.observation).items()
                if key not in self._ignored_keys
            }
        )
        return obs


def main() -> None:
    random = np.random.RandomState(0)
    for name, camera in (("humanoid_run", None), ("stacker_stack_4", None), ("humanoid_stand", 1)):
        env = DeepMindControl(name, action_repeat=2, camera=camera, seed=3)
        spec = env._env.action_spec()
        obs = env.reset()
        for key, shape in env.obs_space.items():
            assert np.shape(obs[key]) == shape, key
        for _ in range(4):
            obs = env.step(random.uniform(spec.minimum, spec.maximum).astype(np.float32))
            assert obs["image"].dtype == np.uint8
            assert obs["image"].std() > 1.0, "an empty picture"
            vectors = {k: v.tolist() for k, v in obs.items() if k in env.obs_space and k != "image"}
            picture = hashlib.sha256(obs["image"].tobytes()).hexdigest()
            print(json.dumps({"name": name, "image": picture, "reward": obs["reward"], **vectors}))


main()
