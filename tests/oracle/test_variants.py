"""Every way to configure, reset and seed an environment gives the same results as dm_control.

Starts, specs and actions are compared for all tasks. Options belong to the environment, not to the
task, so they are compared for tasks that between them have every feature; the rest of the product
is slow, and part of `make test-exactness`.
"""

import functools
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from tests.representatives import FEATURES

from . import twins
from .oracle import BOTH
from .same import assert_same, assert_same_outcome, assert_same_pair

pytestmark = [pytest.mark.oracle, pytest.mark.usefixtures("compiled_once")]

_VARIED = set(FEATURES.values())


# The first task of the model of each varied task.
_VARIED_MODELS = {twins.MODEL_OF[task] for task in _VARIED}

every_task = pytest.mark.parametrize(("domain", "task"), twins.TASKS)
every_model = pytest.mark.parametrize(("domain", "task"), twins.MODELS)
varied_task = pytest.mark.parametrize(("domain", "task"), twins.or_slow(twins.TASKS, _VARIED))
varied_model = pytest.mark.parametrize(
    ("domain", "task"), twins.or_slow(twins.MODELS, _VARIED_MODELS)
)
partly_observable = pytest.mark.parametrize(
    ("domain", "task"), [task for task in twins.TASKS if task[0] in ("manipulator", "stacker")]
)

_STEPS = 30
_STARTS = 40
# Fields that a start may change: the state, and what of the model is drawn for each episode.
_START_FIELDS = (
    "data.qpos",
    "data.qvel",
    "data.ctrl",
    "data.qacc_warmstart",
    "data.sensordata",
    "data.time",
    "model.body_pos",
    "model.body_quat",
    "model.dof_damping",
    "model.geom_pos",
    "model.geom_rgba",
    "model.geom_size",
    "model.hfield_data",
    "model.jnt_stiffness",
    "model.light_pos",
    "model.site_pos",
    "model.site_rgba",
    "model.site_size",
    "model.wrap_prm",
)


def _in_turn(tasks: Sequence[tuple[str, str]], values: Sequence[Any]) -> list[tuple[Any, ...]]:
    """Each task with one of the values, in turn."""
    return [(*task, value) for task, value in zip(tasks, itertools.cycle(values), strict=False)]


@functools.lru_cache(maxsize=1)
def _loaded(domain: str, task: str) -> twins.Twins:
    """One environment for the tests that only reset and step it: a task's follow one another."""
    return twins.load(domain, task)


@pytest.fixture(scope="module", autouse=True)
def _unload() -> Iterator[None]:
    yield
    _loaded.cache_clear()


def _play(env: twins.Twins, kind: str = "random", steps: int = _STEPS) -> None:
    env.reset()
    env.play(itertools.islice(env.actions(kind, seed=1), steps))


@partly_observable
def test_partly_observable_episodes_are_the_same(domain: str, task: str) -> None:
    for seed in range(2):
        _play(twins.load(domain, task, seed, task_kwargs={"fully_observable": False}))


@varied_task
def test_flat_observations_are_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task, environment_kwargs={"flat_observation": True})
    _assert_same_specs(env)
    _play(env)


@partly_observable
def test_flat_partly_observable_observations_are_the_same(domain: str, task: str) -> None:
    kwargs = {"fully_observable": False}
    flat = {"flat_observation": True}
    env = twins.load(domain, task, task_kwargs=kwargs, environment_kwargs=flat)
    _assert_same_specs(env)
    _play(env)


@pytest.mark.parametrize(
    ("domain", "task", "n_sub_steps"), twins.or_slow(_in_turn(twins.MODELS, [1, 7]), _VARIED_MODELS)
)
def test_another_number_of_substeps_is_the_same(domain: str, task: str, n_sub_steps: int) -> None:
    # The factories fix the control step, and Environment refuses both: build it around their parts.
    loaded = twins.load(domain, task)
    envs = [
        package("rl.control").Environment(
            env.physics, env.task, n_sub_steps=n_sub_steps, time_limit=0.2
        )
        for package, env in zip(BOTH, (loaded.ours, loaded.theirs), strict=True)
    ]
    env = twins.Twins(*envs, where=f"{loaded.where}, {n_sub_steps} substeps")
    assert_same_pair((twin.control_timestep() for twin in envs), f"{env.where}: control_timestep")
    env.reset()
    env.play(env.actions("random", seed=2))
    env.step(np.zeros(env.theirs.action_spec().shape))


def _is_accepted(call: Callable[[], Any]) -> bool:
    try:
        call()
    except (TypeError, ValueError):
        return False
    return True


