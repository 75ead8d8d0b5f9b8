"""Environments of kinds that programs of this field write, for the tests of rows.

    build = KINDS["a last action"]
    env = build(3)      # begins with the first episode of seed 3

Each is small: a pole with one motor, a few steps an episode. All classes are at the top level of
this module, so that they can be pickled and used in another process.
"""

import collections
import functools
from collections.abc import Callable, Iterator
from typing import Any

import dm_env
import numpy as np
from dm_env import specs

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import base
from limberjack.suite.wrappers import action_noise, action_scale

SLIDER = """
<mujoco>
  <worldbody><body><joint name="slide" type="slide"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="slide" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
POLE = """
<mujoco model="pole">
  <option timestep="0.01"/>
  <visual><global offwidth="32" offheight="32"/></visual>
  <asset>
    <material name="self"/>
    <material name="self_default"/>
    <material name="self_highlight"/>
    <material name="effector"/>
    <material name="effector_default"/>
    <material name="effector_highlight"/>
    <material name="target"/>
    <material name="target_default"/>
    <material name="target_highlight"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <camera name="side" pos="0 -2 1" xyaxes="1 0 0 0 0 1"/>
    <body name="pole" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.1"/>
      <geom name="pole" type="capsule" size="0.03" fromto="0 0 0 0 0 0.5"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
STEPS = 6  # control steps of an episode
_LIMIT = STEPS * 0.02  # seconds


class Pole(base.Task):
    """Holds a pole up, written for rows: nothing odd about it."""

    def initialize_episode(self, physics: Any) -> None:
        physics.named.data.qpos["hinge"] = self.random.uniform(-1, 1)
        physics.named.data.qvel["hinge"] = self.random.uniform(-1, 1)

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        return collections.OrderedDict(
            position=physics.position().copy(), velocity=physics.velocity().copy()
        )

    def get_reward(self, physics: Any) -> Any:
        return np.cos(physics.data.qpos[..., 0])


class Blind(Pole):
    """Observes nothing."""

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        return collections.OrderedDict()


class LastAction(Pole):
    """An action-rate penalty."""

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self.last, self.penalty = np.zeros(1), 0.0

    def before_step(self, action: Any, physics: Any) -> None:
        action = np.asarray(action, float).reshape(1)
        self.penalty = float(np.abs(action - self.last).sum())
        self.last = action
        super().before_step(action, physics)

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) - 0.1 * self.penalty


class KeepsTheCallersArray(Pole):
    """Keeps the very array it was given, and compares it at the next step."""

    last: Any = None
    rate = 0.0

    def before_step(self, action: Any, physics: Any) -> None:
        self.rate = 0.0 if self.last is None else float(action[0] - self.last[0])
        self.last = action
        super().before_step(action, physics)

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) - self.rate


class Counting(Pole):
    """Counts steps, never reset, and ends an episode by itself at every fourth one."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.steps = 0

    def after_step(self, physics: Any) -> None:
        self.steps += 1
        super().after_step(physics)

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) + self.steps

    def get_termination(self, physics: Any) -> Any:
        return 0.0 if self.steps % 4 == 0 else None


class Queues(Pole):
    """A deque of actions, a dict of means, and None at first."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.delayed: collections.deque[np.ndarray] = collections.deque(maxlen=3)
        self.means: dict[str, Any] = {"number": 0, "mean": None}

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self.delayed.clear()

    def before_step(self, action: Any, physics: Any) -> None:
        self.delayed.append(np.array(action, float))
        super().before_step(self.delayed[0], physics)

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        found = super().get_observation(physics)
        mean = self.means["mean"]
        self.means["number"] += 1
        self.means["mean"] = found["velocity"] if mean is None else (mean + found["velocity"]) / 2
        found["velocity"] = found["velocity"] - self.means["mean"]
        found["number"] = np.array([float(self.means["number"])])
        return found


class Noisy(Pole):
    """Draws from the task's stream in every hook of a step."""

    def before_step(self, action: Any, physics: Any) -> None:
        noise = self.random.normal(scale=0.1, size=1)
        super().before_step(np.clip(action + noise, -1, 1), physics)

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) + self.random.normal(scale=0.1)

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        found = super().get_observation(physics)
        found["velocity"] = found["velocity"] + self.random.normal(size=1)
        return found

    def get_termination(self, physics: Any) -> Any:
        return 0.5 if self.random.uniform() < 0.2 else None


