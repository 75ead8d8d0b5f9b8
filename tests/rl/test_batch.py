"""BatchEnvironment: checks, divergence, user tasks, threads and processes."""

import collections
import copy
import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.mujoco import batch_simulation
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import base
from limberjack.utils import cores, rewards

_POLE = """
<mujoco model="pole">
  <option timestep="0.01"/>
  <worldbody>
    <body name="pole" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.1"/>
      <geom name="pole" type="capsule" size="0.03" fromto="0 0 0 0 0 0.5"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


class _Pole(base.Task):
    """Holds a pole up; batch-safe."""

    def initialize_episode(self, physics: Any) -> None:
        physics.named.data.qpos["hinge"] = self.random.uniform(-1, 1)

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        height = physics.named.data.xmat["pole", "zz"]
        return collections.OrderedDict(angle=physics.position(), height=np.asarray(height))

    def get_reward(self, physics: Any) -> Any:
        height = physics.named.data.xmat["pole", "zz"]
        return rewards.tolerance(height, (0.9, 1), margin=1, sigmoid="quadratic")

    def get_termination(self, physics: Any) -> Any:
        fallen = physics.named.data.xmat["pole", "zz"] < -0.9
        if np.ndim(fallen):
            return np.where(fallen, 0.0, np.nan)
        return 0.0 if fallen else None


class _Flawed(_Pole):
    def get_observation(self, physics: Any) -> collections.OrderedDict:
        return collections.OrderedDict(pos=physics.named.data.xpos["pole"].reshape(-1)[:3])


class _Mover(_Pole):
    def initialize_episode(self, physics: Any) -> None:
        physics.named.model.body_pos["pole", "z"] = self.random.uniform(1, 2)


def _pole(task_class: type[base.Task] = _Pole, seed: int = 0) -> control.Environment:
    physics = mujoco.Physics.from_xml_string(_POLE)
    return control.Environment(physics, task_class(seed), time_limit=0.5)


def _walkers(num_envs: int = 4, **kwargs: Any) -> BatchEnvironment:
    batch = suite.load_batch("humanoid", "walk", num_envs, 2, 0, **kwargs)
    batch.reset()
    return batch


def _assert_goes_on_like(batch: BatchEnvironment, twin: BatchEnvironment) -> None:
    action = np.full(batch.action_spec().shape, 0.3)
    ours, theirs = batch.step(action), twin.step(action)
    np.testing.assert_array_equal(ours.reward, theirs.reward)
    for name, value in ours.observation.items():
        np.testing.assert_array_equal(value, theirs.observation[name])


def test_a_users_batch_safe_task_is_its_single_environment_in_each_row() -> None:
    batch = BatchEnvironment.from_environment(_pole(), 6, 2, seed=3)
    singles = [_pole(seed=3 + i) for i in range(6)]
    batched, told = batch.reset(), [env.reset() for env in singles]
    lengths = []
    for step in range(200):
        actions = np.random.RandomState(step).uniform(-1, 1, (6, 1))
        batched, told = (
            batch.step(actions),
            [e.step(a) for e, a in zip(singles, actions, strict=True)],
        )
        for row, single in enumerate(told):
            assert batched.step_type[row] == int(single.step_type)
            np.testing.assert_array_equal(
                batched.observation["angle"][row], single.observation["angle"]
            )
            if not single.first():
                assert batched.reward[row] == single.reward
                assert batched.discount[row] == single.discount
            if single.last():
                lengths.append((single.discount, row))
    assert {discount for discount, _ in lengths} == {0.0, 1.0}  # both ends are reached


def test_a_task_that_is_not_batch_safe_is_refused_with_advice() -> None:
    with pytest.raises(
        ValueError, match=r"observation 'pos' of task _Flawed has shape \(3,\) in a"
    ):
        BatchEnvironment.from_environment(_pole(_Flawed), 8, 1)


def test_a_task_that_sets_an_undeclared_model_field_is_refused_with_advice() -> None:
    with pytest.raises(
        ValueError, match=r"_Mover sets body_pos .* EPISODE_FIELDS = \('body_pos',\)"
    ):
        BatchEnvironment.from_environment(_pole(_Mover), 2, 1)


@pytest.mark.parametrize(
    ("actions", "error", "message"),
    [
        (np.zeros((3, 21)), ValueError, r"shape \(3, 21\); expected 4 rows"),
        (np.zeros(21), ValueError, r"shape \(21,\); expected 4 rows"),
        (np.zeros((4, 20)), ValueError, r"shape \(4, 20\); expected \(4, 21\)"),
        (np.zeros((4, 1)), ValueError, r"shape \(4, 1\); expected \(4, 21\)"),
        (0.0, ValueError, r"shape \(\); expected 4 rows"),
        (np.full((4, 21), "a"), TypeError, "expected numbers"),
        (np.full((4, 21), None), TypeError, "expected numbers"),
        (np.where(np.arange(84).reshape(4, 21) == 30, np.nan, 0), ValueError, r"rows \[1\]"),
        (np.where(np.arange(84).reshape(4, 21) >= 70, np.inf, 0), ValueError, r"rows \[3\]"),
    ],
)
def test_bad_actions_are_refused_and_nothing_moves(actions: Any, error: Any, message: str) -> None:
    batch, twin = _walkers(), _walkers()
    with pytest.raises(error, match=message):
        batch.step(actions)
    _assert_goes_on_like(batch, twin)


@pytest.mark.parametrize(
    "ids", [[1, 0], [0, 0], [4], [-1], [[0]], [0.5], ["a"], np.ones(3, bool), 1]
)
def test_bad_ids_are_refused_and_nothing_moves(ids: Any) -> None:
    batch, twin = _walkers(), _walkers()
    for call in (batch.reset, batch.snapshot):
        with pytest.raises(ValueError, match=r"rows are|the mask"):
            call(ids)
    _assert_goes_on_like(batch, twin)


def test_a_row_that_begins_ignores_its_action() -> None:
    batch = _walkers(task_kwargs={"time_limit": 0.05})
    zero = np.zeros(batch.action_spec().shape)
    batch.step(zero)
    assert (batch.step(zero).step_type == 2).all()
    assert (batch.step(zero * np.nan).step_type == 0).all()


@pytest.mark.parametrize(
    ("seed", "error"),
    [(-1, ValueError), (2**32 - 1, ValueError), (1.5, TypeError), (True, TypeError)],
)
def test_seeds_that_rows_cannot_have_are_refused(seed: Any, error: Any) -> None:
    with pytest.raises(error, match=r"seed is .*; expected (a whole number|at most 4294967294)"):
        suite.load_batch("stacker", "stack_2", 2, seed=seed)
    with pytest.raises(error, match=r"seed is .*; expected a whole number"):
        _walkers(2).reset(seeds=[0, 2**32 if seed == 2**32 - 1 else seed])


@pytest.mark.parametrize("kwargs", [{"num_envs": 0}, {"num_envs": 2.0}, {"num_envs": True}])
def test_bad_sizes_are_refused(kwargs: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="num_envs is"):
        BatchEnvironment.from_environment(_pole(), **kwargs)
    with pytest.raises(ValueError, match="num_threads is -1"):
        BatchEnvironment.from_environment(_pole(), 2, -1)
    with pytest.raises(ValueError, match="on_divergence is 'maybe'"):
        BatchEnvironment.from_environment(_pole(), 2, 1, on_divergence="maybe")
    with pytest.raises(TypeError, match="pass seed"):
        suite.load_batch("humanoid", "walk", 2, task_kwargs={"random": 0})


def test_more_rows_than_fit_into_memory_are_refused_at_once() -> None:
    expected = r"num_envs is 1000000000, which takes \d{12,} bytes or more; this machine has \d+$"
    with pytest.raises(MemoryError, match=expected):
        BatchEnvironment.from_environment(_pole(), 10**9)
    with pytest.raises(MemoryError, match=expected):
        suite.load_batch("humanoid", "walk", 10**9)


def test_numpy_may_be_set_to_raise_floating_point_errors() -> None:
    with np.errstate(all="raise"):
        for task in suite.ALL_TASKS:
            env = suite.load(*task, {"random": 0}, visualize_reward=True)
            batch = BatchEnvironment.from_environment(env, 4, 1, seed=0)
            env.reset(), batch.reset()
            for actions in np.random.RandomState(0).uniform(-1, 1, (8, *batch.action_spec().shape)):
                env.step(actions[0]), batch.step(actions)


def test_a_diverging_row_ends_and_is_flagged_and_the_others_do_not_notice(
    caplog: pytest.LogCaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    batch, twin = _walkers(), _walkers()
    batch.physics.data.qvel[2] = 1e12
    action = np.full(batch.action_spec().shape, 0.3)
    with caplog.at_level(logging.WARNING, "limberjack"):
        ours, theirs = batch.step(action), twin.step(action)
    assert "rows [2] diverged" in caplog.text
    assert batch.diverged.tolist() == [False, False, True, False]
    assert ours.step_type.tolist() == [1, 1, 2, 1]
    assert ours.reward[2] == ours.discount[2] == 0
    others = [0, 1, 3]
    for _ in range(3):
        np.testing.assert_array_equal(ours.reward[others], theirs.reward[others])
        for name, value in ours.observation.items():
            np.testing.assert_array_equal(value[others], theirs.observation[name][others])
        ours, theirs = batch.step(action), twin.step(action)
    assert not batch.diverged.any()
    assert ours.step_type[2] == 1  # an episode of its own again
    assert not list(tmp_path.iterdir())  # no MUJOCO_LOG.TXT


def test_a_huge_control_of_one_row_raises_no_floating_point_error() -> None:
    batch, twin = (suite.load_batch("lqr", "lqr_6_2", 3, 1, seed=0) for _ in range(2))
    batch.reset(), twin.reset()
    actions = np.zeros((3, 2))
    actions[1] = 1e300
    with np.errstate(all="raise"):
        found, expected = batch.step(actions), twin.step(np.zeros((3, 2)))
    assert batch.diverged.tolist() == [False, True, False]
    assert found.reward.tolist() == [expected.reward[0], 0.0, expected.reward[2]]
    assert found.discount.tolist() == [1.0, 0.0, 1.0]


def test_divergence_can_be_raised_naming_the_rows() -> None:
    batch = _walkers(on_divergence="raise")
    batch.physics.data.qvel[1] = 1e12
    zero = np.zeros(batch.action_spec().shape)
    with pytest.raises(control.PhysicsError, match=r"rows \[1\] diverged"):
        batch.step(zero)
    assert (batch.step(zero).step_type == 0).all()


def test_a_batch_may_be_closed_twice_and_later_use_raises() -> None:
    batch = _walkers()
    snapshot = batch.snapshot()
    batch.close()
    batch.close()
    uses: list[Callable[[], Any]] = [
        batch.reset,
        batch.snapshot,
        batch.control_timestep,
        batch.observation_spec,
        batch.render,
        lambda: batch.step(0),
        lambda: batch.restore(snapshot),
        lambda: batch.copy_row(0, 1),
        lambda: batch.physics,
        lambda: batch.single,
        lambda: copy.deepcopy(batch),
    ]
    for use in uses:
        with pytest.raises(RuntimeError, match="this batch is closed: create a new one"):
            use()


def test_use_from_two_threads_at_once_is_refused() -> None:
    batch = _walkers(256)
    action = np.zeros(batch.action_spec().shape)
    errors: list[BaseException] = []

    def step() -> None:
        try:
            for _ in range(20):
                batch.step(action)
        except RuntimeError as error:
            errors.append(error)

    threads = [threading.Thread(target=step) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors
    assert all("two threads at once" in str(error) for error in errors)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
@pytest.mark.parametrize("a_few", [0, 1_000])  # rows that share an `MjData`, or do not
def test_a_forked_child_has_the_same_future_and_exits_with_status_0(
    a_few: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_simulation, "_A_FEW", a_few)
    batch = suite.load_batch("manipulator", "insert_peg", 6, 2, 0)
    batch.reset()
    actions = np.random.RandomState(0).uniform(-1, 1, (20, *batch.action_spec().shape))
    batch.step(actions[0])
    untouched = _walkers()  # only dropped there
    pid = os.fork()
    if pid == 0:
        status = 1
        try:
            np.save(tmp_path / "acceleration.npy", batch.physics.data.qacc)  # nobody has asked yet
            velocities = np.stack([batch.step(a).observation["arm_vel"] for a in actions])
            np.save(tmp_path / "velocities.npy", velocities)
            del untouched
            status = 0
        finally:
            os._exit(status)
    acceleration = batch.physics.data.qacc.copy()
    velocities = np.stack([batch.step(a).observation["arm_vel"] for a in actions])
    assert os.waitpid(pid, 0)[1] == 0
    for name, here in (("acceleration", acceleration), ("velocities", velocities)):
        np.testing.assert_array_equal(np.load(tmp_path / f"{name}.npy"), here, name)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_child_that_is_forked_in_mid_step_can_use_the_batch() -> None:
    batch = _walkers()
    within, forked = threading.Event(), threading.Event()
    batch.task.after_step = lambda physics: (within.set(), forked.wait(60))
    action = np.zeros(batch.action_spec().shape)
    stepping = threading.Thread(target=batch.step, args=[action])
    stepping.start()
    assert within.wait(60)
    pid = os.fork()
    if pid == 0:
        status = 1
        try:
            del batch.task.after_step
            batch.reset()
            status = 0 if (batch.step(action).step_type == 1).all() else 2
        finally:
            os._exit(status)
    forked.set()
    stepping.join()
    assert os.waitpid(pid, 0)[1] == 0


def test_a_row_can_begin_the_first_episode_of_any_seed() -> None:
    batch, other = _walkers(4), _walkers(2)
    other.reset(seeds=[7, 1])
    batch.reset([1, 3], seeds=[7, None])
    action = np.zeros(batch.action_spec().shape)
    ours, theirs = batch.step(action), other.step(action[:2])
    for name, value in ours.observation.items():
        np.testing.assert_array_equal(value[1], theirs.observation[name][0])
    for seeds, message in (([1], "there are 1 seeds; expected 4"), ([0, 1, 2, -1], "seed is -1")):
        state = batch.physics.data.state.copy()
        with pytest.raises(ValueError, match=message):
            batch.reset(seeds=seeds)
        np.testing.assert_array_equal(batch.physics.data.state, state)


def test_rows_that_begin_next_and_rows_that_timed_out_are_reported() -> None:
    batch = suite.load_batch("humanoid", "walk", 4, 2, 0, task_kwargs={"time_limit": 0.05})
    assert batch.control_timestep() == 0.025
    action = np.zeros(batch.action_spec().shape)
    assert batch.begins.all()
    assert not batch.timed_out.any()
    batch.reset()
    batch.step(action)
    batch.reset([2])
    batch.physics.data.qvel[1] = 1e12
    batch.step(action)
    assert batch.begins.tolist() == [True, True, False, True]
    assert batch.timed_out.tolist() == [True, False, False, True]


def test_rows_that_begin_an_episode_have_no_reward_and_the_others_keep_theirs() -> None:
    batch = BatchEnvironment.from_environment(_pole(), 3, 1, seed=0)
    zero = np.zeros((3, 1))
    assert batch.reset().reward.tolist() == [0, 0, 0]
    assert (batch.step(zero).reward > 0).all()
    batch.physics.data.qpos[1] = np.pi  # fallen: the row's episode ends
    assert batch.step(zero).step_type.tolist() == [1, 2, 1]
    step = batch.step(zero)
    assert step.step_type.tolist() == [1, 0, 1]
    assert step.reward[1] == 0
    assert batch.task.get_reward(batch.physics)[1] > 0  # what the task would give at its start
    assert (step.reward[[0, 2]] > 0).all()
    assert batch.reset([2]).reward.tolist() == [0, 0, 0]


def test_data_fields_can_be_set_and_only_known_ones() -> None:
    batch = _walkers()
    batch.physics.data.ctrl = 0.25
    assert (batch.physics.control() == 0.25).all()
    assert batch.physics.state().shape == (4, 28 + 27)
    with pytest.raises(AttributeError, match="qvle"):
        batch.physics.data.qvle = 0


def test_a_state_that_was_set_is_stepped_from_as_after_forward() -> None:
    batch = _walkers()
    env = suite.load("humanoid", "walk", {"random": 1})
    env.reset()
    zero = np.zeros(batch.action_spec().shape)
    batch.step(zero)
    env.step(zero[1])
    batch.physics.data.qpos[1, 8] += 0.1
    env.physics.data.qpos[8] += 0.1
    env.physics.forward()
    expected = env.step(zero[1]).observation
    for name, value in batch.step(zero).observation.items():
        np.testing.assert_array_equal(value[1], expected[name])
    batch.physics.forward()
    env.physics.forward()
    for name in ("qacc", "actuator_force", "sensordata", "xpos"):
        expected = getattr(env.physics.data, name)
        np.testing.assert_array_equal(getattr(batch.physics.data, name)[1], expected, name)


def test_after_an_interrupted_step_every_row_begins_an_episode() -> None:
    batch = _walkers()

    def interrupt(physics: Any) -> None:
        raise KeyboardInterrupt

    zero = np.zeros(batch.action_spec().shape)
    batch.task.after_step = interrupt
    with pytest.raises(KeyboardInterrupt):
        batch.step(zero)
    del batch.task.after_step
    assert (batch.step(zero).step_type == 0).all()
    assert (batch.step(zero).step_type == 1).all()


def test_after_an_interrupted_reset_its_rows_begin_an_episode() -> None:
    batch = _walkers()
    num_envs, start, calls = batch.num_envs, batch.task.initialize_episode, []
    zero = np.zeros(batch.action_spec().shape)
    batch.step(zero)

    def interrupt_the_second(physics: Any) -> None:
        calls.append(physics)
        if len(calls) == 2:
            raise KeyboardInterrupt
        start(physics)

    batch.task.initialize_episode = interrupt_the_second
    with pytest.raises(KeyboardInterrupt):
        batch.reset(range(1, num_envs))
    del batch.task.initialize_episode
    assert batch.step(zero).step_type.tolist() == [1, *[0] * (num_envs - 1)]
    assert (batch.step(zero).step_type == 1).all()


def test_ctrl_c_as_the_batch_is_taken_or_given_back_does_not_lock_it() -> None:
    batch = _walkers()
    batch._use.__enter__()  # as Ctrl-C leaves it that comes right after, or before the release
    zero = np.zeros(batch.action_spec().shape)
    batch.step(zero)
    other = threading.Thread(target=batch.step, args=(zero,))
    other.start()
    other.join()
    assert (batch._counter.steps == 2).all()


def test_changes_of_the_model_it_was_made_from_do_not_reach_a_batch() -> None:
    env = suite.load("humanoid", "walk", {"random": 0})
    batch = BatchEnvironment.from_environment(env, 2, 1, seed=0)
    mass = env.physics.named.model.body_mass["torso"]
    env.physics.named.model.body_mass["torso"] = 50.0
    assert batch.physics.named.model.body_mass["torso"] == mass
    assert batch.physics.model.body_mass[1] == mass
    with pytest.raises(ValueError, match="read-only"):
        batch.physics.named.model.body_mass["torso"] = 1.0


def test_the_model_of_a_batch_is_read_only_and_errors_have_advice() -> None:
    batch = _walkers()
    with pytest.raises((ValueError, AttributeError), match="randomize"):
        batch.physics.model.body_mass[:] = 1.0
    with pytest.raises((ValueError, AttributeError), match="randomize"):
        batch.physics.model.opt.timestep = 0.1


def test_threads_are_by_default_the_cores_that_may_be_used() -> None:
    assert 1 <= cores.usable_cores() <= (os.cpu_count() or 1)
    batch = suite.load_batch("stacker", "stack_2", 64)
    assert batch.physics.simulation.num_threads == min(64, cores.usable_cores())


class _Painter(_Pole):
    def initialize_episode(self, physics: Any) -> None:
        physics.model.tex_data[:] = 0


def test_a_start_that_would_change_textures_is_refused_by_name() -> None:
    sky = '<asset><texture name="t" type="skybox" builtin="flat" width="400" height="400"/></asset>'
    physics = mujoco.Physics.from_xml_string(_POLE.replace("<worldbody>", f"{sky}<worldbody>"))
    with pytest.raises(ValueError, match="cannot read or change tex_data"):
        BatchEnvironment.from_environment(control.Environment(physics, _Painter()), 2)


@pytest.mark.parametrize("seeds", [7, "seven", np.int64(7)])
def test_seeds_that_are_no_sequence_are_refused_by_name(seeds: Any) -> None:
    with pytest.raises(TypeError, match=r"seeds is .*; expected a sequence of 4, one for each row"):
        _walkers().reset(None, seeds)


def test_a_batch_has_the_record_of_its_domain_and_copies_keep_the_seeds() -> None:
    single = suite.load("pendulum", "swingup", {"random": 0})
    batch = BatchEnvironment.from_environment(single, 3, 1, seed=4)
    assert batch.registration is single.registration is not None
    assert "seeds 4 to 6" in repr(copy.deepcopy(batch))


def test_a_reset_ends_the_report_of_a_divergence() -> None:
    batch = suite.load_batch("pendulum", "swingup", 3, 1, seed=0)
    batch.reset()
    batch.physics.data.qpos[1] = np.nan
    batch.step(np.zeros((3, 1)))
    assert batch.diverged.tolist() == [False, True, False]
    batch.reset([1])
    assert not batch.diverged.any()
