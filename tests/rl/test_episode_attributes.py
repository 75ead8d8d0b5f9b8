"""Memory that a task declares: each row of a vectorised batch has its own, as if it were alone."""

import copy
import pickle
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack import gym, rl
from limberjack.evaluation import evaluate
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batch_errors import NotVectorised
from limberjack.rl.batches import batch_of, vectorisable
from limberjack.rl.contract import PhysicsError
from limberjack.rl.rows import RowsEnvironment

from . import odd_environments as odd
from .remembering import COUNTERS, Calls, Smooth, smooth

_FIRST, _MID, _LAST = 0, 1, 2
_KINDS = [pytest.param(True, id="vectorised"), pytest.param(False, id="rows")]


def _batch(
    task: type[odd.Pole], num_envs: int, seed: int = 3, steps: int = odd.STEPS, **kwargs: Any
) -> Any:
    how = {"num_threads": 1, "seed": seed, "vectorised": True, **kwargs}
    return batch_of(odd.environment(task, 0, time_limit=steps * 0.02), num_envs, **how)


def _memory(task: Any, row: int | None = None) -> dict[str, bytes]:
    """The declared values, of one row or of a single environment, to be compared."""
    values = {name: getattr(task, name) for name in task.EPISODE_ATTRIBUTES}
    if row is not None:
        values = {name: value[row] for name, value in values.items()}
    return {name: np.asarray(value).tobytes() for name, value in values.items()}


class _Alone:
    """Single environments that are stepped as the rows of a batch are."""

    def __init__(self, task: type[odd.Pole], num_envs: int, seed: int, **kwargs: Any) -> None:
        self.envs = [odd.environment(task, seed + row, **kwargs) for row in range(num_envs)]

    def step(self, actions: np.ndarray, batch: Any) -> None:
        """Steps all and a batch, and compares them."""
        time_step = batch.step(actions.copy())
        for row, env in enumerate(self.envs):
            try:
                expected = odd.facts(env.step(actions[row].copy()))
            except PhysicsError:
                assert time_step.step_type[row] == _LAST
                assert (time_step.reward[row], time_step.discount[row]) == (0.0, 0.0)
            else:
                assert odd.facts(time_step, row) == expected
        self.compare(batch)

    def reset(self, batch: Any, rows: list[int], seeds: list[int | None] | None) -> None:
        """Begins episodes in some rows, and compares the time steps of those."""
        time_step = batch.reset(rows, seeds)
        for row, seed in zip(rows, seeds or [None] * len(rows), strict=True):
            env = self.envs[row]
            if seed is not None:
                env.reseed(seed)
            assert odd.facts(time_step, row) == odd.facts(env.reset())
        self.compare(batch)

    def compare(self, batch: Any) -> None:
        for row, env in enumerate(self.envs):
            assert _memory(batch.task, row) == _memory(env.task), row


@pytest.mark.parametrize("task", [Smooth, Calls])
@pytest.mark.parametrize(("num_envs", "repeat"), [(1, 1), (2, 1), (7, 1), (1, 3), (5, 3)])
def test_every_hook_counts_when_a_single_environment_would_have_called_it(
    task: type[odd.Pole], num_envs: int, repeat: int
) -> None:
    stream = np.random.RandomState(num_envs + repeat)
    alone = _Alone(task, num_envs, 3, action_repeat=repeat)
    batch = _batch(task, num_envs, action_repeat=repeat)
    began = {name: [] for name in ("partial", "seeded", "diverged", "restored")}
    for number in range(60):
        alone.step(stream.uniform(-1, 0.95, (num_envs, 1)), batch)
        began["diverged"] += batch.diverged.tolist()
        rows = np.flatnonzero(stream.uniform(size=num_envs) < 0.3).tolist()
        if number % 4 == 1 and rows:
            alone.reset(batch, rows, None)
            began["partial"] += rows
        if number % 7 == 3 and rows:
            seeds = [None if stream.uniform() < 0.5 else int(stream.randint(99)) for _ in rows]
            alone.reset(batch, rows, seeds)
            began["seeded"] += [seed for seed in seeds if seed is not None]
        if number % 5 == 2:  # neither asks a hook for good
            batch.observation_spec()
            alone.envs[0].observation_spec()
            repr(batch)
        if number % 6 == 4:
            batch = [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))][number % 2](batch)
            alone.envs = copy.deepcopy(alone.envs)
        if number % 8 == 5:
            source, target = stream.randint(num_envs, size=2).tolist()
            batch.copy_row(source, target)
            alone.envs[target].restore(alone.envs[source].snapshot())
            began["restored"] += [target]
        alone.compare(batch)
    if task is Calls and num_envs > 1:
        assert any(began["diverged"])
    assert all(began[name] for name in ("partial", "seeded", "restored"))


