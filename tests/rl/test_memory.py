"""Memory of tasks and physics: what is kept, put back and left alone."""

import collections
import copy
import functools
import pickle
import threading
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import memory, references
from limberjack.suite import base, pendulum

from . import odd_environments as odd


@pytest.mark.parametrize("kind", odd.KINDS)
def test_the_specs_and_a_second_look_leave_the_memory_and_the_stream(kind: str) -> None:
    build, actions = odd.KINDS[kind], odd.actions_of(2 * odd.STEPS, 1)[:, 0]
    env, expected = build(2), list(odd.steps_of(build(2), actions))
    for action, facts in zip(actions, expected, strict=True):
        env.observation_spec()
        env.action_spec()
        assert next(odd.steps_of(env, action[None])) == facts


class _Held(odd.Pole):
    """Holds what cannot be copied, and a list that others hold too."""

    def __init__(self, random: Any, log: list[float]) -> None:
        super().__init__(random=random)
        self.lock = threading.Lock()
        self.log = log

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        with self.lock:
            self.log.append(float(physics.data.time))
        return super().get_observation(physics)


def test_the_specs_of_a_task_that_cannot_be_copied_are_found_and_its_list_stays_the_same() -> None:
    log: list[float] = []
    env = odd.environment(functools.partial(_Held, log=log))  # pyright: ignore[reportArgumentType]
    env.reset()
    assert log == [0.0]
    env.observation_spec()
    assert log == [0.0]
    env.step([0.0])
    assert log == [0.0, 0.02]
    assert env.task.log is log


class _Underflowing(odd.Pole):
    """Counts its rewards, and underflows in them."""

    count = 0

    def get_reward(self, physics: Any) -> Any:
        self.count += 1
        return float(np.float64(1e-300) * np.float64(1e-300)) + self.count


def test_a_reward_is_computed_once_a_step_even_if_it_underflows() -> None:
    env = odd.environment(_Underflowing)
    env.reset()
    with np.errstate(under="raise"):
        rewards = [env.step([0.0]).reward for _ in range(3)]
    assert rewards == [1.0, 2.0, 3.0]


def test_colours_of_rewards_leave_the_memory_and_the_stream() -> None:
    for kind in (odd.Potential, odd.Noisy, _Underflowing):
        plain, coloured = odd.environment(kind), odd.environment(kind)
        coloured.task.visualize_reward = True
        actions = odd.actions_of(10, 1)[:, 0]
        assert list(odd.steps_of(coloured, actions)) == list(odd.steps_of(plain, actions))


@pytest.mark.parametrize("steps", [0, 3, odd.STEPS + 1])
@pytest.mark.parametrize("kind", odd.KINDS)
def test_copies_pickles_and_snapshots_of_single_environments_go_on(kind: str, steps: int) -> None:
    build, actions = odd.KINDS[kind], odd.actions_of(14, 1)[:, 0]
    env = build(4)
    list(odd.steps_of(env, actions[:steps]))
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    if hasattr(env, "snapshot") and kind not in ("a perturbed model", "a model for each seed"):
        twins += [build(9)]  # of another seed, and in the middle of an episode
        list(odd.steps_of(twins[-1], actions[:3]))
        twins[-1].restore(pickle.loads(pickle.dumps(env.snapshot())))
    expected = list(odd.steps_of(env, actions[steps:]))
    for twin in twins:
        assert type(twin) is type(env)
        assert list(odd.steps_of(twin, actions[steps:])) == expected


def test_a_snapshot_of_an_edited_model_is_refused_with_the_field() -> None:
    env = odd.KINDS["a perturbed model"](0)
    snapshot = env.snapshot()
    env.reset()
    before = env.physics.get_state()
    with pytest.raises(ValueError, match="body_mass"):
        env.restore(snapshot)
    np.testing.assert_array_equal(env.physics.get_state(), before)


def test_what_was_remembered_is_put_back_and_stays_apart() -> None:
    env = odd.KINDS["queues"](0)
    task, physics = env.task, env.physics
    env.reset()
    env.step([0.5])
    kept = memory.remembered(task, physics)
    task.means["number"] = 100
    task.delayed.append(np.ones(1))
    task.more = 1
    for _ in range(2):
        memory.put_back(kept, task, physics)
        assert task.means["number"] == 2
        assert len(task.delayed) == 1
        assert not hasattr(task, "more")
        task.means["number"] = 7  # which must not reach what is kept


def test_what_attributes_share_stays_shared_and_owners_stay_themselves() -> None:
    env = odd.environment(odd.Slotted)
    task, physics = env.task, env.physics
    task.one = task.other = [1]
    task.physics, task.itself = physics, task
    kept = memory.remembered(task, physics)
    task.one.append(2)
    memory.put_back(kept, task, physics)
    assert task.one == [1]
    assert task.one is task.other
    assert task.physics is physics
    assert task.itself is task
    assert task.count == 0
    assert not hasattr(task, "unset")


