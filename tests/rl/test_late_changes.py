"""Hooks of a step that set state or model: equal to single environments, or refused in time."""

import copy
import functools
import logging
from typing import Any

import numpy as np
import pytest

from limberjack import rl
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batch_contract import Batch
from limberjack.rl.batch_errors import NotVectorised
from limberjack.rl.batches import batch_of
from limberjack.suite import common, walker

from . import odd_environments as odd

_LATE = 0.2  # seconds; after the check at creation
_STEPS = 24  # of 25 ms


class _Changing(walker.PlanarWalker):
    """Changes something in a hook of a step, from a time on."""

    hook, moment, calls_forward, calls_forward_first = "before_step", _LATE, False, False

    def change(self, physics: Any, is_late: Any) -> None:
        raise NotImplementedError

    def _change(self, hook: str, physics: Any) -> None:
        if hook == self.hook:
            if self.calls_forward_first:
                physics.forward()
            self.change(physics, np.asarray(physics.data.time) > self.moment)
            if self.calls_forward:
                physics.forward()

    def before_step(self, action: Any, physics: Any) -> None:
        self._change("before_step", physics)
        super().before_step(action, physics)

    def after_step(self, physics: Any) -> None:
        super().after_step(physics)
        self._change("after_step", physics)

    def get_reward(self, physics: Any) -> Any:
        reward = super().get_reward(physics)
        self._change("get_reward", physics)
        return reward


class Lighter(_Changing):
    """Loses most of its torso."""

    EPISODE_FIELDS = ("body_mass",)

    def initialize_episode(self, physics: Any) -> None:
        physics.named.model.body_mass["torso"] = 10.0
        super().initialize_episode(physics)

    def change(self, physics: Any, is_late: Any) -> None:
        physics.named.model.body_mass["torso"] = np.where(is_late, 2.0, 10.0)


class Pushed(_Changing):
    """Gets faster and faster."""

    def change(self, physics: Any, is_late: Any) -> None:
        physics.data.qvel[..., 0] += np.where(is_late, 0.5, 0.0)


class Target(_Changing):
    """Has a target on the floor that moves, which nothing can touch."""

    EPISODE_FIELDS = ("site_pos",)

    def initialize_episode(self, physics: Any) -> None:
        physics.named.model.site_pos["target"] = (1.0, 0.0, 0.0)
        super().initialize_episode(physics)

    def get_observation(self, physics: Any) -> Any:
        observation = super().get_observation(physics)
        observation["target"] = physics.named.data.site_xpos["target"].copy()
        return observation

    def change(self, physics: Any, is_late: Any) -> None:
        moved = np.where(is_late, np.asarray(physics.data.time), 1.0)
        physics.named.model.site_pos["target", "x"] = moved


class Weaker(_Changing):
    """Has weaker motors, whose gain belongs to the second half of a time step."""

    EPISODE_FIELDS = ("actuator_gainprm",)

    def initialize_episode(self, physics: Any) -> None:
        physics.model.actuator_gainprm[..., 0] = 1.0
        super().initialize_episode(physics)

    def change(self, physics: Any, is_late: Any) -> None:
        gain = np.where(is_late, 0.5, 1.0)
        physics.model.actuator_gainprm[..., 0] = gain[..., None]


_XML = common.read_model("walker.xml").replace(
    b"<worldbody>", b'<worldbody><site name="target" size="0.05"/>'
)


def _build(task: type[_Changing], legacy_step: bool = True, **how: object) -> Any:
    changing = type(task.__name__, (task,), how)

    def make(seed: int) -> control.Environment:
        physics = walker.Physics.from_xml_string(_XML, common.ASSETS)
        made = changing(move_speed=1, random=seed)
        return control.Environment(
            physics, made, time_limit=0.4, control_timestep=0.025, legacy_step=legacy_step
        )

    return make