def test_the_step_that_reaches_the_time_limit_asks_for_no_termination() -> None:
    alone = _Alone(Calls, 3, 3, time_limit=3 * 0.02)
    batch = _batch(Calls, 3, steps=3)
    actions = np.random.RandomState(0).uniform(-1, 0.8, (16, 3, 1))
    for action in actions:
        alone.step(action, batch)
    assert (batch.task.of_get_termination < batch.task.of_after_step).all()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_rows_of_a_vector_environment_remember_as_single_ones_do(mode: str) -> None:
    found = {}
    for vectorised in (True, False):
        batch = _batch(Calls, 3, vectorised=vectorised)
        envs = gym.VectorEnv(batch, autoreset_mode=mode)
        observation, _ = envs.reset(seed=[5, 9, 2])
        seen: list[Any] = [{name: value.tobytes() for name, value in observation.items()}]
        actions = np.random.RandomState(1).uniform(-1, 0.8, (25, 3, 1))
        for number, action in enumerate(actions):
            observation, reward, ends, cut, info = envs.step(action)
            mask = ends | cut
            if mode == "Disabled" and mask.any():
                observation, _ = envs.reset(options={"reset_mask": mask})
            if number == 12:
                mask = np.array([True, False, True])
                observation, _ = envs.reset(seed=[1, None, 7], options={"reset_mask": mask})
            seen.append({name: value.tobytes() for name, value in observation.items()})
            seen.append((reward.tobytes(), ends.tolist(), cut.tolist(), sorted(info)))
        found[vectorised] = seen
        envs.close()
    assert found[True] == found[False]


def test_rows_that_wait_show_what_they_saw_last() -> None:
    batch = _batch(Calls, 3)
    batch.reset()
    seen = batch.step(np.zeros((3, 1))).observation
    shown = batch.reset([1]).observation
    for name, values in seen.items():
        np.testing.assert_array_equal(shown[name][[0, 2]], values[[0, 2]])
    assert shown["of_get_observation"][1, 0] == seen["of_get_observation"][1, 0] + 1
    # A restored row has not been asked; it shows its present state.
    batch.restore(batch.snapshot([1]), [0])
    again = batch.reset([]).observation
    assert again["of_get_observation"][:, 0].tolist() == [4, 3, 2]


def test_a_new_seed_puts_back_the_first_values_and_other_resets_go_on() -> None:
    env = odd.environment(Calls, 0)
    batch = _batch(Calls, 2)
    for _ in range(3):
        env.step([0.1])
        batch.step(np.full((2, 1), 0.1))
    played: Any = batch_of(env, 2, 1, seed=3)  # of an environment that has played
    assert _memory(played.task, 0) == _memory(odd.environment(Calls, 0).task)
    env.reset()
    batch.reset()
    assert env.task.episodes == 2
    assert batch.task.episodes.tolist() == [2, 2]
    env.reseed(8)
    assert env.task.episodes == 0
    env.reset()
    batch.reset([1], [8])
    assert env.task.episodes == 1
    assert batch.task.episodes.tolist() == [2, 1]


