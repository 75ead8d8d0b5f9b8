"""Tasks as researchers write them: row i of any batch equals the single environment of its seed.

Each was once wrong in silence, in a vectorised batch or in rows.
"""

import collections
import dataclasses
import enum
import functools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from limberjack import gym
from limberjack.evaluation import evaluate
from limberjack.mujoco import Physics
from limberjack.rl import batch_of, builds, control
from limberjack.rl.builds import Build

from . import odd_environments as odd

_WITH_USERDATA = odd.POLE.replace("<asset>", '<size nuserdata="3"/><asset>', 1)


@dataclasses.dataclass
class _Goal:
    angle: float


class _Side(enum.Enum):
    LEFT = -1.0
    RIGHT = 1.0


def _drawn(seed: int | None) -> float:
    return float(np.random.RandomState(seed).uniform(-2, 2))


class _Kept(odd.Pole):
    """Keeps a number that its seed draws, in an object of some kind."""

    keep: Callable[[float], object] = _Goal
    angle: Callable[[Any], Any] = staticmethod(lambda goal: goal.angle)

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.goal = type(self).keep(_drawn(random))

    def get_reward(self, physics: Any) -> Any:
        return np.cos(physics.data.qpos[..., 0] - type(self).angle(self.goal))


class _InANamespace(_Kept):
    keep = staticmethod(lambda angle: SimpleNamespace(angle=angle))


class _InAPartial(_Kept):
    keep = staticmethod(lambda angle: functools.partial(np.add, angle))
    angle = staticmethod(lambda goal: goal(0.0))


class _InAClosure(_Kept):
    keep = staticmethod(lambda angle: lambda: angle)
    angle = staticmethod(lambda goal: goal())


class _InASet(_Kept):
    keep = staticmethod(lambda angle: {angle})
    angle = staticmethod(lambda goal: next(iter(goal)))


class _AsAMember(_Kept):
    keep = staticmethod(lambda angle: _Side.LEFT if angle < 0 else _Side.RIGHT)
    angle = staticmethod(lambda goal: goal.value)


class _InThePhysics(odd.Pole):
    def get_reward(self, physics: Any) -> Any:
        return np.cos(physics.data.qpos[..., 0] - physics.goal)


def _with_a_goal_in_its_physics(seed: int) -> Any:
    env = odd.environment(_InThePhysics, seed)
    env.physics.goal = _drawn(seed)
    return env


class _WithAStream(odd.Pole):
    """Noise from a stream of its own, which has the seed."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.own = np.random.default_rng(random)

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(np.asarray(action) + 0.1 * self.own.standard_normal())


class _Noise:
    def __init__(self, stream: np.random.RandomState) -> None:
        self.stream = stream


class _WithNoise(odd.Pole):
    """Noise from the task's stream, which another object keeps."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.noise = _Noise(self.random)

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(np.asarray(action) + 0.1 * self.noise.stream.standard_normal())


class _Reached(odd.Pole):
    """A goal that is seldom reached, measured for one simulation."""

    def get_reward(self, physics: Any) -> float:
        return float(np.linalg.norm(physics.data.qpos - 0.3) < 0.1)


class _EndsAtAny(odd.Pole):
    def get_termination(self, physics: Any) -> Any:
        return np.where(np.any(np.abs(physics.data.qvel) > 4.0), 0.0, np.nan)


class _Pushing(Physics):
    """A wall that pushes the pole back, which it seldom reaches."""

    def step(self, nstep: int = 1) -> None:
        self.data.qfrc_applied[...] = -np.sign(self.data.qpos) * (np.abs(self.data.qpos) > 1.2)
        super().step(nstep)


class _OfItsEnvironment(odd.Pole):
    def get_reward(self, physics: Any) -> float:
        return float(self.env._step_count)  # pyright: ignore[reportAttributeAccessIssue]


def _with_a_way_back(seed: int) -> Any:
    env = odd.environment(_OfItsEnvironment, seed)
    env.task.env = env
    return env


class _InTurn(odd.Pole):
    """Weights from an iterator, which each reward takes further."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.weights = iter([1.0, 2.0, 3.0] * 200)

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) * next(self.weights)


class _InABuffer(odd.Pole):
    """A counter in a buffer of bytes."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.count = bytearray(1)

    def get_reward(self, physics: Any) -> Any:
        self.count[0] = (self.count[0] + 1) % 7
        return super().get_reward(physics) * self.count[0]