class Perturbed(Pole):
    """Writes the model in its start, each time from where the last start left it."""

    def initialize_episode(self, physics: Any) -> None:
        physics.model.body_mass[1] *= self.random.uniform(0.8, 1.2)
        physics.model.geom_rgba[0, 0] = self.random.uniform()
        super().initialize_episode(physics)


class Potential(Pole):
    """A potential-based reward, which remembers the last potential on its physics' behalf."""

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self.potential = None

    def get_reward(self, physics: Any) -> Any:
        potential, before = float(super().get_reward(physics)), self.potential
        self.potential = potential
        return 0.0 if before is None else potential - before


class Curriculum(Pole):
    """Each episode starts further down, and the second and third are shorter."""

    episodes = 0

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self.episodes += 1
        physics.named.data.qpos["hinge"] += 0.1 * self.episodes

    def get_termination(self, physics: Any) -> Any:
        return 1.0 if physics.data.time > 0.02 * (2 + self.episodes % 3) else None


class Slotted(Pole):
    """Its memory is in slots."""

    __slots__ = ("count", "unset")

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.count = 0

    def before_step(self, action: Any, physics: Any) -> None:
        self.count += 1
        super().before_step(action, physics)

    def get_reward(self, physics: Any) -> Any:
        return float(self.count)


class OddPhysics(mujoco.Physics):
    """A physics that keeps the sum of what it measured."""

    total = 0.0

    def measured(self) -> float:
        self.total += float(self.data.qvel[0])
        return self.total


class Measuring(Pole):
    """Its physics remembers."""

    def get_reward(self, physics: Any) -> Any:
        return physics.measured()


class Constrained(Pole):
    """Ends with discount 0 where the pole is too fast, and raises where it is far too low."""

    def get_termination(self, physics: Any) -> Any:
        return 0.0 if abs(float(physics.data.qvel[0])) > 0.9 else None

    def get_reward(self, physics: Any) -> Any:
        return float(abs(physics.data.qvel[0]) < 0.5)


def environment(
    task: type[Pole] = Pole,
    seed: int = 0,
    kind: type[control.Environment] = control.Environment,
    physics: type[mujoco.Physics] = mujoco.Physics,
    **kwargs: Any,
) -> Any:
    """An environment of a class, with episodes of `STEPS` control steps."""
    kwargs = {"time_limit": _LIMIT, "n_sub_steps": 2, **kwargs}
    return kind(physics.from_xml_string(POLE), task(random=seed), **kwargs)


class Delaying(control.Environment):
    """A subclass that delays observations by two steps, through `step` and `reset`."""

    def reset(self) -> dm_env.TimeStep:
        time_step = super().reset()
        self.waiting = collections.deque([time_step.observation] * 3, maxlen=3)
        return time_step

    def step(self, action: Any) -> dm_env.TimeStep:
        time_step = super().step(action)
        if time_step.first():
            return time_step
        self.waiting.append(time_step.observation)
        return time_step._replace(observation=self.waiting[0])


class ModelWriting(control.Environment):
    """A subclass whose `reset` draws a mass from the task's stream."""

    def reset(self) -> dm_env.TimeStep:
        self.physics.model.body_mass[1] = self.task.random.uniform(0.1, 2.0)
        return super().reset()