@pytest.mark.parametrize("source", _KINDS)
@pytest.mark.parametrize("target", _KINDS)
def test_snapshots_go_from_any_kind_of_batch_into_any_other(source: bool, target: bool) -> None:
    actions = np.random.RandomState(2).uniform(-1, 0.8, (7, 2, 1))
    one = _batch(Calls, 2, vectorised=source)
    other = _batch(Calls, 2, vectorised=target, seed=9)
    for action in actions:
        one.step(action)
    saved = one.snapshot()
    other.restore(saved)
    single = odd.environment(Calls, 11)
    single.restore(saved.part(1))
    back = _batch(Calls, 1, seed=77)
    back.restore(single.snapshot())
    expected = odd.future(one, actions)
    assert odd.future(other, actions) == expected
    assert list(odd.steps_of(single, actions[:, 1])) == [rows[1] for rows in expected]
    assert odd.future(back, actions[:, 1:]) == [[rows[1]] for rows in expected]


def test_values_are_copied_in_and_out() -> None:
    env = odd.environment(Smooth, 3)
    batch = _batch(Smooth, 1)
    env.reset()
    batch.reset()
    action, actions = np.full(1, 0.5), np.full((1, 1), 0.5)
    env.step(action)
    batch.step(actions)
    action[:], actions[:] = -9, -9
    assert env.task.last_action == 0.5
    assert batch.task.last_action == 0.5
    calls, row = odd.environment(Calls, 3), _batch(Calls, 1)
    calls.reset()
    row.reset()
    shown, of_row = calls.step([0.1]).observation, row.step(np.full((1, 1), 0.1)).observation
    before = {name: np.array(value) for name, value in shown.items()}
    calls.physics.data.qvel[:] = 55.0
    calls.step([0.2])
    row.step(np.full((1, 1), 0.2))
    for name in ("ring", *COUNTERS):
        np.testing.assert_array_equal(shown[name], before[name])
        np.testing.assert_array_equal(of_row[name][0], before[name])


def test_evaluate_and_batches_of_workers_give_the_returns_of_single_environments() -> None:
    returns = []
    for seed in (3, 4):
        env = odd.environment(Smooth, seed)
        step = env.reset()
        total = 0.0
        while not step.last():
            step = env.step(np.zeros(1))
            total += step.reward
        returns.append(total)
    for workers in (None, 2):
        result = evaluate(smooth, seeds=[3, 4], workers=workers)
        assert [score.total for score in result.scores["zero"]] == returns


class _Undeclared(Smooth):
    EPISODE_ATTRIBUTES = ("change",)


class _Listing(Smooth):
    EPISODE_ATTRIBUTES = ("last_action", "change")

    def after_step(self, physics: Any) -> None:
        self.last = [self.last_action]


class _Nothing(Smooth):
    EPISODE_ATTRIBUTES = ("last_action", "change", "previous")

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.previous: Any = None


class _Growing(Smooth):
    def after_step(self, physics: Any) -> None:
        self.last_action = np.concatenate([self.last_action, self.last_action], axis=-1)


class _Misspelt(Smooth):
    EPISODE_ATTRIBUTES = ("last_actions", "change", "last_action")


@pytest.mark.parametrize(
    ("task", "reason"),
    [
        (_Undeclared, "declare EPISODE_ATTRIBUTES = ('change', 'last_action'), with numbers"),
        (_Listing, "a ring array for the last few, and declare them in EPISODE_ATTRIBUTES"),
        (_Nothing, "declares 'previous' in EPISODE_ATTRIBUTES, which is None before its first"),
        (_Growing, "set self.last_action to shape (4, 2) and dtype float64; expected (4, 1)"),
        (_Misspelt, "Did you mean 'last_action'? Set it in __init__"),
    ],
)
def test_what_cannot_be_kept_for_each_row_is_named_and_played_as_rows(
    task: type[odd.Pole], reason: str
) -> None:
    env = odd.environment(task, 0)
    with pytest.raises(ValueError, match=re.escape(reason)):
        BatchEnvironment.from_environment(env, 4)
    batch = batch_of(env, 4, 1, seed=0)
    assert isinstance(batch, RowsEnvironment)
    assert reason in str(batch.why_rows)


