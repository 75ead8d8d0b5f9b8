"""Copies of environments: independent and exact, or refused with the attribute's name."""

import functools
import random
import threading
import types
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control, copies
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batches import batch_of
from limberjack.suite.wrappers import _delegating

from . import odd_environments as odd


class _Everything(odd.Repeating):
    """A wrapper that delegates all names, as many programs write it."""

    def __getattr__(self, name: str) -> Any:
        if name == "_env":
            raise AttributeError(name)
        return getattr(self._env, name)


class _Slotted(_delegating.Wrapper):
    __slots__ = ("factor",)

    def step(self, action: Any) -> Any:
        time_step = super().step(action)
        return time_step._replace(reward=(time_step.reward or 0.0) * self.factor)


class _Reduced(_Everything):
    """Keeps a lock, and leaves it out of its state."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.lock = threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.lock = threading.Lock()


def _everything(seed: int) -> Any:
    return _Everything(odd.environment(odd.LastAction, seed))


def _slotted(seed: int) -> Any:
    env = _Slotted(odd.environment(odd.LastAction, seed))
    env.factor = 3.0
    return env


def _reduced(seed: int) -> Any:
    return _Reduced(odd.environment(odd.Queues, seed))


_WRAPPERS = {
    "all names": _everything,
    "two wrappers": lambda seed: _Everything(_everything(seed)),
    "slots": _slotted,
    "a state of its own": _reduced,
}


@pytest.mark.parametrize("kind", [*odd.KINDS, *_WRAPPERS])
def test_a_copy_continues_as_the_original_and_neither_changes_the_other(kind: str) -> None:
    build = {**odd.KINDS, **_WRAPPERS}[kind]
    actions = odd.actions_of(20, 1)[:, 0]
    expected = list(odd.steps_of(build(5), actions))
    env = build(5)
    assert list(odd.steps_of(env, actions[:4])) == expected[:4]
    twin = copies.copied(env)
    assert type(twin) is type(env)
    another = copies.copied(twin)
    assert list(odd.steps_of(twin, actions[4:])) == expected[4:]
    assert list(odd.steps_of(env, actions[4:])) == expected[4:]
    assert list(odd.steps_of(another, actions[4:])) == expected[4:]


# Environments that are patched as programs patch them, whose copies would use the original.
_PATCHES: dict[str, Callable[[Any], None]] = {}


def _patch(function: Callable[[Any], None]) -> Callable[[Any], None]:
    _PATCHES[function.__name__.removeprefix("_").replace("_", " ")] = function
    return function


@_patch
def _a_closure(env: Any) -> None:
    old = env.step
    env.step = lambda action: old(action)


@_patch
def _an_inner_closure(env: Any) -> None:
    old = env.step

    def step(action: Any) -> Any:
        def inner() -> Any:
            return old(action)

        return inner()

    env.step = step


@_patch
def _a_default(env: Any) -> None:
    env.step = lambda action, old=env.step: old(action)


@_patch
def _a_keyword(env: Any) -> None:
    def step(action: Any, *, old: Any = env.step) -> Any:
        return old(action)

    env.step = step


@_patch
def _a_partial(env: Any) -> None:
    env.step = functools.partial(type(env).step, env)


@_patch
def _a_wrapped_function(env: Any) -> None:
    old = env.step
    env.step = functools.wraps(old)(lambda action: old(action))


_GLOBAL: list[Any] = []


@_patch
def _a_global(env: Any) -> None:
    _GLOBAL[:] = [env]
    env.step = lambda action: type(_GLOBAL[0]).step(_GLOBAL[0], action)


@_patch
def _a_hook_of_the_task(env: Any) -> None:
    old = env.task.get_reward
    env.task.get_reward = lambda physics: 2 * old(physics)


@_patch
def _a_hook_with_the_physics(env: Any) -> None:
    inner = env.physics
    env.task.get_reward = lambda physics: float(inner.data.qvel[0])


@_patch
def _a_hook_with_the_stream(env: Any) -> None:
    random = env.task.random
    env.task.get_reward = lambda physics: random.normal()


@_patch
def _a_method_of_the_physics(env: Any) -> None:
    old = env.physics.position
    env.physics.position = lambda: 2 * old()


@_patch
def _live_memory_in_a_closure(env: Any) -> None:
    qpos = env.physics.data.qpos
    env.task.get_reward = lambda physics: float(qpos[0])


@_patch
def _live_memory(env: Any) -> None:
    env.task.qpos = env.physics.data.qpos


@_patch
def _a_slice_of_live_memory(env: Any) -> None:
    env.task.held = {"velocity": [env.physics.data.qvel[:1]]}


@_patch
def _an_indexer(env: Any) -> None:
    env.task.qpos = env.physics.named.data.qpos


@_patch
def _the_model(env: Any) -> None:
    env.task.model = env.physics.model


@_patch
def _a_counter_in_a_list(env: Any) -> None:
    count = [0]

    def get_reward(physics: Any) -> float:
        count[0] += 1
        return float(count[0])

    env.task.get_reward = get_reward


@_patch
def _a_list_that_grows(env: Any) -> None:
    seen: list[float] = []

    def get_reward(physics: Any) -> float:
        seen.append(1.0)
        return float(len(seen))

    env.task.get_reward = get_reward


@_patch
def _a_nonlocal_counter(env: Any) -> None:
    count = 0

    def get_reward(physics: Any) -> float:
        nonlocal count
        count += 1
        return float(count)

    env.task.get_reward = get_reward


@_patch
def _a_buffer(env: Any) -> None:
    buffer = np.zeros(1)

    def get_reward(physics: Any) -> float:
        buffer[:] += 1
        return float(buffer[0])

    env.task.get_reward = get_reward


@_patch
def _an_attribute_of_a_function(env: Any) -> None:
    def get_reward(physics: Any) -> float:
        get_reward.count += 1  # pyright: ignore[reportFunctionMemberAccess]
        return float(get_reward.count)  # pyright: ignore[reportFunctionMemberAccess]

    get_reward.count = 0  # pyright: ignore[reportFunctionMemberAccess]
    env.task.get_reward = get_reward


@_patch
def _a_method_of_a_list(env: Any) -> None:
    env.task.note = [].append


@_patch
def _a_function_in_a_dict(env: Any) -> None:
    env.task.hooks = {"a": ({1: lambda: env},)}


@_patch
def _a_map(env: Any) -> None:
    env.task.rewards = map(lambda _: env.task, range(9))  # noqa: C417 (a map is meant)


@_patch
def _a_cached_function(env: Any) -> None:
    env.task.look = functools.lru_cache(lambda: env.physics)


@_patch
def _a_weak_reference(env: Any) -> None:
    env.task.physics = weakref.ref(env.physics)


@_patch
def _an_object_of_a_local_class(env: Any) -> None:
    class Caller:
        def __call__(self, action: Any) -> Any:
            return type(env).step(env, action)

    env.step = Caller()


@_patch
def _a_local_class(env: Any) -> None:
    class Held:
        of = env

    env.task.held = Held


@pytest.mark.parametrize("patch", _PATCHES)
def test_an_instance_whose_copies_would_use_the_original_is_refused_by_name(patch: str) -> None:
    env = odd.environment(odd.LastAction, 0)
    _PATCHES[patch](env)
    with pytest.raises(TypeError, match=r"attribute (step|_task\.\w+|_physics\.\w+)") as refused:
        copies.check_copies(env)
    assert "build(seed)" in str(refused.value)


# Functions that keep nothing but their own environment, to which a snapshot is restored.
_EXACT = (
    "a hook of the task",
    "a hook with the physics",
    "a hook with the stream",
    "a method of the physics",
    "a local class",
)


@pytest.mark.parametrize("patch", _PATCHES)
def test_a_snapshot_of_a_patched_environment_is_exact_or_refused(patch: str) -> None:
    env = odd.environment(odd.LastAction, 0)
    _PATCHES[patch](env)
    actions = odd.actions_of(9, 1)[:, 0]
    env.reset()
    if patch not in _EXACT:
        with pytest.raises(TypeError, match="attribute"):
            env.snapshot()
        return
    snapshot = env.snapshot()
    expected = list(odd.steps_of(env, actions))
    env.restore(snapshot)
    assert list(odd.steps_of(env, actions)) == expected


def test_harmless_functions_are_no_reason_to_refuse() -> None:
    target, names = np.ones(1), ("a", "b")
    env = odd.environment(odd.LastAction, 0)
    env.task.distance = lambda physics: float(target[0]) * len(names)
    env.task.weigh = functools.partial(np.clip, a_min=0.0, a_max=1.0)
    env.task.step_again = types.MethodType(lambda task: task.last, env.task)
    env.task.draw = env.task.random.normal
    env.task.physics = env.physics
    copies.check_copies(env)
    twin = copies.copied(env)
    assert twin.task.step_again.__self__ is twin.task
    assert twin.task.draw.__self__ is twin.task.random
    assert twin.task.physics is twin.physics


def test_a_randomisation_may_enclose_its_settings() -> None:
    settings = {"low": 0.5}
    draw = {"body_mass": lambda random, value: value * random.uniform(settings["low"], 1)}
    copies.check_copies(odd.environment(odd.LastAction, 0, randomize=draw))


@pytest.mark.parametrize(
    "held", [np.random.RandomState(0), np.random.default_rng(0), random.Random(0)]
)
def test_another_stream_is_refused_for_other_seeds_but_not_for_snapshots(held: Any) -> None:
    env = odd.environment(odd.LastAction, 0)
    env.task.held = [held]
    with pytest.raises(TypeError, match=r"_task\.held is a random stream other than the task's"):
        copies.check_copies(env)
    copies.check_copies(env, are_seeded=False)


@pytest.mark.parametrize("held", [threading.Lock(), (number for number in range(3))])
def test_what_cannot_be_copied_is_refused_by_name(held: Any) -> None:
    env = odd.environment(odd.LastAction, 0)
    env.task.held = held
    with pytest.raises(TypeError, match=r"task\.held.*cannot be copied"):
        copies.check_copies(env)
    with pytest.raises(TypeError, match="held"):
        env.snapshot()


def test_a_method_that_is_replaced_later_is_noticed() -> None:
    class Kept(control.Environment):
        def more(self) -> None: ...

    env = suite.load("cartpole", "swingup", {"random": 0})
    kept = Kept(env.physics, env.task, time_limit=1.0)
    assert copies.difference(kept) is None
    Kept.step = lambda self, action: self.reset()
    assert copies.difference(kept) == "its class Kept overrides step"


def test_the_check_leaves_a_shared_model_shared() -> None:
    env = suite.load("cartpole", "swingup")
    env.task.__class__ = type("Own", (type(env.task),), {})  # so that it is checked
    copies.check_copies(env)
    copies.check_copies(env, is_vectorised=True)
    BatchEnvironment.from_environment(env, 2, 1).close()
    rows = batch_of(env, 2, 1, vectorised=False)
    for one in (env, *rows.environments):  # pyright: ignore[reportAttributeAccessIssue]
        assert one.physics.model._shared is not None