class Logging(control.Environment):
    """A subclass that logs its rewards, and counts resets in `__init__`'s attribute."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.log: list[float | None] = []
        self.resets = 0

    def reset(self) -> dm_env.TimeStep:
        self.resets += 1
        self.log.append(None)
        return super().reset()

    def step(self, action: Any) -> dm_env.TimeStep:
        time_step = super().step(action)
        self.log.append(time_step.reward)
        if time_step.first():
            return time_step
        return time_step._replace(reward=time_step.reward + len(self.log) + 100 * self.resets)


class Distracting(control.Environment):
    """The form of Distracting Control: wraps another one, without `super().__init__`."""

    def __init__(self, env: Any, seed: int) -> None:
        self._env = env
        self._random_state = np.random.RandomState(seed)
        self._colour = np.zeros(4)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or "_env" not in vars(self):
            raise AttributeError(name)
        return getattr(self._env, name)

    def reset(self) -> dm_env.TimeStep:
        time_step = self._env.reset()
        self._colour = self._random_state.uniform(size=4)
        return self._changed(time_step)

    def step(self, action: Any) -> dm_env.TimeStep:
        time_step = self._env.step(action)
        if time_step.first():
            return self.reset()
        self._colour = self._colour + self._random_state.normal(scale=0.1, size=4)
        return self._changed(time_step)

    def _changed(self, time_step: dm_env.TimeStep) -> dm_env.TimeStep:
        self._env.physics.model.geom_rgba[0] = np.clip(self._colour, 0, 1)
        observation = {**time_step.observation, "colour": self._colour.copy()}
        return time_step._replace(observation=observation)

    def observation_spec(self) -> Any:
        return {**self._env.observation_spec(), "colour": specs.Array((4,), float, name="colour")}

    def action_spec(self) -> Any:
        return self._env.action_spec()


class Repeating(dm_env.Environment):
    """A wrapper that repeats actions, and keeps what it had."""

    def __init__(self, env: Any, repeats: int = 2) -> None:
        self._env = env
        self._repeats = repeats
        self._returned = 0.0

    def reset(self) -> dm_env.TimeStep:
        self._returned = 0.0
        return self._env.reset()

    def step(self, action: Any) -> dm_env.TimeStep:
        time_step = self._env.step(action)
        if time_step.first():
            return time_step
        reward = time_step.reward
        for _ in range(self._repeats - 1):
            if time_step.last():
                break
            time_step = self._env.step(action)
            reward += time_step.reward
        self._returned += reward
        return time_step._replace(reward=reward + self._returned)

    def observation_spec(self) -> Any:
        return self._env.observation_spec()

    def action_spec(self) -> Any:
        return self._env.action_spec()


class Joined(Repeating):
    """A wrapper that joins the observations into one array without a name."""

    def reset(self) -> dm_env.TimeStep:
        return self._joined(super().reset())

    def step(self, action: Any) -> dm_env.TimeStep:
        return self._joined(super().step(action))

    def observation_spec(self) -> Any:
        return specs.Array((2,), float, name="joined")

    def _joined(self, time_step: dm_env.TimeStep) -> dm_env.TimeStep:
        joined = np.concatenate([*time_step.observation.values()])
        return time_step._replace(observation=joined)


class Catch(dm_env.Environment):
    """Not a `control.Environment` at all: a walk on a line, with flat observations."""

    def __init__(self, seed: int) -> None:
        self._stream = np.random.RandomState(seed)
        self._has_ended = True
        self._place, self._steps = 0.0, 0

    def reset(self) -> dm_env.TimeStep:
        self._has_ended = False
        self._place, self._steps = self._stream.uniform(-1, 1), 0
        return dm_env.restart(self._seen())

    def step(self, action: Any) -> dm_env.TimeStep:
        if self._has_ended:
            return self.reset()
        self._steps += 1
        self._place += float(action[0]) + self._stream.normal(scale=0.1)
        reward = -abs(self._place)
        if abs(self._place) > 2:
            self._has_ended = True
            return dm_env.termination(reward, self._seen())
        if self._steps == STEPS:
            self._has_ended = True
            return dm_env.truncation(reward, self._seen())
        return dm_env.transition(reward, self._seen(), discount=0.99)

    def _seen(self) -> np.ndarray:
        return np.array([self._place, self._steps], np.float32)

    def observation_spec(self) -> Any:
        return specs.Array((2,), np.float32, name="line")

    def action_spec(self) -> Any:
        return specs.BoundedArray((1,), np.float64, -1.0, 1.0, name="move")


def of_task(task: type[Pole], seed: int) -> Any:
    """A plain environment with a task of a class."""
    return environment(task, seed)


def of_class(kind: type[control.Environment], seed: int) -> Any:
    """An environment of a subclass with a plain task."""
    return environment(Pole, seed, kind)


def measuring(seed: int) -> Any:
    """An environment whose physics remembers."""
    return environment(Measuring, seed, physics=OddPhysics)


def distracting(seed: int) -> Any:
    """An environment that wraps another and has a stream of its own."""
    return Distracting(environment(LastAction, seed), seed)


def repeating(seed: int) -> Any:
    """A wrapper of a plain environment whose task remembers."""
    return Repeating(environment(Queues, seed))


def nested(seed: int) -> Any:
    """A wrapper around a wrapper around a subclass."""
    return Repeating(Repeating(environment(Counting, seed, Delaying)), 1)


def scaled(seed: int) -> Any:
    """The suite's wrapper of actions around a task that remembers."""
    return action_scale.Wrapper(environment(LastAction, seed), minimum=-2.0, maximum=3.0)


