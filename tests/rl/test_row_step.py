"""Time steps of rows, collected by threads, and steps of plain rows in phases."""

import collections
import functools
import signal
import threading
from collections.abc import Callable, Sequence
from typing import Any

import dm_env
import mujoco as official
import numpy as np
import pytest

from limberjack import mujoco
from limberjack.rl.row_step import RowStep, as_mapping, step_in_phases
from limberjack.rl.rows import RowsEnvironment
from limberjack.rl.threads import RowErrors, RowThreads, run

from . import odd_environments as odd

_MID, _LAST = dm_env.StepType.MID, dm_env.StepType.LAST


def _step() -> RowStep:
    last = {"angle": np.full((3, 2), 7.0)}
    return RowStep(3, {"angle": np.zeros((3, 2))}, last)


def _time_step(kind: Any = _MID, reward: Any = 0.5, discount: Any = 1.0, angle: Any = (1.0, 2.0)):
    observed = collections.OrderedDict(angle=np.array(angle))
    return dm_env.TimeStep(kind, reward, discount, observed)


def test_a_row_has_its_own_values_and_leaves_the_others() -> None:
    found = _step()
    found.take(1, _time_step(), None)
    assert found.reward.tolist() == [0.0, 0.5, 0.0]
    assert found.observation["angle"].tolist() == [[0, 0], [1, 2], [0, 0]]
    found.take(1, _time_step(reward=0.25), None)
    assert found.reward[1] == 0.75  # of two steps with one action


@pytest.mark.parametrize(("discount", "timed_out"), [(1.0, True), (0.0, False), (0.9, False)])
def test_an_end_with_discount_1_is_a_truncation(discount: float, timed_out: bool) -> None:
    found = _step()
    found.take(2, _time_step(_LAST, discount=discount), None)
    assert found.timed_out.tolist() == [False, False, timed_out]
    assert found.step_type[2] == _LAST


def test_a_row_that_diverges_shows_its_last_observation() -> None:
    found = _step()
    found.diverge(0)
    assert found.observation["angle"][0].tolist() == [7, 7]
    assert (found.discount[0], found.step_type[0], found.diverged[0]) == (0.0, _LAST, True)


def test_a_row_may_be_cut_off_at_a_limit_that_its_environment_does_not_know() -> None:
    found = _step()
    found.take(0, _time_step(), None)
    found.cut(0)
    assert (found.step_type[0], found.timed_out[0], found.cut_off[0]) == (_LAST, True, True)