def test_functions_that_use_their_task_stay_with_it() -> None:
    envs = [odd.environment(odd.LastAction, seed) for seed in range(2)]
    for env in envs:
        _double(env.task)
    actions = odd.actions_of(8, 1)[:, 0]
    list(odd.steps_of(envs[0], actions[:2]))
    envs[1].restore(envs[0].snapshot())
    expected = list(odd.steps_of(envs[0], actions[2:]))
    assert list(odd.steps_of(envs[1], actions[2:])) == expected


def _double(task: Any) -> None:
    old = task.get_reward
    task.get_reward = lambda physics: 2 * old(physics)


def test_what_a_snapshot_would_lose_is_refused_by_name() -> None:
    count = [0]
    for name, held in (
        ("get_reward", lambda physics: float(count.append(1) or len(count))),
        ("lock", threading.Lock()),
        ("numbers", (number for number in range(3))),
        ("note", count.append),
    ):
        env = odd.environment(odd.LastAction)
        setattr(env.task, name, held)
        with pytest.raises(TypeError, match=f"attribute '{name}' of task LastAction"):
            env.snapshot()
    env = odd.environment(odd.LastAction)
    env.task.qpos = [env.physics.data.qpos]
    with pytest.raises(TypeError, match="attribute 'qpos' of task LastAction shows the memory"):
        env.snapshot()


def test_the_suites_own_tasks_remember_nothing() -> None:
    for domain, name in (("humanoid", "walk"), ("stacker", "stack_2"), ("lqr", "lqr_2_1")):
        env = suite.load(domain, name, {"random": 0})
        assert memory.is_of_the_suite(env.task, env.physics)
        assert memory.remembered(env.task, env.physics) == {}
        env.task.get_reward = functools.partial(env.task.get_reward)
        assert not memory.is_of_the_suite(env.task, env.physics)


def test_attributes_are_found_in_slots_and_cached_properties_are_not() -> None:
    class Held(_Slots):
        @functools.cached_property
        def slow(self) -> int:
            return 1

    held = Held()
    held.number, held.own = 1, 2
    assert held.slow == 1
    assert references.attributes_of(held) == {"own": 2, "number": 1}


class _Slots:
    __slots__ = ("__dict__", "number", "unset")
    number: int
    own: int


@pytest.mark.parametrize("cls", [base.Task, pendulum.SwingUp])
def test_a_task_of_the_suite_with_a_function_of_a_user_is_not_the_suites(
    monkeypatch: pytest.MonkeyPatch, cls: type
) -> None:
    env = suite.load("pendulum", "swingup")
    assert memory.is_of_the_suite(env.task, env.physics)
    after_step = cls.after_step  # pyright: ignore[reportAttributeAccessIssue]

    def remembering(self: Any, physics: Any) -> None:
        self.last = physics.data.time
        after_step(self, physics)

    monkeypatch.setattr(cls, "after_step", remembering)
    memory._unchanged.clear()  # as in a program that replaces it before it loads anything
    assert not memory.is_of_the_suite(env.task, env.physics)
    monkeypatch.undo()
    assert memory.is_of_the_suite(env.task, env.physics)
    env.task.after_step = remembering
    assert not memory.is_of_the_suite(env.task, env.physics)


class _Holding(odd.Pole):
    """Keeps its simulation, a method of it and its stream under other names."""

    def __init__(self, physics: Any, random: Any = None) -> None:
        super().__init__(random=random)
        self.physics, self.speed, self.stream = physics, physics.velocity, self._random
        self.named = physics.named

    def get_reward(self, physics: Any) -> Any:
        return float(self.speed()[0] + self.physics.position()[0])


def _holding(seed: int) -> Any:
    env = odd.environment(odd.Pole, seed)
    env._task = _Holding(env.physics, random=seed)
    return env


@pytest.mark.parametrize("is_pickled", [False, True])
def test_what_a_task_keeps_of_its_environment_is_that_of_the_one_that_is_restored(
    is_pickled: bool,
) -> None:
    one, other = _holding(0), _holding(1)
    one.reset(), other.reset(), one.step([1.0])
    del other.physics.named, other.task.named  # as before their first use
    snapshot = one.snapshot()
    other.restore(pickle.loads(pickle.dumps(snapshot)) if is_pickled else snapshot)
    for _ in range(3):
        assert one.step([1.0]).reward == other.step([1.0]).reward
    assert other.task.physics is other.physics
    assert other.task.stream is other.task.random
    assert other.task.named is other.physics.named
    assert one.task.physics is one.physics


class _Visiting(odd.Pole):
    @functools.cached_property
    def visited(self) -> list[int]:
        return []

    @functools.cached_property
    def hinge(self) -> Any:
        return self.data.qpos

    def initialize_episode(self, physics: Any) -> None:
        self.data = physics.data
        self.visited.append(1)
        self.hinge[0] = 0.1 * len(self.visited)


def test_what_cached_properties_keep_is_remembered_unless_it_shows_the_simulation() -> None:
    env = odd.environment(_Visiting, 0)
    env.reset()
    snapshot = env.snapshot()
    starts = [env.reset().observation["position"][0] for _ in range(3)]
    env.restore(snapshot)
    assert [env.reset().observation["position"][0] for _ in range(3)] == starts