@varied_model
@pytest.mark.parametrize("name", ["control_timestep", "n_sub_steps"])
def test_a_control_step_is_accepted_where_the_factory_sets_none(
    domain: str, task: str, name: str
) -> None:
    usual = twins.load(domain, task).theirs.control_timestep()
    kwargs = {name: 3 if name == "n_sub_steps" else 2 * usual}
    calls = [
        functools.partial(package("suite").load, domain, task, {"random": 0}, kwargs)
        for package in BOTH
    ]
    is_accepted = [_is_accepted(call) for call in calls]
    assert is_accepted[0] == is_accepted[1]
    if not is_accepted[0]:
        return
    env = twins.Twins(*(call() for call in calls), where=f"{domain}:{task}, {kwargs}")
    _play(env, steps=20)


@pytest.mark.parametrize(
    ("domain", "task", "time_limit"), twins.or_slow(_in_turn(twins.TASKS, [0.2, 0.33]), _VARIED)
)
def test_another_time_limit_ends_the_episode_at_the_same_step(
    domain: str, task: str, time_limit: float
) -> None:
    env = twins.load(domain, task, task_kwargs={"time_limit": time_limit})
    for _ in range(2):
        env.reset()
        env.play(env.actions("random", seed=3))
        assert env.step_count <= 100, env.where


@pytest.mark.parametrize(("domain", "task"), [("humanoid", "run"), ("stacker", "stack_2")])
def test_an_infinite_time_limit_never_ends_the_episode(domain: str, task: str) -> None:
    env = twins.load(domain, task, task_kwargs={"time_limit": float("inf")})
    _play(env, steps=1100)
    assert env.step_count == 1100


@varied_task
def test_a_random_state_is_used_directly(domain: str, task: str) -> None:
    streams = [np.random.RandomState(11) for _ in BOTH]
    envs = [
        package("suite").load(domain, task, task_kwargs={"random": stream})
        for package, stream in zip(BOTH, streams, strict=True)
    ]
    env = twins.Twins(*envs, where=f"{domain}:{task}, RandomState(11)")
    for _ in range(3):
        _play(env, steps=5)
    for twin, stream in zip(envs, streams, strict=True):
        assert twin.task.random is stream
    # Not one draw more or less than dm_control's.
    assert_same_pair((stream.random_sample() for stream in streams), f"{env.where}: next draw")


@varied_model
def test_a_random_state_assigned_to_the_task_is_used_at_the_next_reset(
    domain: str, task: str
) -> None:
    env = twins.load(domain, task)
    for seed in (4, 5):
        for twin in (env.ours, env.theirs):
            twin.task._random = np.random.RandomState(seed)
        _play(env, steps=10)
    for twin in (env.ours, env.theirs):
        twin.task.random.seed(6)
    _play(env, steps=10)


@varied_model
def test_stepping_without_up_to_date_fields_is_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task, environment_kwargs={"legacy_step": False})
    _play(env)


@varied_task
def test_reward_colours_are_the_same_after_each_step(domain: str, task: str) -> None:
    env = twins.load(domain, task, visualize_reward=True)
    for _ in range(2):
        env.reset()
        env.assert_same_physics("model.mat_rgba")
        for action in itertools.islice(env.actions("random", seed=7), _STEPS):
            env.step(action)
            env.assert_same_physics("model.mat_rgba")


@varied_model
def test_colours_of_a_full_reward_are_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task, visualize_reward=True)
    env.reset()
    for reward in (-3.0, 0.0, 0.3, 0.9, 1.0, 2.0, np.float64(0.7)):
        for twin in (env.ours, env.theirs):
            twin.task.get_reward = lambda physics, reward=reward: reward
            twin.task.after_step(twin.physics)
        env.assert_same_physics("model.mat_rgba")


@varied_model
def test_a_reset_in_mid_episode_begins_the_same_episode(domain: str, task: str) -> None:
    env = _loaded(domain, task)
    for steps in (0, 1, 7, 30):
        _play(env, kind="bang-bang", steps=steps)
        env.assert_same_physics(*_START_FIELDS)


@varied_model
def test_a_step_before_a_reset_and_after_the_last_step_begins_an_episode(
    domain: str, task: str
) -> None:
    env = twins.load(domain, task, task_kwargs={"time_limit": 0.1})
    zero = np.zeros(env.theirs.action_spec().shape)
    assert env.step(zero).first()
    for _ in range(3):
        env.play(env.actions("random", seed=8))
        assert env.step(zero).first()


