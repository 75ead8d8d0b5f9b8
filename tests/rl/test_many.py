"""Batches of several tasks as one batch."""

import copy
import functools
import math
import pickle
import threading
import time
from collections.abc import Callable
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs

from limberjack import rl, suite
from limberjack.rl.contract import PhysicsError
from limberjack.rl.many import ManySnapshot, ManyTasks, TaskOfMany, TaskStatistics, threads_of_one
from limberjack.rl.randomize import scale

from . import odd_environments as odd
from . import remembering

_TASKS = ["pendulum:swingup", "reacher:easy", "lqr:lqr_2_1"]
_ROWS = [2, 3, 1]


def _many(seed: int = 3, seconds: float = 0.2, **kwargs: Any) -> ManyTasks:
    kwargs = {"task_kwargs": {"time_limit": seconds}, **kwargs}
    return suite.load_batch(_TASKS, rows=_ROWS, seed=seed, **kwargs)


def _actions(many: ManyTasks, count: int, seed: int = 0) -> np.ndarray:
    return np.random.RandomState(seed).uniform(-1, 1, (count, *many.action_mask.shape))


def _assert_same(one: dm_env.TimeStep, other: dm_env.TimeStep) -> None:
    for name in ("step_type", "reward", "discount"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name, values in one.observation.items():
        np.testing.assert_array_equal(values, other.observation[name], name)


class _Line(odd.Catch):
    """The user's own environment, whose step is in the hands of a test."""

    def __init__(self, seed: int, during: Callable[[], object] = lambda: None) -> None:
        super().__init__(seed)
        self._during = during

    def step(self, action: Any) -> dm_env.TimeStep:
        self._during()
        return super().step(action)


def _mixed(during: Callable[[], object] = lambda: None, num_threads: int | None = None) -> Any:
    """A task of the suite, one of the user that is vectorised, and one in complete rows."""
    batches = [
        suite.load_batch("pendulum", "swingup", 2, 1, seed=0),
        rl.batch_of(remembering.smooth, 2, 1, seed=2),
        rl.batch_of(lambda seed: _Line(seed, during), 3, 1, seed=4, vectorised=False),
    ]
    return ManyTasks(batches, num_threads=num_threads)


def test_masks_sizes_and_facts_are_those_of_the_tasks() -> None:
    many = _many()
    assert many.num_envs == 6
    assert many.observation_mask.sum(axis=1).tolist() == [3, 3, 6, 6, 6, 4]
    assert many.action_mask.sum(axis=1).tolist() == [1, 1, 2, 2, 2, 1]
    assert many.task_ids.tolist() == [0, 0, 1, 1, 1, 2]
    assert [task.name for task in many.tasks] == _TASKS
    assert [task.rows for task in many.tasks] == [slice(0, 2), slice(2, 5), slice(5, 6)]
    assert [task.episode_length for task in many.tasks] == [10, 10, 7]
    assert [task.control_timestep for task in many.tasks] == [0.02, 0.02, 0.03]
    assert [task.has_goal for task in many.tasks] == [True, True, False]
    assert [task.has_goal for task in _mixed().tasks] == [True, False, False]
    assert many.tasks[1].instruction == "Reach a target with a radius of 5 cm."
    assert math.isnan(many.control_timestep())
    observation = many.reset().observation
    assert list(observation) == ["observations", "observation_mask", "action_mask", "task_id"]
    assert not observation["observations"][~many.observation_mask].any()
    for name, spec in many.observation_spec().items():
        spec.validate(observation[name])
    assert "6 rows, seeds 3 to 8" in repr(many)


@pytest.mark.parametrize(
    ("steps", "discount"), [(1000, 0.995), (500, 0.99), (125, 0.96), (5, 0.95), (math.inf, 0.995)]
)
def test_the_discount_follows_the_length(steps: float, discount: float) -> None:
    spec = specs.BoundedArray((1,), float, -1, 1)
    task = TaskOfMany("a:b", slice(0, 1), 1, 1, spec, steps, 0.02, 1, False, "")
    assert task.discount == pytest.approx(discount, rel=1e-12)  # of exact decimals


def test_masks_cannot_be_written_to() -> None:
    many = _many()
    for array in (many.task_ids, many.observation_mask, many.action_mask):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_actions_behind_those_of_a_task_are_ignored() -> None:
    one, other = _many(), _many()
    one.reset(), other.reset()
    for actions in _actions(one, 5):
        rubbish = np.where(one.action_mask, actions, np.nan)
        _assert_same(one.step(actions), other.step(rubbish))


@pytest.mark.parametrize(
    ("actions", "error", "message"),
    [
        (np.zeros((6, 1)), ValueError, r"shape \(6, 1\); expected \(6, 2\)"),
        (np.zeros(6), ValueError, r"shape \(6,\); expected \(6, 2\)"),
        (np.full((6, 2), "a"), TypeError, "expected numbers"),
        (np.array([[0, 0]] * 4 + [[0, np.inf], [0, 0]]), ValueError, r"not finite in rows \[14\]"),
    ],
)
def test_wrong_actions_step_nothing(actions: Any, error: type[Exception], message: str) -> None:
    many = _many()
    many.first_row = 10
    many.reset()
    before = many.snapshot()
    with pytest.raises(error, match=message):
        many.step(actions)
    after = many.snapshot()
    np.testing.assert_array_equal(before.step_count, after.step_count)
    assert not many.begins.any()


def test_rows_of_every_kind_are_those_of_their_batch() -> None:
    many = _mixed()
    alone = _mixed().parts
    many.reset()
    seen = [batch.reset() for batch in alone]
    for actions in _actions(many, 2 * odd.STEPS):
        found = many.step(actions)
        for number, (task, batch) in enumerate(zip(many.tasks, alone, strict=True)):
            own = actions[task.rows, : task.action_size]
            seen[number] = batch.step(own.reshape(batch.action_spec().shape))
            flat = [v.reshape(batch.num_envs, -1) for v in seen[number].observation.values()]
            mine = found.observation["observations"][task.rows, : task.observation_size]
            np.testing.assert_array_equal(mine, np.concatenate(flat, axis=1))
            np.testing.assert_array_equal(found.reward[task.rows], seen[number].reward)
            np.testing.assert_array_equal(found.step_type[task.rows], seen[number].step_type)
            np.testing.assert_array_equal(found.discount[task.rows], seen[number].discount)


@pytest.mark.parametrize("num_threads", [1, 2, 8])
def test_the_number_of_threads_changes_nothing(num_threads: int) -> None:
    one, other = _mixed(num_threads=3), _mixed(num_threads=num_threads)
    _assert_same(one.reset(), other.reset())
    for actions in _actions(one, 6):
        _assert_same(one.step(actions), other.step(actions))


def test_the_longest_task_is_stepped_first(monkeypatch: pytest.MonkeyPatch) -> None:
    many = _mixed(num_threads=1)
    taken: list[str] = []
    for part in many.parts:
        step, name = part.step, part.name

        def noted(
            actions: Any, step: Any = step, name: str = name, wait: bool = part is many.parts[1]
        ) -> Any:
            taken.append(name)
            until = time.thread_time() + 0.01 * wait
            while time.thread_time() < until:
                pass
            return step(actions)

        monkeypatch.setattr(part, "step", noted)
    many.reset()
    for actions in _actions(many, 2):
        many.step(actions)
    assert taken[:3] == [part.name for part in many.parts]
    assert taken[3] == many.parts[1].name


class _Dice(_Line):
    """Draws from NumPy's global stream."""

    def step(self, action: Any) -> dm_env.TimeStep:
        time_step = super().step(action)
        return time_step._replace(reward=None if time_step.first() else np.random.uniform())


def test_tasks_that_draw_from_a_shared_stream_are_stepped_in_order() -> None:
    def rewards(num_threads: int) -> list[np.ndarray]:
        batches = []
        for seed in (0, 1):
            kind = type(f"Dice{seed}", (_Dice,), {})
            batches.append(rl.batch_of(kind, 2, 1, seed=seed, vectorised=False))
        many = ManyTasks(batches, num_threads=num_threads)
        many.reset()
        np.random.seed(3)
        return [many.step(np.zeros((4, 1))).reward for _ in range(20)]

    stream = np.random.RandomState(3)
    expected = stream.uniform(size=4)
    for one in (rewards(1), rewards(2)):
        np.testing.assert_array_equal(one[0], expected)
    np.testing.assert_array_equal(rewards(1), rewards(2))


def test_tasks_are_stepped_at_the_same_time() -> None:
    barrier = threading.Barrier(2, timeout=20)
    waits: list[bool] = []

    def during() -> None:
        if waits:
            barrier.wait()

    batches = []
    for seed in (0, 1):
        kind = type(f"Line{seed}", (_Line,), {})
        build = functools.partial(kind, during=during)
        batches.append(rl.batch_of(build, 1, 1, seed=seed, vectorised=False))
    many = ManyTasks(batches, num_threads=2)
    many.reset()
    waits.append(True)
    many.step(np.zeros((2, 1)))  # each waits for the other
    assert not barrier.broken


def test_the_callers_context_holds_in_the_threads() -> None:
    seen: list[str] = []
    many = _mixed(lambda: seen.append(np.geterr()["over"]), num_threads=3)
    many.reset()
    seen.clear()
    with np.errstate(over="raise"):
        many.step(np.zeros(many.action_mask.shape))
    assert seen == ["raise"] * 3


class _OddError(Exception):
    pass


@pytest.mark.parametrize("error", [_OddError, KeyboardInterrupt])
def test_after_an_error_every_row_begins_an_episode(error: type[BaseException]) -> None:
    fails: list[bool] = []

    def during() -> None:
        if fails:
            raise error

    many = _mixed(during)
    many.reset()
    fails.append(True)
    with pytest.raises(error) as caught:
        many.step(np.zeros(many.action_mask.shape))
    if error is _OddError:
        notes = " ".join(caught.value.__notes__)
        assert "raised by _Line, rows 4 to 6; the rows of all tasks begin" in notes
    fails.clear()
    assert many.begins.all()
    assert many.step(np.full(many.action_mask.shape, np.nan)).step_type.tolist() == [0] * 7
    assert many.step(np.zeros(many.action_mask.shape)).step_type.tolist() == [1] * 7


def _diverging(many: ManyTasks) -> np.ndarray:
    actions = np.zeros(many.action_mask.shape)
    many.parts[0].physics.data.qvel[1] = 1e11  # pyright: ignore[reportAttributeAccessIssue]
    return actions


def test_messages_of_a_task_number_the_rows_of_the_whole(caplog: pytest.LogCaptureFixture) -> None:
    many = _many()
    many.first_row = 20
    many.reset()
    actions = np.zeros(many.action_mask.shape)
    many.parts[1].physics.data.qvel[2] = 1e11  # pyright: ignore[reportAttributeAccessIssue]
    many.step(actions)
    assert "rows [24] diverged" in caplog.text
    assert many.first_row == 20


def test_rows_that_diverge_end_alone_and_are_named(caplog: pytest.LogCaptureFixture) -> None:
    many = _many()
    many.first_row = 20
    many.reset()
    found = many.step(_diverging(many))
    assert many.diverged.tolist() == [False, True, False, False, False, False]
    assert found.step_type.tolist() == [1, 2, 1, 1, 1, 1]
    assert "rows [21] diverged" in caplog.text
    assert many.statistics()["pendulum:swingup"].diverged == 1
    many.reset([0])
    assert not many.diverged[0]


def test_divergence_raises_if_asked_for() -> None:
    many = _many(on_divergence="raise")
    many.reset()
    with pytest.raises(PhysicsError, match=r"rows \[1\]"):
        many.step(_diverging(many))
    assert many.begins.all()


def test_a_reset_of_some_rows_leaves_the_others_alone() -> None:
    many = _many()
    many.reset()
    for actions in _actions(many, 3):
        many.step(actions)
    before = many.snapshot()
    time_step = many.reset([1, 4], [50, None])
    assert time_step.step_type.tolist() == [1, 0, 1, 1, 0, 1]
    after = many.snapshot()
    assert after.step_count.tolist() == [3, 0, 3, 3, 0, 3]
    for name, values in before.part(3).physics.items():
        np.testing.assert_array_equal(values, after.part(3).physics[name], name)
    single = suite.load("pendulum", "swingup", {"random": 50})
    expected = np.concatenate([np.ravel(v) for v in single.reset().observation.values()])
    np.testing.assert_array_equal(time_step.observation["observations"][1, :3], expected)


def test_a_snapshot_restores_all_rows_or_some_also_in_another_process() -> None:
    many, other = _many(), _many(seed=40)
    many.reset(), other.reset()
    actions = _actions(many, 14)
    for one in actions[:3]:
        many.step(one)
    snapshot = pickle.loads(pickle.dumps(many.snapshot()))
    assert isinstance(snapshot, ManySnapshot)
    assert len(snapshot) == 6
    assert repr(snapshot) == f"<ManySnapshot {', '.join(_TASKS)}, 6 rows, step 3>"
    future = [many.step(one) for one in actions[3:]]
    other.restore(snapshot)
    for one, expected in zip(actions[3:], future, strict=True):
        _assert_same(other.step(one), expected)
    # Two rows of one task, and one of another.
    third = _many(seed=80)
    third.reset()
    third.restore(snapshot.part(np.array([2, 4, 5])), [3, 4, 5])
    other.restore(snapshot)
    same = np.tile([0.3, -0.4], (6, 1))
    found, expected = (batch.step(same).observation["observations"] for batch in (third, other))
    np.testing.assert_array_equal(found[[3, 4, 5]], expected[[2, 4, 5]])


def test_the_snapshot_of_a_row_is_that_of_its_task() -> None:
    many = _many()
    many.reset()
    for actions in _actions(many, 3):
        many.step(actions)
    env = suite.load("reacher", "easy")
    env.reset()
    env.restore(many.snapshot([3]))
    action = np.array([0.3, -0.4])
    alone = env.step(action)
    found = many.step(np.tile(action, (6, 1)))
    flat = np.concatenate([np.ravel(v) for v in alone.observation.values()])
    np.testing.assert_array_equal(found.observation["observations"][3, :6], flat)
    many.restore(env.snapshot(), [2])
    many.copy_row(2, 4)
    after = many.snapshot().step_count.tolist()
    assert after == [4, 4, 4, 4, 4, 4]


@pytest.mark.parametrize(
    ("rows", "target", "message"),
    [
        ([0, 1], [2, 3], "task 'SwingUp'; expected 'Reacher'"),
        ([0, 2], [0, 1], r"of pendulum:swingup \(1 rows\), reacher:easy \(1 rows\); expected"),
        ([0, 2], [0, 2, 3], r"expected pendulum:swingup \(1 rows\), reacher:easy \(2 rows\)"),
        ([2, 3], [2], "holds 2 environments; expected 1"),
    ],
)
def test_a_snapshot_of_other_tasks_restores_nothing(
    rows: list[int], target: list[int], message: str
) -> None:
    many = _many()
    many.reset()
    snapshot = many.snapshot(rows)
    many.step(_actions(many, 1)[0])
    with pytest.raises(ValueError, match=message):
        many.restore(snapshot, target)
    assert many.snapshot().step_count.tolist() == [1] * 6


def test_a_snapshot_with_one_bad_task_restores_nothing() -> None:
    many = _many()
    many.reset()
    snapshot = many.snapshot()
    assert isinstance(snapshot, ManySnapshot)
    snapshot.parts[2].physics.pop("state")
    many.step(_actions(many, 1)[0])
    with pytest.raises(ValueError, match="nothing was restored"):
        many.restore(snapshot)
    assert many.snapshot().step_count.tolist() == [1] * 6
    with pytest.raises(TypeError, match="expected a Snapshot"):
        many.restore({})  # pyright: ignore[reportArgumentType]


def test_a_part_of_a_snapshot_has_rows_that_exist() -> None:
    many = _many()
    many.reset()
    with pytest.raises(IndexError, match="expected numbers from 0 to 5"):
        many.snapshot().part(6)
    assert len(many.snapshot([])) == 0


def test_states_are_set_in_rows_of_one_task() -> None:
    many = _many()
    many.reset()
    time_step = many.set_states({"qpos": [[0.5], [1.0]]}, [0, 1])
    np.testing.assert_allclose(
        time_step.observation["observations"][:2, 0], np.cos([0.5, 1.0]), rtol=1e-12
    )  # the pole's cosine, computed by MuJoCo from a rotation
    with pytest.raises(ValueError, match="rows of pendulum:swingup, reacher:easy, whose positions"):
        many.set_states({"qpos": np.zeros((2, 1))}, [1, 2])
    other = _many(seed=9)
    other.reset()
    _assert_same(other.set_states(many.snapshot()), many.reset([]))


def test_copies_are_independent() -> None:
    many = _many()
    many.reset()
    many.step(_actions(many, 1)[0])
    for made in (copy.deepcopy(many), pickle.loads(pickle.dumps(many))):
        expected = [copy.deepcopy(made).step(one) for one in _actions(many, 1, seed=1)]
        before = many.snapshot().step_count.tolist()
        _assert_same(made.step(_actions(many, 1, seed=1)[0]), expected[0])
        assert many.snapshot().step_count.tolist() == before


def test_statistics_count_whole_episodes_by_task() -> None:
    many = _many()
    many.reset()
    assert many.statistics()["reacher:easy"].episodes == 0
    assert math.isnan(many.statistics()["reacher:easy"].mean_return)
    rewards, lengths = np.zeros(6), np.zeros(6)
    actions = _actions(many, 11)
    for one in actions[:10]:  # lqr ends after 7, and begins again
        time_step = many.step(one)
        rewards[:5] += time_step.reward[:5]
        lengths += time_step.step_type != 0
    found = many.statistics()
    assert found["pendulum:swingup"].episodes == 2
    mean = pytest.approx(rewards[2:5].mean(), rel=1e-12)  # of a sum in another order
    assert found["reacher:easy"].mean_return == mean
    assert found["reacher:easy"].mean_length == 10
    assert found["reacher:easy"].success is not None
    assert found["lqr:lqr_2_1"].success is None
    assert (found["lqr:lqr_2_1"].episodes, found["lqr:lqr_2_1"].mean_length) == (1, 7)

    many.clear_statistics()
    many.step(actions[10])
    many.reset([0])
    many.restore(many.snapshot([1]), [1])  # of which the start was not seen
    for one in actions[:10]:
        many.step(one)
    assert many.statistics()["pendulum:swingup"].episodes == 1


def test_each_episode_of_a_row_is_counted_by_itself() -> None:
    many = _many()
    many.reset()
    rewards = []
    for actions in _actions(many, 21):  # two episodes of ten, and a start between them
        rewards.append(many.step(actions).reward[2:5])
    found = many.statistics()["reacher:easy"]
    assert (found.episodes, found.mean_length) == (6, 10)
    assert found.mean_return == pytest.approx(np.sum(rewards) / 6, rel=1e-12)  # in another order


def test_sums_of_statistics_are_those_of_all_episodes() -> None:
    one = TaskStatistics(1, 10.0, 5.0, 1.0, 0)
    other = TaskStatistics(3, 2.0, 9.0, 0.0, 1)
    nothing = TaskStatistics(0, math.nan, math.nan, None, 0)
    assert one + other == TaskStatistics(4, 4.0, 8.0, 0.25, 1)
    assert one + nothing == nothing + one == one


def test_terms_and_success_say_which_rows_have_them() -> None:
    many = _many()
    many.reset()
    many.step(_actions(many, 1)[0])
    terms = many.reward_terms
    only = {name: many.rows_with(name).tolist() for name in terms}
    of_reacher = [False, False, True, True, True, False]
    assert only["at_target"] == of_reacher
    assert not many.rows_with("nothing").any()
    success = many.success
    assert success is not None
    assert many.rows_with("success")[2:5].all()
    assert not many.rows_with("success")[5]


def _bodies(batch: Any) -> int:
    return batch.single.model.nbody


def test_fields_drawn_for_rows_are_shown_as_objects() -> None:
    many = _many(environment_kwargs={"randomize": {"body_mass": scale(0.9, 1.1)}})
    many.reset()
    drawn = many.randomization["body_mass"]
    assert [len(row) for row in drawn] == [
        nbody for part in many.parts for nbody in [_bodies(part)] * part.num_envs
    ]


def test_actions_are_within_the_bounds_of_all_tasks() -> None:
    spec = _many().single_action_spec()
    np.testing.assert_array_equal(spec.minimum, [-1, -1])
    lqr = ManyTasks([suite.load_batch("lqr", "lqr_2_1", 1, 1)]).single_action_spec()
    np.testing.assert_array_equal(lqr.maximum, suite.load("lqr", "lqr_2_1").action_spec().maximum)

    class Elsewhere(odd.Catch):
        def action_spec(self) -> Any:
            return specs.BoundedArray((1,), np.float64, 2.0, 3.0, name="move")

    batches = [
        suite.load_batch("pendulum", "swingup", 1, 1),
        rl.batch_of(Elsewhere, 1, 1, seed=0, vectorised=False),
    ]
    with pytest.raises(ValueError, match="no action is within the bounds of all tasks"):
        ManyTasks(batches)


def test_pictures_of_rows_of_several_tasks() -> None:
    many = _many()
    many.reset()
    pictures = many.render([0, 3, 5], height=20, width=30)
    assert pictures.shape == (3, 20, 30, 3)
    alone = many.parts[1].render([1], height=20, width=30)
    np.testing.assert_array_equal(pictures[1], alone[0])
    assert many.render([], height=20, width=30).shape == (0, 20, 30, 3)


def test_the_length_of_episodes_can_be_set_for_all() -> None:
    many = _many()
    assert many.step_limit == math.inf  # tasks differ
    many.step_limit = 4
    assert many.step_limit == 4
    assert [task.episode_length for task in many.tasks] == [4, 4, 4]
    many.reset()
    time_step = [many.step(actions) for actions in _actions(many, 4)][-1]
    assert time_step.step_type.tolist() == [2] * 6
    assert many.timed_out.all()


@pytest.mark.parametrize("method", ["state_sizes", "integration_states", "episode_fields"])
def test_what_differs_between_tasks_is_refused(method: str) -> None:
    with pytest.raises(TypeError, match="differ between tasks: ask the batch of each task"):
        getattr(_many(), method)()


def test_batches_that_cannot_be_one_are_refused() -> None:
    pendulum = suite.load_batch("pendulum", "swingup", 1, 1)
    twin = suite.load_batch("pendulum", "swingup", 1, 1)
    faster = suite.load_batch("reacher", "easy", 1, 1, action_repeat=2)
    seen = suite.load_batch("reacher", "easy", 1, 1, environment_kwargs={"pixels": {}})
    for batches, error, message in (
        ([], ValueError, "no batches"),
        ([pendulum, twin], ValueError, "pendulum:swingup is given twice"),
        ([pendulum, faster], ValueError, "repeat actions differently"),
        ([pendulum, seen], ValueError, "observes pictures"),
        ([pendulum, suite.load("reacher", "easy")], TypeError, "got a Environment"),
        ([_many()], TypeError, "got a ManyTasks"),
    ):
        with pytest.raises(error, match=message):
            ManyTasks(batches)  # pyright: ignore[reportArgumentType]


def test_a_closed_batch_is_refused() -> None:
    many = _many()
    many.reset()
    many.close()
    many.close()
    with pytest.raises(RuntimeError, match="closed"):
        many.step(np.zeros((6, 2)))


@pytest.mark.parametrize(
    ("num_threads", "tasks", "expected"), [(8, 2, 4), (8, 51, 1), (1, 3, 1), (5, 2, 2)]
)
def test_threads_are_shared_between_tasks(num_threads: int, tasks: int, expected: int) -> None:
    assert threads_of_one(num_threads, tasks) == expected
    with pytest.raises(ValueError, match="num_threads is 0"):
        threads_of_one(0, tasks)


def test_a_part_of_a_snapshot_has_its_rows_in_order() -> None:
    many = _many()
    many.reset()
    with pytest.raises(ValueError, match="expected them in their order"):
        many.snapshot().part(np.array([3, 0]))


def test_the_length_of_episodes_is_one_of_whole_actions() -> None:
    many = _many(action_repeat=2)
    many.step_limit = 5
    assert {task.episode_length for task in many.tasks} == {3}


def test_an_empty_part_of_a_snapshot_has_no_rows() -> None:
    many = _many()
    many.reset()
    assert len(many.snapshot().part(np.array([], int))) == 0


def test_rows_with_a_goal_are_known_whichever_is_read_last() -> None:
    many = suite.load_batch(["reacher:easy", "cheetah:run"], rows=1, seed=0)
    many.reset()
    many.step(np.zeros(many.action_spec().shape))
    assert many.success is not None
    assert many.reward_terms
    goals = [task.has_goal for task in many.tasks]
    assert many.rows_with("success").tolist() == goals