@pytest.mark.parametrize(
    ("time_step", "error", "message"),
    [
        (_time_step(angle=[[1.0, 2.0]]), ValueError, r"'angle' has shape \(1, 2\) and dtype"),
        (_time_step(angle=[[1.0], [2.0]]), ValueError, r"'angle' has shape \(2, 1\) and dtype"),
        (_time_step(reward=None), TypeError, "the reward of a step is None; expected a number"),
        (_time_step(reward="high"), TypeError, "the reward of a step is 'high'"),
        (_time_step(reward=np.zeros(2)), TypeError, "the reward of a step is array"),
        (_time_step(discount="d"), TypeError, "the discount of a step is 'd'"),
        (_time_step(angle=(1.0,)), ValueError, r"observation 'angle' has shape \(1,\)"),
        (_time_step(angle=(1, 2)), ValueError, "dtype int64; expected .* float64"),
        (dm_env.TimeStep(_MID, 0.0, 1.0, {"speed": np.zeros(2)}), ValueError, "has \\['speed'\\]"),
    ],
)
def test_what_does_not_fit_the_specs_is_refused(
    time_step: dm_env.TimeStep, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        _step().take(0, time_step, None)


def test_a_single_array_is_a_flat_observation() -> None:
    array = np.zeros(2)
    assert as_mapping(array)["observations"] is array
    assert as_mapping({"a": array}) == {"a": array}


_HOOKS = ["before_step", "after_step", "get_reward", "get_observation", "get_termination"]
_FIRST, _MID, _LAST = 0, 1, 2


class _Recorded(odd.Noisy):
    """Records the calls of its hooks, their threads and the time, and does a job in one."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.calls: list[tuple[str, float]] = []
        self.threads: set[int] = set()
        self.job: Callable[[], object] = int
        self.at = ""

    def _record(self, hook: str, physics: Any) -> None:
        self.calls.append((hook, float(physics.data.time)))
        self.threads.add(threading.get_ident())
        _order.append((hook, id(self)))
        if hook == self.at:
            self.at = ""
            self.job()

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self._record("initialize_episode", physics)

    def before_step(self, action: Any, physics: Any) -> None:
        super().before_step(action, physics)
        self._record("before_step", physics)

    def after_step(self, physics: Any) -> None:
        super().after_step(physics)
        self._record("after_step", physics)

    def get_reward(self, physics: Any) -> Any:
        self._record("get_reward", physics)
        return super().get_reward(physics)

    def get_observation(self, physics: Any) -> Any:
        self._record("get_observation", physics)
        return super().get_observation(physics)

    def get_termination(self, physics: Any) -> Any:
        self._record("get_termination", physics)
        return super().get_termination(physics)


_order: list[tuple[str, int]] = []  # hooks of all tasks, and the tasks
_recorded = functools.partial(odd.of_task, _Recorded)
_last_action = functools.partial(odd.of_task, odd.LastAction)


def _batch(num_envs: int = 4, build: Any = _recorded, **kwargs: Any) -> Any:
    """A batch on two threads, of which both advance simulations, however short that is."""
    batch: Any = RowsEnvironment(build, num_envs, 2, seed=0, **kwargs)
    batch._num_physics_threads = 2
    return batch


@pytest.mark.parametrize("repeat", [1, 3])
def test_a_row_makes_the_calls_of_a_single_environment_in_their_order(repeat: int) -> None:
    batch, actions = _batch(5, action_repeat=repeat), odd.actions_of(12, 5)
    singles: list[Any] = [_recorded(row) for row in range(5)]
    for one in singles:
        one.action_repeat = repeat
    for env in (*batch.environments, *singles):
        env.task.calls.clear()
    found = odd.future(batch, actions)
    for step, given in enumerate(actions):
        time_steps = [one.step(action) for one, action in zip(singles, given, strict=True)]
        assert found[step] == [odd.facts(one) for one in time_steps]
    for env, one in zip(batch.environments, singles, strict=True):
        assert env.task.calls == one.task.calls


def test_hooks_run_in_the_callers_thread_and_in_phases() -> None:
    batch = _batch(3)
    batch.reset()
    _order.clear()
    batch.step(np.zeros((3, 1)))
    ids = [id(env.task) for env in batch.environments]
    after = [(hook, one) for one in ids for hook in _HOOKS[1:]]
    assert _order == [("before_step", one) for one in ids] + after
    for env in batch.environments:
        assert env.task.threads == {threading.get_ident()}


def test_simulations_are_advanced_in_several_threads() -> None:
    batch = _batch(16, _last_action)
    batch.reset()
    batch.step(np.zeros((16, 1)))
    meet = threading.Barrier(2, timeout=10)  # passed only if two threads are in MuJoCo at once
    seen: set[int] = set()

    def passive(model: Any, data: Any) -> None:
        if threading.get_ident() not in seen:
            seen.add(threading.get_ident())
            meet.wait()

    official.set_mjcb_passive(passive)
    try:
        batch.step(np.zeros((16, 1)))
    finally:
        official.set_mjcb_passive(None)
    assert len(seen) == 2
    assert threading.get_ident() in seen


@pytest.mark.parametrize("hook", _HOOKS)
def test_an_error_in_a_phase_is_raised_when_all_rows_are_done(hook: str) -> None:
    batch = _batch()
    batch.reset()
    task = batch.environments[1].task
    for env in batch.environments:
        env.task.calls.clear()

    def fail() -> None:
        raise KeyError("mine")

    task.at, task.job = hook, fail
    with pytest.raises(KeyError, match="mine") as raised:
        batch.step(np.zeros((4, 1)))
    assert "row 1" in raised.value.__notes__[0]
    for row in (0, 2, 3):
        assert [name for name, _ in batch.environments[row].task.calls] == _HOOKS
    _assert_all_begin(batch)


@pytest.mark.parametrize("hook", _HOOKS)
def test_an_interrupt_in_a_phase_leaves_all_rows_whole(hook: str) -> None:
    batch = _batch()
    batch.reset()
    task = batch.environments[2].task
    task.at, task.job = hook, lambda: signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        batch.step(np.zeros((4, 1)))
    assert [name for name, _ in batch.environments[3].task.calls][-1:] != ["get_termination"]
    _assert_all_begin(batch)


@pytest.mark.parametrize("row", [0, 3])
def test_an_interrupt_while_simulations_are_advanced_leaves_all_rows_whole(row: int) -> None:
    batch = _batch()
    batch.reset()
    caller, count = threading.get_ident(), iter(range(100))

    def passive(model: Any, data: Any) -> None:
        if threading.get_ident() == caller and next(count) == row:
            signal.raise_signal(signal.SIGINT)

    batch._num_physics_threads = 1  # all in this thread, where the signal arrives
    official.set_mjcb_passive(passive)
    try:
        with pytest.raises(KeyboardInterrupt):
            batch.step(np.zeros((4, 1)))
    finally:
        official.set_mjcb_passive(None)
    _assert_all_begin(batch)


def _assert_all_begin(batch: Any) -> None:
    """All rows begin with the next step, and no environment is occupied by this thread."""
    num_envs = batch.num_envs
    assert batch.begins.all()
    kinds: list[int] = []
    for env in batch.environments:
        other = threading.Thread(target=lambda env=env: kinds.append(env.reset().step_type))
        other.start()
        other.join()
    assert kinds == [_FIRST] * num_envs
    assert (batch.step(np.zeros((num_envs, 1))).step_type == _FIRST).all()
    assert (batch.step(np.zeros((num_envs, 1))).step_type != _FIRST).all()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_rows_that_failed_to_advance_are_not_ended(error: type[BaseException]) -> None:
    envs = {row: _recorded(row) for row in (0, 2)}
    for env in envs.values():
        env.reset()
        env.task.calls.clear()

    def share(job: Callable[[int], None], rows: Sequence[int]) -> RowErrors:
        return [*run(job, [0]), (2, error())]

    found = _found(envs[0], 3)
    errors = step_in_phases(envs, np.zeros((3, 1)), found, share)
    assert [(row, type(one)) for row, one in errors] == [(2, error)]
    assert [name for name, _ in envs[2].task.calls] == ["before_step"]
    assert not envs[2].is_running
    assert (len(envs[0].task.calls) == len(_HOOKS)) is (error is ValueError)


def _found(env: Any, num_envs: int) -> RowStep:
    specs = env.observation_spec()
    empty = {name: np.zeros((num_envs, *one.shape), one.dtype) for name, one in specs.items()}
    return RowStep(num_envs, empty, {name: value.copy() for name, value in empty.items()})


def test_an_environment_in_use_by_another_thread_is_refused_and_stays_in_use() -> None:
    batch = _batch()
    batch.reset()
    task = batch.environments[1].task
    inside, go_on = threading.Event(), threading.Event()
    task.at, task.job = "before_step", lambda: (inside.set(), go_on.wait())
    other = threading.Thread(target=batch.environments[1].step, args=(np.zeros(1),), daemon=True)
    other.start()
    inside.wait()
    for _ in range(2):
        batch._begins[:] = False  # as if no error had been raised
        with pytest.raises(RuntimeError, match="two threads at once") as raised:
            batch.step(np.zeros((4, 1)))
        assert "row 1" in raised.value.__notes__[0]
    go_on.set()
    other.join()
    _assert_all_begin(batch)


class _OwnStep(mujoco.Physics):
    """A physics that steps in its own way, and knows its threads."""

    threads: Any = None

    def step(self, nstep: int = 1) -> None:
        self.threads = {*(self.threads or ()), threading.get_ident()}
        super().step(nstep)
        super().step(1)


def _mixed(seed: int) -> Any:
    """Rows that are plain, have a physics of their own, or are of a subclass."""
    kinds: list[Callable[[], Any]] = [
        lambda: odd.environment(_Recorded, seed),
        lambda: odd.environment(_Recorded, seed, physics=_OwnStep),
        lambda: odd.environment(_Recorded, seed, odd.Logging),
        lambda: odd.environment(_Recorded, seed, legacy_step=False),
    ]
    return kinds[seed % 4]()


@pytest.mark.parametrize("repeat", [1, 2])
def test_rows_of_all_kinds_are_stepped_in_one_batch(repeat: int) -> None:
    actions = odd.actions_of(20, 8)
    batch = _batch(8, _mixed, action_repeat=repeat)
    alone = RowsEnvironment(_mixed, 8, 1, seed=0, action_repeat=repeat)
    assert odd.future(batch, actions) == odd.future(alone, actions)
    caller = threading.get_ident()
    for row, env in enumerate(batch.environments):
        assert (env.task.threads - {caller} == set()) is (row % 4 in (0, 3))
        if row % 4 == 1:
            assert env.physics.threads == env.task.threads - {caller}


def test_one_thread_steps_row_by_row() -> None:
    batch: Any = RowsEnvironment(_recorded, 2, 1, seed=0)
    batch.reset()
    _order.clear()
    batch.step(np.zeros((2, 1)))
    assert _order == [(hook, id(env.task)) for env in batch.environments for hook in _HOOKS]


def test_a_row_whose_environment_was_reset_by_itself_begins() -> None:
    batch = _batch(build=_last_action)
    batch.reset()
    batch.step(np.zeros((4, 1)))
    batch.environments[2]._reset_next_step = True
    assert batch.step(np.zeros((4, 1))).step_type.tolist() == [_MID, _MID, _FIRST, _MID]


def test_a_step_that_was_replaced_later_is_called() -> None:
    batch = _batch(build=_last_action)
    batch.reset()
    env, taken = batch.environments[1], []
    step = env.step
    env.step = lambda action: (taken.append(action), step(action))[1]
    physics_step = batch.environments[2].physics.step
    batch.environments[2].physics.step = lambda n: (taken.append(n), physics_step(n))[1]
    batch.step(np.zeros((4, 1)))
    assert len(taken) == 2


class _Falls(odd.Pole):
    """Diverges at the second step of odd seeds, in the physics."""

    steps = 0

    def before_step(self, action: Any, physics: Any) -> None:
        super().before_step(action, physics)
        self.steps += 1
        if self.steps == 2 and self.random.randint(2):
            physics.data.qvel[:] = np.nan


@pytest.mark.parametrize("repeat", [1, 3])
def test_a_row_that_diverges_in_its_physics_ends_as_on_one_thread(repeat: int) -> None:
    build, actions = functools.partial(odd.of_task, _Falls), odd.actions_of(7, 6)
    batch = _batch(6, build, action_repeat=repeat)
    alone = RowsEnvironment(build, 6, 1, seed=0, action_repeat=repeat)
    diverged = 0
    for given in actions:
        assert odd.future(batch, given[None]) == odd.future(alone, given[None])
        np.testing.assert_array_equal(batch.diverged, alone.diverged)
        np.testing.assert_array_equal(batch._steps, alone._steps)
        diverged += batch.diverged.sum()
    assert 0 < diverged < 6


def test_threads_that_are_not_worth_it_are_not_used() -> None:
    batch: Any = RowsEnvironment(_recorded, 4, 2, seed=0)
    assert batch._num_physics_threads == 1
    batch.reset()
    batch.step(np.zeros((4, 1)))
    assert isinstance(batch._threads, RowThreads)
    assert batch._threads._threads == []


@pytest.mark.parametrize("under", ["raise", "ignore"])
def test_the_callers_handling_of_floating_point_errors_counts(under: Any) -> None:
    batch = _batch()
    batch.reset()
    zero = np.zeros(1)
    batch.environments[3].task.at = "after_step"
    batch.environments[3].task.job = lambda: 1 / zero
    with np.errstate(divide=under):
        if under == "ignore":
            batch.step(np.zeros((4, 1)))
            return
        with pytest.raises(FloatingPointError):
            batch.step(np.zeros((4, 1)))


def test_what_is_not_stepped_in_parts() -> None:
    assert _recorded(0)._steps_in_parts
    assert not _mixed(1)._steps_in_parts
    pictures = {"camera": 0, "height": 8, "width": 8}
    assert not odd.environment(pixels=pictures)._steps_in_parts