@every_task
def test_specs_are_the_same(domain: str, task: str) -> None:
    env = _loaded(domain, task)
    _assert_same_specs(env)
    env.reset()
    _assert_same_specs(env)


@every_model
def test_actions_of_every_kind_that_dm_control_takes_act_the_same(domain: str, task: str) -> None:
    env = _loaded(domain, task)
    env.reset()
    size = env.theirs.action_spec().shape[0]
    action = np.random.RandomState(9).uniform(-1, 1, size)
    kinds: list[Any] = [
        action.astype(np.float32),
        np.sign(action).astype(int),
        action.tolist(),
        tuple(action.tolist()),
        np.repeat(action, 2)[::2],
        3 * action,  # beyond the bounds: MuJoCo clips the control, the reward sees what came
    ]
    for kind in kinds:
        env.step(kind)
        env.assert_same_physics("data.ctrl")


@every_task
def test_many_starts_are_the_same(domain: str, task: str) -> None:
    env = _loaded(domain, task)
    has_terrain = env.ours.physics.model.nhfield > 0  # which is drawn slowly
    for start in range(_STARTS // 5 if has_terrain else _STARTS):
        env.where = f"{domain}:{task}, start {start}"
        env.reset()
        env.assert_same_physics(*_START_FIELDS)


@every_model
def test_a_start_after_steps_forgets_them_as_dm_control_does(domain: str, task: str) -> None:
    env = _loaded(domain, task)
    for start in range(4):
        env.where = f"{domain}:{task}, start {start} after steps"
        _play(env, kind="bang-bang", steps=3)
        env.reset()
        env.assert_same_physics(*_START_FIELDS)


_REFUSED: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
    (("no such domain", "walk"), {}),
    (("humanoid", "no such task"), {}),
    (("humanoid",), {}),
    (("humanoid", "walk"), {"visualize_reward": "yes"}),
    (("humanoid", "walk"), {"task_kwargs": {"no_such_argument": 1}}),
    (("humanoid", "walk"), {"task_kwargs": {"fully_observable": False}}),
    (("humanoid", "walk"), {"task_kwargs": {"random": "a word"}}),
    (("humanoid", "walk"), {"task_kwargs": {"random": -1}}),
    (("stacker", "stack_2"), {"environment_kwargs": {"n_sub_steps": 2}}),
    (("stacker", "stack_2"), {"environment_kwargs": {"control_timestep": 0.02}}),
    (("stacker", "stack_2"), {"environment_kwargs": {"no_such_argument": 1}}),
]


@pytest.mark.parametrize(("arguments", "kwargs"), _REFUSED)
def test_unknown_names_and_keywords_are_refused_alike(
    arguments: tuple[Any, ...], kwargs: dict[str, Any]
) -> None:
    calls = [functools.partial(package("suite").load, *arguments, **kwargs) for package in BOTH]
    assert assert_same_outcome(calls, f"load{arguments}, {kwargs}") is not None


@pytest.mark.parametrize("steps", [(0.2, 0.1), (0.111, 0.111), (0.03, 0.005), (0.1, 0.2), (3, 2)])
def test_the_number_of_substeps_is_the_same(steps: tuple[float, float]) -> None:
    calls = [functools.partial(package("rl.control").compute_n_steps, *steps) for package in BOTH]
    assert_same_outcome(calls, f"compute_n_steps{steps}")


def test_a_step_spec_that_no_task_has_is_refused_alike() -> None:
    env = twins.load("humanoid", "walk")
    error = assert_same_outcome([env.ours.step_spec, env.theirs.step_spec], "step_spec")
    assert isinstance(error, NotImplementedError)


def _assert_same_specs(env: twins.Twins) -> None:
    assert_same_spec(env.ours.action_spec(), env.theirs.action_spec(), f"{env.where}: action")
    our_specs, their_specs = env.ours.observation_spec(), env.theirs.observation_spec()
    assert type(our_specs) is type(their_specs), env.where
    assert list(our_specs) == list(their_specs), env.where
    for name, their_spec in their_specs.items():
        assert_same_spec(our_specs[name], their_spec, f"{env.where}: {name}")


def assert_same_spec(ours: Any, theirs: Any, where: str) -> None:
    """Both specs are of one class, with equal name, shape, dtype, bounds and representation."""
    assert type(ours) is type(theirs), where
    assert repr(ours) == repr(theirs), where
    for field in ("name", "shape", "dtype", "minimum", "maximum"):
        if hasattr(theirs, field):
            assert_same(getattr(ours, field), getattr(theirs, field), f"{where}.{field}")