def noisy_actions(seed: int) -> Any:
    """The suite's wrapper that draws noise from the task's stream."""
    return action_noise.Wrapper(environment(Pole, seed), scale=0.1)


def randomized(seed: int) -> Any:
    """Randomisation, with a task that remembers."""
    draw = functools.partial(_drawn_mass)
    return environment(LastAction, seed, randomize={"body_mass": draw})


def _drawn_mass(random: Any, value: Any) -> Any:
    return value * random.uniform(0.5, 1.5, size=value.shape)


def shifting(seed: int) -> Any:
    """Environments that differ in more than their seed: a model is compiled for each one."""
    mass = f'<joint name="hinge" axis="0 1 0" damping="0.{1 + seed % 7}"/>'
    xml = POLE.replace('<joint name="hinge" axis="0 1 0" damping="0.1"/>', mass)
    physics = mujoco.Physics.from_xml_string(xml)
    return control.Environment(physics, LastAction(random=seed), time_limit=_LIMIT, n_sub_steps=2)


def joined(seed: int) -> Any:
    """Observations in one array."""
    return Joined(of_task(Pole, seed), repeats=1)


def flat(seed: int) -> Any:
    """Joined observations of a task that remembers."""
    return environment(Queues, seed, flat_observation=True)


_TASKS: dict[str, type[Pole]] = {
    "a plain task": Pole,
    "no observations": Blind,
    "a last action": LastAction,
    "a kept array": KeepsTheCallersArray,
    "a counter": Counting,
    "queues": Queues,
    "noise": Noisy,
    "a perturbed model": Perturbed,
    "a potential": Potential,
    "a curriculum": Curriculum,
    "slots": Slotted,
    "constraints": Constrained,
}
_CLASSES: dict[str, type[control.Environment]] = {
    "delayed observations": Delaying,
    "a reset that writes the model": ModelWriting,
    "a log": Logging,
}
# Functions of a seed, by what is odd about their environments.
KINDS: dict[str, Callable[[int], Any]] = {
    **{name: functools.partial(of_task, task) for name, task in _TASKS.items()},
    **{name: functools.partial(of_class, kind) for name, kind in _CLASSES.items()},
    "a physics that remembers": measuring,
    "a distracting wrapper": distracting,
    "repeated actions": repeating,
    "nested wrappers": nested,
    "scaled actions": scaled,
    "noisy actions": noisy_actions,
    "randomisation": randomized,
    "a model for each seed": shifting,
    "flat observations": flat,
    "a walk on a line": Catch,
}
# Kinds of which an instance cannot be given another seed, or copied.
FROM_BUILD_ONLY = ("a distracting wrapper", "a walk on a line", "a model for each seed")

Facts = tuple[int, float, float, dict[str, bytes]]  # of a time step


def actions_of(count: int, rows: int, shape: tuple[int, ...] = (1,), seed: int = 0) -> np.ndarray:
    """Random actions, (count, rows, *shape)."""
    return np.random.RandomState(seed).uniform(-1, 1, (count, rows, *shape))


def facts(time_step: dm_env.TimeStep, row: int | None = None) -> Facts:
    """The contents of a time step, to be compared; of one row, or of a single environment."""
    step_type, reward, discount, observation = time_step
    if not isinstance(observation, dict):
        observation = {"observations": observation}
    if row is not None:
        step_type, reward, discount = step_type[row], reward[row], discount[row]
        observation = {name: value[row] for name, value in observation.items()}
    is_first = int(step_type) == int(dm_env.StepType.FIRST)
    return (
        int(step_type),
        0.0 if is_first else float(reward),
        1.0 if is_first else float(discount),
        {name: np.asarray(value).tobytes() for name, value in observation.items()},
    )


def steps_of(env: Any, actions: np.ndarray) -> Iterator[Facts]:
    """Steps a single environment."""
    for action in actions:
        yield facts(env.step(action.copy()))


def future(batch: Any, actions: np.ndarray) -> list[list[Facts]]:
    """The time steps of each row for actions of (T, rows, ...): a list a step, of rows."""
    seen = []
    for action in actions:
        time_step = batch.step(action)
        seen.append([facts(time_step, row) for row in range(batch.num_envs)])
    return seen