@pytest.mark.parametrize("names", ["last_action", 3, ("last_action", 3), {"change"}])
def test_declarations_of_another_form_are_refused(names: Any) -> None:
    task = type("Odd", (Smooth,), {"EPISODE_ATTRIBUTES": names})
    with pytest.raises(TypeError, match="expected a tuple of names of attributes"):
        batch_of(odd.environment(task, 0), 2)


class _Late(Smooth):
    """Does something else in the twentieth step, which the check at creation does not see."""

    fault: Any = None  # a function of the task and the physics
    hook = ""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.steps = 0
        self.numbers = [1]
        self.table = {"a": 1}
        self.array = np.zeros(3)

    EPISODE_ATTRIBUTES = (*Smooth.EPISODE_ATTRIBUTES, "steps")

    def before_step(self, action: Any, physics: Any) -> None:
        super().before_step(action, physics)
        self.steps += 1
        self._perhaps("before_step", physics)

    def after_step(self, physics: Any) -> None:
        super().after_step(physics)
        self._perhaps("after_step", physics)

    def get_reward(self, physics: Any) -> Any:
        self._perhaps("get_reward", physics)
        return super().get_reward(physics)

    def get_observation(self, physics: Any) -> Any:
        self._perhaps("get_observation", physics)
        return super().get_observation(physics)

    def get_termination(self, physics: Any) -> Any:
        self._perhaps("get_termination", physics)
        return super().get_termination(physics)

    def _perhaps(self, hook: str, physics: Any) -> None:
        if type(self).hook == hook and np.any(np.asarray(self.steps) >= 20):
            type(self).fault(self, physics)


_FAULTS: dict[str, tuple[Callable[[Any, Any], object], str]] = {
    "a new attribute": (lambda task, _: setattr(task, "extra", 1.0), "self.extra"),
    "a replaced list": (lambda task, _: setattr(task, "numbers", [1]), "self.numbers"),
    "a longer list": (lambda task, _: task.numbers.append(2), "self.numbers"),
    "a changed dict": (lambda task, _: task.table.update(a=2), "self.table"),
    "a changed array": (lambda task, _: task.array.fill(1.0), "self.array"),
    "an attribute of the physics": (lambda _, physics: setattr(physics, "x", 1), "physics.x"),
    "a draw": (lambda task, _: task.random.uniform(), "draws from the task's random stream"),
    "another dtype": (
        lambda task, _: setattr(task, "change", np.int64(1)),
        "self.change to shape () and dtype int64",
    ),
}


@pytest.mark.parametrize("fault", _FAULTS)
@pytest.mark.parametrize(
    "hook", ["before_step", "after_step", "get_reward", "get_observation", "get_termination"]
)
def test_a_late_change_of_what_rows_share_raises_in_its_step(
    monkeypatch: pytest.MonkeyPatch, fault: str, hook: str
) -> None:
    change, named = _FAULTS[fault]
    batch = batch_of(_late(), 2, 1, seed=0, vectorised=True)
    monkeypatch.setattr(_Late, "hook", hook)
    monkeypatch.setattr(_Late, "fault", staticmethod(change))
    for _ in range(20):  # one of which begins the episodes
        batch.step(np.zeros((2, 1)))
    with pytest.raises(NotVectorised, match=f"(?s)(?=.*task _Late)(?=.*{re.escape(named)})") as e:
        batch.step(np.zeros((2, 1)))
    assert hook in str(e.value)
    assert batch.begins.all() or hook == "before_step"
    if named.startswith(("self.", "physics.")) and fault != "another dtype":
        with pytest.raises(NotVectorised, match="task _Late set"):  # it stays unusable
            batch.reset()


