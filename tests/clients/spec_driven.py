# type: ignore  (dm_control has no types, and may not be installed)
"""Everything read off the specs, in single precision, in an environment loop: as Acme does."""

import json
from typing import Any

import dm_env
import numpy as np
from dm_control import suite
from dm_control.rl import control
from dm_env import specs


def to_single(value: Any) -> Any:
    if value is None:
        return None
    if isinstance(value, dict):
        return type(value)((key, to_single(item)) for key, item in value.items())
    if isinstance(value, specs.Array):
        dtype = np.float32 if value.dtype == np.float64 else value.dtype
        return value.replace(dtype=dtype)
    array = np.asarray(value)
    return array.astype(np.float32) if array.dtype == np.float64 else array


class SinglePrecision(dm_env.Environment):
    def __init__(self, env: Any) -> None:
        self._environment = env

    def _convert(self, step: dm_env.TimeStep) -> dm_env.TimeStep:
        return step._replace(
            reward=to_single(step.reward),
            discount=to_single(step.discount),
            observation=to_single(step.observation),
        )

    def reset(self) -> dm_env.TimeStep:
        return self._convert(self._environment.reset())

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        return self._convert(self._environment.step(action))

    def observation_spec(self) -> Any:
        return to_single(self._environment.observation_spec())

    def action_spec(self) -> Any:
        return to_single(self._environment.action_spec())

    def reward_spec(self) -> Any:
        return to_single(self._environment.reward_spec())

    def discount_spec(self) -> Any:
        return to_single(self._environment.discount_spec())


def validated(env: dm_env.Environment, step: dm_env.TimeStep) -> dm_env.TimeStep:
    observation_spec = env.observation_spec()
    assert list(step.observation) == list(observation_spec)
    for name, value in step.observation.items():
        observation_spec[name].validate(value)
    if not step.first():
        env.reward_spec().validate(step.reward)
        env.discount_spec().validate(step.discount)
    return step


def run_episode(env: dm_env.Environment, random: np.random.RandomState, limit: int) -> list:
    spec, steps = env.action_spec(), []
    step = validated(env, env.reset())
    while not step.last() and len(steps) < limit:
        action = random.uniform(spec.minimum, spec.maximum).astype(spec.dtype)
        spec.validate(action)
        step = validated(env, env.step(action))
        steps.append({key: np.asarray(v).tolist() for key, v in step.observation.items()})
        steps[-1]["reward"] = float(step.reward)
    return steps


def main() -> None:
    for domain, task, arguments, options in (
        ("humanoid", "stand", {}, {}),
        ("humanoid", "run_pure_state", {"time_limit": 0.2}, {"flat_observation": True}),
        ("manipulator", "bring_peg", {"fully_observable": False}, {"flat_observation": True}),
        ("stacker", "stack_4", {"time_limit": 0.1}, {"legacy_step": False}),
    ):
        task_kwargs = {"random": 2, **arguments}
        raw = suite.load(domain, task, task_kwargs=task_kwargs, environment_kwargs=options)
        assert isinstance(raw, control.Environment)
        env = SinglePrecision(raw)
        random = np.random.RandomState(9)
        for episode in range(2):
            steps = run_episode(env, random, limit=15)
            result = {"task": f"{domain}-{task}", "episode": episode, "steps": steps}
            result["spec"] = [f"{k} {v}" for k, v in env.observation_spec().items()]
            result["actions"] = str(env.action_spec())
            print(json.dumps(result))


main()
