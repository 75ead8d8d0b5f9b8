# type: ignore  (dm_control has no types, and may not be installed)
"""A stack of dm_env wrappers, as in TD-MPC2 and DrQ-v2: float32, action repeat, scaled actions."""

import collections
import json
from typing import Any, NamedTuple

import dm_env
import numpy as np
from dm_control import suite
from dm_control.suite.wrappers import action_scale
from dm_env import StepType, specs

suite.ALL_TASKS = suite.ALL_TASKS + suite._get_tasks("custom")
suite.TASKS_BY_DOMAIN = suite._get_tasks_by_domain(suite.ALL_TASKS)


class ExtendedTimeStep(NamedTuple):
    step_type: Any
    reward: Any
    discount: Any
    observation: Any
    action: Any

    def last(self) -> bool:
        return self.step_type == StepType.LAST


class Delegate(dm_env.Environment):
    def __init__(self, env: Any) -> None:
        self._env = env

    def reset(self) -> Any:
        return self._env.reset()

    def step(self, action: np.ndarray) -> Any:
        return self._env.step(action)

    def observation_spec(self) -> Any:
        return self._env.observation_spec()

    def action_spec(self) -> Any:
        return self._env.action_spec()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)


class ActionRepeat(Delegate):
    def __init__(self, env: Any, repeats: int) -> None:
        super().__init__(env)
        self._repeats = repeats

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        reward, discount = 0.0, 1.0
        for _ in range(self._repeats):
            time_step = self._env.step(action)
            reward += (time_step.reward or 0.0) * discount
            discount *= time_step.discount
            if time_step.last():
                break
        return time_step._replace(reward=reward, discount=discount)


class ActionDType(Delegate):
    def __init__(self, env: Any, dtype: type) -> None:
        super().__init__(env)
        spec = env.action_spec()
        self._spec = specs.BoundedArray(spec.shape, dtype, spec.minimum, spec.maximum, "action")

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        return self._env.step(action.astype(self._env.action_spec().dtype))

    def action_spec(self) -> specs.BoundedArray:
        return self._spec


class FlatFloat32(Delegate):
    def step(self, action: np.ndarray) -> ExtendedTimeStep:
        return self._extend(self._env.step(action), action)

    def reset(self) -> ExtendedTimeStep:
        return self._extend(self._env.reset(), np.zeros(self.action_spec().shape, np.float32))

    def _extend(self, step: dm_env.TimeStep, action: np.ndarray) -> ExtendedTimeStep:
        parts = [np.asarray(v).flatten() for v in step.observation.values()]
        observation = np.concatenate(parts).astype(np.float32)
        return ExtendedTimeStep(
            step.step_type, step.reward or 0.0, step.discount or 1.0, observation, action
        )


def make_env(domain: str, task: str, seed: int, repeats: int) -> FlatFloat32:
    if (domain, task) not in suite.ALL_TASKS:
        raise ValueError(f"unknown task: {domain} {task}")
    env = suite.load(domain, task, task_kwargs={"random": seed}, visualize_reward=False)
    env = ActionDType(env, np.float32)
    env = ActionRepeat(env, repeats)
    env = action_scale.Wrapper(env, minimum=-1.0, maximum=1.0)
    return FlatFloat32(env)


def main() -> None:
    assert set(suite.TASKS_BY_DOMAIN["humanoid"]) == {"stand", "walk", "run", "run_pure_state"}
    for domain, task in suite.ALL_TASKS:
        if domain not in ("humanoid", "manipulator", "stacker"):
            continue
        env = make_env(domain, task, seed=5, repeats=2)
        random = np.random.default_rng(0)
        window: collections.deque[np.ndarray] = collections.deque(maxlen=3)
        time_step, episode_reward, steps = env.reset(), 0.0, 0
        while not time_step.last() and steps < 50:
            window.append(time_step.observation)
            action = random.uniform(-1.0, 1.0, env.action_spec().shape).astype(np.float32)
            time_step = env.step(action)
            episode_reward, steps = episode_reward + time_step.reward, steps + 1
        assert time_step.observation.dtype == np.float32
        result = {
            "task": f"{domain}-{task}",
            "return": float(episode_reward),
            "window": np.stack(window).tolist(),
            "physics": env.physics.get_state().tolist(),
            "n_sub_steps": env._n_sub_steps,
            "time": env.physics.time(),
        }
        print(json.dumps(result))


main()