def _of(task: type[odd.Pole], seed: int, **kwargs: Any) -> Any:
    return odd.environment(task, seed, **kwargs)


def _counting(seed: int) -> Any:
    steps = 0

    class Counting(odd.Pole):
        def get_reward(self, physics: Any) -> float:
            nonlocal steps
            steps += 1
            return float(steps)

    return odd.environment(Counting, seed)


# What makes an environment with a seed, and whether its task may be vectorised.
_TASKS: dict[str, tuple[Callable[[int], Any], bool]] = {
    **{
        task.__name__: (functools.partial(_of, task), False)
        for task in (
            *(_Kept, _InANamespace, _InAPartial, _InAClosure, _InASet, _AsAMember),
            *(_WithAStream, _WithNoise, _Reached, _EndsAtAny, _InTurn, _InABuffer),
        )
    },
    "a goal in the physics": (_with_a_goal_in_its_physics, False),
    "a step of the physics": (functools.partial(_of, odd.Pole, physics=_Pushing), False),
    "its environment": (_with_a_way_back, False),
    "a closure": (_counting, False),
}


def _bits(value: Any) -> bytes:
    return np.asarray(value, float).tobytes()


def _assert_same(told: Any, singles: list[Any], where: str) -> None:
    for row, single in enumerate(singles):
        assert told.step_type[row] == int(single.step_type), where
        if not single.first():
            assert _bits(told.reward[row]) == _bits(single.reward), where
        for name, value in single.observation.items():
            assert _bits(told.observation[name][row]) == _bits(value), f"{where}, {name}"


def _play(batch: Any, makers: Callable[[int], Any], steps: int = 60) -> None:
    """Plays in lockstep, with a row that begins again in between, and twice with given seeds."""
    actions = np.random.RandomState(1).uniform(-1, 1, (steps, 3, 1))
    for seeds in ([0, 1, 2], [7, 8, 9]):
        singles = [makers(seed) for seed in seeds]
        _assert_same(batch.reset(seeds=seeds), [one.reset() for one in singles], "reset")
        for step, given in enumerate(actions):
            told = batch.step(given)
            now = [one.step(action) for one, action in zip(singles, given, strict=True)]
            _assert_same(told, now, f"step {step}")
            if step % 17 == 5:
                told, now[1] = batch.reset([1]), singles[1].reset()
                for name, value in now[1].observation.items():
                    assert _bits(told.observation[name][1]) == _bits(value), f"reset, {step}"


@pytest.mark.parametrize("name", _TASKS)
def test_rows_of_a_batch_are_the_single_environments(name: str) -> None:
    make, is_vectorised = _TASKS[name]
    batch = batch_of(make, 3, 1, seed=0)
    assert (batch.why_rows is None) == is_vectorised
    _play(batch, make)


@pytest.mark.parametrize("name", [n for n in _TASKS if n not in ("_WithNoise", "a closure")])
def test_an_environment_that_is_reset_with_a_seed_is_a_new_one(name: str) -> None:
    make, _ = _TASKS[name]
    env, other = gym.Env(Build.of(make)), gym.Env(Build.of(make))
    env.reset(seed=3)
    for _ in range(4):
        env.step(np.ones(1))
    for given in (env, other):
        given.reset(seed=9)
    single = make(9)
    single.reset()
    for _ in range(5):
        expected = single.step(np.full(1, 0.5))
        for given in (env, other):
            assert _bits(given.step(np.full(1, 0.5))[1]) == _bits(expected.reward)


def test_an_evaluation_has_the_returns_of_the_single_environments() -> None:
    expected = []
    for seed in range(60, 70):
        single = odd.environment(_Kept, seed)
        time_step, total = single.reset(), 0.0
        while not time_step.last():
            time_step = single.step(np.zeros(1))
            total += time_step.reward
        expected.append(total)
    found = evaluate(_kept, policy="zero", seeds=range(60, 70), num_threads=1)
    assert [score.total for score in found.scores["zero"]] == expected


