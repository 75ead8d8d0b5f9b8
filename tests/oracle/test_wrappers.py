"""The wrappers for pixels, scaled actions and noisy actions give dm_control's results."""

import functools
import itertools
from typing import Any

import numpy as np
import pytest

from . import twins
from .oracle import BOTH, needs_rendering
from .same import assert_same_outcome, assert_same_pair

pytestmark = pytest.mark.oracle

_TASKS = [("humanoid", "stand"), ("manipulator", "insert_ball"), ("stacker", "stack_2")]
some_tasks = pytest.mark.parametrize(("domain", "task"), _TASKS)


def _wrapped(domain: str, task: str, wrapper: str, **kwargs: Any) -> twins.Twins:
    loaded = twins.load(domain, task)
    envs = [
        package(f"suite.wrappers.{wrapper}").Wrapper(env, **kwargs)
        for package, env in zip(BOTH, (loaded.ours, loaded.theirs), strict=True)
    ]
    return twins.Twins(*envs, where=f"{loaded.where}, {wrapper} {kwargs}")


def _assert_same_specs(env: twins.Twins) -> None:
    for spec in ("action_spec", "observation_spec"):
        ours, theirs = (getattr(one, spec)() for one in (env.ours, env.theirs))
        assert type(ours) is type(theirs)
        assert repr(ours) == repr(theirs)


@some_tasks
@pytest.mark.parametrize("scale", [0.0, 0.01, 1.5])
def test_noise_is_drawn_from_the_tasks_own_stream(domain: str, task: str, scale: float) -> None:
    env = _wrapped(domain, task, "action_noise", scale=scale)
    _assert_same_specs(env)
    for _ in range(2):
        env.reset()
        env.play(itertools.islice(env.actions("random", 1), 30))
        env.assert_same_physics("data.ctrl")


@some_tasks
@pytest.mark.parametrize(("minimum", "maximum"), [(-2, 3), (0.0, 1.0), (np.float32(-1), 255)])
def test_scaled_actions_are_the_same(
    domain: str, task: str, minimum: float, maximum: float
) -> None:
    env = _wrapped(domain, task, "action_scale", minimum=minimum, maximum=maximum)
    _assert_same_specs(env)
    env.reset()
    env.play(itertools.islice(env.actions("random", 2), 30))
    env.assert_same_physics("data.ctrl")


@needs_rendering
@some_tasks
def test_pixel_observations_are_the_same(domain: str, task: str) -> None:
    pixels_only = domain == "humanoid"  # which does not depend on the task
    size = {"height": 48, "width": 64, "camera_id": 0}
    env = _wrapped(domain, task, "pixels", pixels_only=pixels_only, render_kwargs=size)
    try:
        _assert_same_specs(env)
        env.reset()
        env.play(itertools.islice(env.actions("random", 3), 5))
    finally:
        for one in (env.ours, env.theirs):
            one.physics.free()


@needs_rendering
def test_an_observation_named_twice_is_refused_alike() -> None:
    env = twins.load("humanoid", "stand")
    kwargs = {"pixels_only": False, "observation_key": "velocity"}
    calls = [
        functools.partial(package("suite.wrappers.pixels").Wrapper, one, **kwargs)
        for package, one in zip(BOTH, (env.ours, env.theirs), strict=True)
    ]
    assert assert_same_outcome(calls, "pixels named velocity") is not None


@some_tasks
def test_wrappers_of_wrappers_delegate_alike(domain: str, task: str) -> None:
    env = _wrapped(domain, task, "action_scale", minimum=-3, maximum=3)
    envs = [
        package("suite.wrappers.action_noise").Wrapper(one, scale=0.1)
        for package, one in zip(BOTH, (env.ours, env.theirs), strict=True)
    ]
    twice = twins.Twins(*envs, where=f"{env.where}, noise")
    _assert_same_specs(twice)
    twice.reset()
    twice.play(itertools.islice(twice.actions("bang-bang", 4), 30))
    assert_same_pair((one.control_timestep() for one in envs), "control_timestep")
    assert_same_pair((one.task.random.random_sample() for one in envs), "next draw")
