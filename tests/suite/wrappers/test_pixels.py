"""Tests of limberjack.suite.wrappers.pixels."""

import collections
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs

from limberjack import suite
from limberjack.suite.wrappers import pixels

_SIZE = {"height": 40, "width": 60}


class ArrayEnvironment(dm_env.Environment):
    """Observes one array, and draws a picture with the number of previous pictures."""

    def __init__(self, spec: Any = None) -> None:
        self.physics = self
        self.spec = spec or specs.Array((2,), float)
        self.pictures = 0
        self.is_closed = False

    def render(self, value: int = 0) -> np.ndarray:
        self.pictures += 1
        return np.full((4, 5, 3), self.pictures + value, np.uint8)

    def reset(self) -> dm_env.TimeStep:
        return dm_env.restart(np.zeros(2))

    def step(self, action: Any) -> dm_env.TimeStep:
        return dm_env.transition(reward=1.5, observation=np.ones(2))

    def action_spec(self) -> Any:
        return specs.Array((1,), float)

    def observation_spec(self) -> Any:
        return self.spec

    def close(self) -> None:
        self.is_closed = True


def _humanoid() -> Any:
    return suite.load("humanoid", "stand", task_kwargs={"random": 1})


@pytest.mark.parametrize("pixels_only", [True, False])
@pytest.mark.parametrize("kind", [{}, {"depth": True}, {"segmentation": True}])
def test_observations_have_the_picture_that_physics_renders(
    pixels_only: bool, kind: dict[str, Any]
) -> None:
    env = _humanoid()
    state = list(env.observation_spec())
    wrapped = pixels.Wrapper(
        env, pixels_only=pixels_only, render_kwargs=_SIZE | kind, observation_key="seen"
    )
    spec = wrapped.observation_spec()
    assert type(spec) is collections.OrderedDict
    assert list(spec) == ([] if pixels_only else state) + ["seen"]
    assert spec["seen"].name == "seen"
    for move in (wrapped.reset, lambda: wrapped.step(np.zeros(21))):
        time_step = move()
        assert list(time_step.observation) == list(spec)
        for name, observation in time_step.observation.items():
            spec[name].validate(observation)
        np.testing.assert_array_equal(
            time_step.observation["seen"], env.physics.render(**_SIZE, **kind)
        )


@pytest.mark.oracle
@pytest.mark.parametrize("pixels_only", [True, False])
def test_an_episode_looks_as_in_dm_control(pixels_only: bool) -> None:
    oracle: Any = pytest.importorskip("tests.oracle.oracle")
    kwargs: dict[str, Any] = {"pixels_only": pixels_only, "render_kwargs": _SIZE}
    ours = pixels.Wrapper(_humanoid(), **kwargs)
    theirs = oracle.theirs("suite.wrappers.pixels").Wrapper(
        oracle.theirs("suite").load("humanoid", "stand", task_kwargs={"random": 1}), **kwargs
    )
    assert repr(ours.observation_spec()) == repr(theirs.observation_spec())
    random = np.random.RandomState(0)
    ours.reset(), theirs.reset()
    for _ in range(6):
        action = random.uniform(-1, 1, 21)
        one, other = ours.step(action), theirs.step(action)
        assert one[:3] == other[:3]
        assert list(one.observation) == list(other.observation)
        for name in one.observation:
            np.testing.assert_array_equal(one.observation[name], other.observation[name])


def test_a_subclass_may_change_the_picture_where_dm_controls_may() -> None:
    class Gray(pixels.Wrapper):
        def _add_pixel_observation(self, time_step: Any) -> Any:
            seen = super()._add_pixel_observation(time_step)
            seen.observation["pixels"] = seen.observation["pixels"].mean(-1)
            return seen

    wrapped = Gray(_humanoid(), render_kwargs=_SIZE)
    for time_step in (wrapped.reset(), wrapped.step(np.zeros(21))):
        assert time_step.observation["pixels"].shape == (_SIZE["height"], _SIZE["width"])


@pytest.mark.parametrize("pixels_only", [True, False])
def test_an_array_becomes_the_state_beside_the_picture(pixels_only: bool) -> None:
    env = ArrayEnvironment()
    wrapped = pixels.Wrapper(env, pixels_only=pixels_only, render_kwargs={"value": 10})
    names = ["pixels"] if pixels_only else [pixels.STATE_KEY, "pixels"]
    assert list(wrapped.observation_spec()) == names
    assert wrapped.observation_spec()["pixels"].shape == (4, 5, 3)
    time_step = wrapped.step([0.0])
    assert list(time_step.observation) == names
    assert (time_step.observation["pixels"] == env.pictures + 10).all()
    assert time_step.reward == 1.5


def test_pictures_of_earlier_steps_do_not_change() -> None:
    wrapped = pixels.Wrapper(_humanoid(), render_kwargs=_SIZE)
    seen = [wrapped.reset()] + [wrapped.step(np.ones(21)) for _ in range(3)]
    copies = [time_step.observation["pixels"].copy() for time_step in seen]
    wrapped.reset()
    for time_step, copy in zip(seen, copies, strict=True):
        np.testing.assert_array_equal(time_step.observation["pixels"], copy)
    assert len({copy.tobytes() for copy in copies}) == len(copies)


def test_the_wrapped_environment_is_reached_and_closed() -> None:
    env = ArrayEnvironment()
    wrapped = pixels.Wrapper(env)
    assert wrapped.action_spec() == env.action_spec()
    assert wrapped.pictures == 1
    wrapped.close()
    assert env.is_closed
    with pytest.raises(AttributeError):
        _ = wrapped.no_such_name


def test_the_callers_arguments_are_copied() -> None:
    arguments: dict[str, Any] = dict(_SIZE)
    wrapped = pixels.Wrapper(_humanoid(), render_kwargs=arguments)
    arguments["height"] = 10
    assert wrapped.reset().observation["pixels"].shape == (40, 60, 3)


def test_a_name_that_is_taken_is_refused() -> None:
    with pytest.raises(ValueError, match="'velocity' is taken"):
        pixels.Wrapper(_humanoid(), pixels_only=False, observation_key="velocity")
    with pytest.raises(ValueError, match="'state' is taken"):
        pixels.Wrapper(ArrayEnvironment(), pixels_only=False, observation_key="state")
    only = pixels.Wrapper(_humanoid(), render_kwargs=_SIZE, observation_key="velocity")
    assert list(only.observation_spec()) == ["velocity"]


@pytest.mark.parametrize("spec", [(1, 2), [specs.Array((2,), float)], "array"])
def test_observations_of_another_kind_are_refused(spec: Any) -> None:
    with pytest.raises(ValueError, match=type(spec).__name__):
        pixels.Wrapper(ArrayEnvironment(spec))