def _kept(seed: int) -> Any:
    return odd.environment(_Kept, seed)


def test_seeds_of_streams_that_a_task_shares_with_others_are_those_of_a_new_environment() -> None:
    env, new = odd.environment(_WithNoise, 3), odd.environment(_WithNoise, 7)
    env.reset()
    env.step(np.zeros(1))
    env.reseed(7)
    for one in (env, new):
        one.reset()
    for _ in range(5):
        steps = [one.step(np.zeros(1)) for one in (env, new)]
        assert _bits(steps[0].reward) == _bits(steps[1].reward)


def test_a_task_that_knows_its_environment_knows_it_after_a_restore() -> None:
    env = _with_a_way_back(0)
    env.reset()
    snapshot = env.snapshot()
    for _ in range(2):
        env.restore(snapshot)
        assert env.task.env is env
        assert [env.step(np.zeros(1)).reward for _ in range(3)] == [0.0, 1.0, 2.0]


def test_a_class_that_keeps_a_count_is_not_copied() -> None:
    env = _counting(0)
    for use in (env.snapshot, lambda: batch_of(env, 2, 1, seed=0)):
        with pytest.raises(TypeError, match="assigns to variables of"):
            use()


# What hooks write into the simulation belongs to the rows for which they count.


class _Shaping(odd.Pole):
    """Rewards the change of a potential, which the state of the simulation keeps."""

    def get_reward(self, physics: Any) -> Any:
        now = np.cos(physics.data.qpos[..., 0])
        change = now - physics.data.userdata[..., 0]
        physics.data.userdata[..., 0] = now
        return change


class _Averaging(odd.Pole):
    def get_observation(self, physics: Any) -> Any:
        mean = (physics.data.userdata[..., 1] + physics.data.qpos[..., 0]) / 2
        physics.data.userdata[..., 1] = mean
        return collections.OrderedDict(position=physics.position().copy(), mean=mean.copy())


class _Patient(odd.Pole):
    """Ends after three bad steps."""

    def get_termination(self, physics: Any) -> Any:
        physics.data.userdata[..., 2] += np.abs(physics.data.qvel[..., 0]) > 1.0
        return np.where(physics.data.userdata[..., 2] > 2, 0.0, np.nan)


class _Acting(odd.Pole):
    def before_step(self, action: Any, physics: Any) -> None:
        physics.data.userdata[..., 0] += 1.0
        super().before_step(action, physics)

    def after_step(self, physics: Any) -> None:
        physics.data.userdata[..., 1] += 1.0

    def get_reward(self, physics: Any) -> Any:
        return physics.data.userdata[..., 0] + 10 * physics.data.userdata[..., 1]


def _with_userdata(task: type[odd.Pole], seed: int, repeat: int = 1) -> Any:
    physics = Physics.from_xml_string(_WITH_USERDATA)
    how: dict[str, Any] = {"time_limit": odd.STEPS * 0.02, "n_sub_steps": 2}
    return control.Environment(physics, task(random=seed), action_repeat=repeat, **how)


@pytest.mark.parametrize("repeat", [1, 2, 3])
@pytest.mark.parametrize("task", [_Shaping, _Averaging, _Patient, _Acting])
def test_what_hooks_write_into_the_simulation_is_that_of_their_row(task: Any, repeat: int) -> None:
    make = functools.partial(_with_userdata, task, repeat=repeat)
    batch = batch_of(make, 3, 1, seed=0)
    assert batch.why_rows is None
    _play(batch, make)


def test_a_look_at_the_observation_leaves_no_trace_in_the_simulation() -> None:
    env, twin = (_with_userdata(_Averaging, 0) for _ in range(2))
    for one in (env, twin):
        one.reset()
    env.observation_spec()
    env.present_observation()
    for _ in range(3):
        steps = [one.step(np.zeros(1)) for one in (env, twin)]
        assert _bits(steps[0].observation["mean"]) == _bits(steps[1].observation["mean"])


def test_what_a_function_draws_for_a_seed_makes_it_unstable() -> None:
    for task, is_stable in ((odd.Pole, True), (_Kept, False), (_WithAStream, False)):
        assert builds.is_stable(Build.of(functools.partial(_of, task)), 3) is is_stable