def _compared(batch: Batch, make: Any, repeat: int = 1) -> None:
    """Plays a batch of seeds from 0 on beside single environments."""
    singles = [make(row) for row in range(batch.num_envs)]
    for single in singles:
        control.set_action_repeat(single, repeat)
    batch.reset()
    for single in singles:
        single.reset()
    random = np.random.RandomState(0)
    for _ in range(_STEPS // repeat):
        actions = random.uniform(-1, 1, (batch.num_envs, 6))
        found = batch.step(actions)
        for row, single in enumerate(singles):
            alone = single.step(actions[row])
            for name, value in alone.observation.items():
                np.testing.assert_array_equal(found.observation[name][row], value)
            assert found.reward[row] == (alone.reward or 0.0)


@pytest.mark.parametrize("hook", ["before_step", "after_step", "get_reward"])
@pytest.mark.parametrize("task", [Lighter, Pushed])
def test_a_late_change_is_refused_as_it_happens_and_not_afterwards(task: Any, hook: str) -> None:
    make = _build(task, hook=hook)
    batch = rl.batch_of(make, 3, seed=0)
    assert batch.why_rows is None
    with pytest.raises(NotVectorised, match=rf"task {task.__name__} sets .* in a step"):
        _compared(batch, make)


@pytest.mark.parametrize("hook", ["before_step", "after_step"])
def test_a_change_after_forward_is_late_too(hook: str) -> None:
    make = _build(Pushed, hook=hook, calls_forward_first=True)
    with pytest.raises(NotVectorised, match=r"task Pushed sets data.qvel in a step"):
        _compared(rl.batch_of(make, 3, seed=0), make)


def test_what_is_read_for_the_first_time_hides_no_change() -> None:
    class Reading(Pushed):
        def change(self, physics: Any, is_late: Any) -> None:
            super().change(physics, is_late)
            if is_late.any():
                assert physics.data.cvel.shape[0] == 300

    batch = rl.batch_of(_build(Reading, hook="after_step"), 300, seed=0)
    with pytest.raises(NotVectorised, match=r"task Reading sets data.qvel in a step"):
        _play(batch)


@pytest.mark.parametrize("repeat", [1, 3])
@pytest.mark.parametrize("hook", ["before_step", "after_step", "get_reward"])
@pytest.mark.parametrize("task", [Lighter, Pushed])
def test_after_forward_rows_are_single_environments(task: Any, hook: str, repeat: int) -> None:
    make = _build(task, hook=hook, calls_forward=True)
    batch = rl.batch_of(make, 3, seed=0, action_repeat=repeat)
    assert batch.why_rows is None
    _compared(batch, make, repeat)


@pytest.mark.parametrize("task", [Lighter, Pushed])
def test_an_early_change_makes_a_batch_of_rows_that_says_what_to_do(task: Any) -> None:
    make = _build(task, moment=0.03)
    batch = rl.batch_of(make, 3, seed=0)
    assert batch.why_rows is not None
    assert "call physics.forward() after setting it" in batch.why_rows
    _compared(batch, make)


@pytest.mark.parametrize("hook", ["before_step", "after_step"])
@pytest.mark.parametrize("task", [Target, Weaker])
def test_what_changes_no_first_half_is_vectorised(task: Any, hook: str) -> None:
    for moment in (0.03, _LATE):
        make = _build(task, hook=hook, moment=moment)
        batch = rl.batch_of(make, 3, seed=0)
        assert batch.why_rows is None
        _compared(batch, make)


def test_comparing_many_rows_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    make = _build(Target, moment=0.3)
    batch = rl.batch_of(make, 12, seed=0)
    with caplog.at_level(logging.WARNING, logger="limberjack"):
        _compared(batch, make)
    said = [one.getMessage() for one in caplog.records]
    assert len(said) == 1
    assert "task Target sets state or model in a step without physics.forward()" in said[0]


def test_what_a_user_sets_between_steps_is_not_the_tasks() -> None:
    single = _build(Pushed, moment=np.inf)(0)
    batch = BatchEnvironment.from_environment(single, 3, 1, seed=0)
    batch.reset()
    for _ in range(3):
        batch.physics.data.qvel[1] = 0.1
        assert batch.step(np.zeros((3, 6))).reward.shape == (3,)


def test_a_copy_of_a_batch_refuses_late_changes_too() -> None:
    make = _build(Pushed)
    batch = BatchEnvironment.from_environment(make(0), 2, 1, seed=0)
    batch.reset()
    copied = copy.deepcopy(batch)
    with pytest.raises(NotVectorised, match=r"task Pushed sets data.qvel in a step"):
        _play(copied)


def _play(batch: Batch) -> None:
    for _ in range(_STEPS):
        batch.step(np.zeros((batch.num_envs, 6)))


def test_where_time_steps_are_whole_nothing_is_late() -> None:
    make = _build(Pushed, legacy_step=False)
    batch = rl.batch_of(make, 3, seed=0)
    assert batch.why_rows is None
    _compared(batch, make)


class _Heavier(odd.Pole):
    """Gets heavier in an episode, and says so to MuJoCo."""

    EPISODE_FIELDS = ("body_mass",)

    def after_step(self, physics: Any) -> None:
        physics.model.body_mass[..., 1] = 1 + physics.data.time
        physics.forward()


def test_rows_that_begin_while_others_run_leave_what_was_computed_for_those() -> None:
    build = functools.partial(odd.of_task, _Heavier)
    batch, singles = batch_of(build, 3, seed=0), [build(row) for row in range(3)]
    assert isinstance(batch, BatchEnvironment)
    batch.reset()
    for single in singles:
        single.reset()
    for step in range(4 * odd.STEPS):
        found = batch.step(np.ones((3, 1))).observation["velocity"].ravel()
        expected = [one.step(np.ones(1)).observation["velocity"][0] for one in singles]
        assert found.tolist() == expected
        if step % 4 == 1:
            batch.reset([step % 3])
            singles[step % 3].reset()
