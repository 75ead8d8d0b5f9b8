# type: ignore  (dm_control has no types, and may not be installed)
"""A Gymnasium environment around a suite task, as dmc2gym makes: flat observations, frame skip."""

import json
from typing import Any

import gymnasium
import numpy as np
from dm_control import suite
from dm_env import specs
from gymnasium import spaces


def to_box(parts: list[specs.Array], dtype: type) -> spaces.Box:
    lows, highs = [], []
    for part in parts:
        assert part.dtype in (np.float64, np.float32)
        size = int(np.prod(part.shape))
        if type(part) is specs.BoundedArray:
            lows.append(np.zeros(size) + part.minimum)
            highs.append(np.zeros(size) + part.maximum)
        else:
            assert type(part) is specs.Array
            lows.append(np.full(size, -np.inf))
            highs.append(np.full(size, np.inf))
    low, high = np.concatenate(lows), np.concatenate(highs)
    return spaces.Box(low.astype(dtype), high.astype(dtype), dtype=dtype)


def flatten(observation: Any) -> np.ndarray:
    parts = [np.array([v]) if np.isscalar(v) else v.ravel() for v in observation.values()]
    return np.concatenate(parts, axis=0)


class Bridge(gymnasium.Env):
    def __init__(self, domain: str, task: str, seed: int, frame_skip: int) -> None:
        self._frame_skip = frame_skip
        self._env = suite.load(
            domain_name=domain,
            task_name=task,
            task_kwargs={"random": seed},
            visualize_reward=False,
            environment_kwargs=None,
        )
        self._true_action_space = to_box([self._env.action_spec()], np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, self._true_action_space.shape, np.float32)
        self.observation_space = to_box(list(self._env.observation_spec().values()), np.float64)
        self.current_state: np.ndarray | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple:
        if seed is not None:
            self._env.task._random = np.random.RandomState(seed)
        time_step = self._env.reset()
        self.current_state = flatten(time_step.observation)
        return self.current_state, {}

    def step(self, action: np.ndarray) -> tuple:
        assert self.action_space.contains(action)
        true = self._true_action_space
        fraction = (action.astype(np.float64) + 1.0) / 2.0
        action = (true.low + fraction * (true.high - true.low)).astype(np.float32)
        info = {"internal_state": self._env.physics.get_state().copy()}
        reward = 0.0
        for _ in range(self._frame_skip):
            time_step = self._env.step(action)
            reward += time_step.reward or 0.0
            if time_step.last():
                break
        info["discount"] = time_step.discount
        self.current_state = flatten(time_step.observation)
        return self.current_state, reward, False, time_step.last(), info


def main() -> None:
    for domain, task, frame_skip in (
        ("humanoid", "walk", 4),
        ("manipulator", "insert_peg", 2),
        ("stacker", "stack_2", 8),
    ):
        env = Bridge(domain, task, seed=1, frame_skip=frame_skip)
        env.action_space.seed(1)
        for seed in (None, 23):
            state, _ = env.reset(seed=seed)
            assert env.observation_space.shape == state.shape
            total, steps, truncated = 0.0, 0, False
            while not truncated and steps < 60:
                state, reward, _, truncated, info = env.step(env.action_space.sample())
                total, steps = total + reward, steps + 1
            result = {
                "task": f"{domain}-{task}",
                "return": total,
                "steps": steps,
                "discount": info["discount"],
                "state": state.tolist(),
                "internal": info["internal_state"].tolist(),
                "control_timestep": env.control_timestep(),
            }
            print(json.dumps(result))


main()