def _late() -> Any:
    env = odd.environment(_Late, 0, time_limit=10)
    assert env.task.fault is None
    return env


def test_settings_may_be_changed_between_steps() -> None:
    batch = _batch(_Late, 2)
    batch.reset()
    batch.task.numbers = [2]
    batch.task.array[:] = 4.0
    batch.task.change = np.array([0.5, 0.25])
    batch.step(np.zeros((2, 1)))
    assert batch.task.numbers == [2]


def test_an_error_of_a_hook_leaves_the_memory_as_it_was() -> None:
    batch = _batch(Smooth, 2)
    batch.reset()
    before = _memory(batch.task, 1)
    with pytest.raises(ValueError, match="action"):
        batch.step(np.zeros((2, 5)))
    assert _memory(batch.task, 1) == before


def test_attributes_of_rows_are_read_and_set_from_outside() -> None:
    envs = gym.VectorEnv(_batch(Smooth, 2))
    envs.reset(seed=0)
    envs.step(np.array([[0.25], [0.5]]))
    assert np.ravel(envs.get_attr("last_action")).tolist() == [0.25, 0.5]
    envs.set_attr("change", [1.0, 2.0])
    assert envs.get_attr("change") == (1.0, 2.0)
    envs.reset(seed=0)
    assert envs.batches[0].task.change.tolist() == [0.0, 0.0]  # set by the start
    with pytest.raises(TypeError, match="change"):
        envs.set_attr("change", ["a", "b"])
    envs.close()


def test_code_that_does_not_play_rows_refuses_tasks_that_remember() -> None:
    with pytest.raises(ValueError, match=r"Smooth remembers last_action, change.*batches play"):
        vectorisable(odd.environment(Smooth, 0))


def test_the_batch_of_a_task_that_remembers_is_offered_by_name() -> None:
    assert rl.batch_of(odd.environment(Smooth, 0), 2, seed=0).why_rows is None


def test_a_snapshot_stays_as_it_was() -> None:
    batch = _batch(Calls, 2)
    batch.reset()
    batch.step(np.full((2, 1), 0.5))
    saved = batch.snapshot()
    before = copy.deepcopy(saved.memory)
    batch.reset()  # which changes the ring in place
    batch.step(np.full((2, 1), 0.5))
    for one, kept in zip(saved.memory, before, strict=True):
        for name in Calls.EPISODE_ATTRIBUTES:
            np.testing.assert_array_equal(one["task"][name], kept["task"][name])


def test_actions_of_less_precision_are_remembered_in_that_of_the_first_value() -> None:
    """As Gymnasium's are; in single environments too, so that all numbers are equal."""
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 3, 1)).astype(np.float32)
    found = []
    for vectorised in (True, False):
        batch = batch_of(odd.environment(Smooth, 0), 3, 1, seed=3, vectorised=vectorised)
        batch.reset()
        found.append([batch.step(action).reward for action in actions])
    np.testing.assert_array_equal(*found)
    for row in range(3):
        single = odd.environment(Smooth, 3 + row)
        single.reset()
        rewards = [single.step(action[row]).reward or 0.0 for action in actions]
        np.testing.assert_array_equal(rewards, np.array(found[0])[:, row])
        assert single.task.last_action.dtype == np.float64


def test_a_snapshot_with_memory_of_another_form_changes_nothing() -> None:
    batch = _batch(Smooth, 2)
    batch.reset()
    batch.step(np.full((2, 1), 0.5))
    before, snapshot = batch.snapshot(), batch.snapshot([0])
    snapshot.memory[0]["task"]["last_action"] = np.zeros(2)
    with pytest.raises(NotVectorised, match=r"a snapshot of task Smooth set self.last_action"):
        batch.restore(snapshot, [1])
    assert not batch.begins.any()
    np.testing.assert_array_equal(batch.integration_states(), before.physics["state"])
